"""Error of rendering against its run time, for many settings.

PSNR compares random pixels with the float64 reference at the model's own step, which
defines the image of a field.  Random pixels miss single sparkling pixels, so all pixels are
compared with conformance mode.  The pixels that differ most are suspects: they are compared
with the reference, too.

Default mode may end rays early, use half precision and leave levels out, as long as every
view has at least BOUND dB and no channel of any pixel is more than LARGEST off, from
conformance mode or, of random pixels and suspects, from the reference.  (PSNR alone would
allow single pixels that sparkle when the object moves: docs/design/005-rendering.md.)

Shapes: S settings, R turns, P views.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from PIL import Image

from ....core.field import TetField, multiplies_pairs
from ....core.render import Renderer, RenderOptions, default_stop
from .. import rule
from ..effort import Effort
from ..stopwatch import WARM_UP, Share, Timing, held_back, milliseconds, timing_of
from . import pictures
from .pictures import Photograph, differences

BOUND = 45.0  # dB, of default mode
LARGEST = 8.0  # 1/255
SUSPECTS = 16  # pixels of each view, of each setting that default mode may use
STEP_FACTORS = (4.0, 2.0, 1.5, 0.5, 0.25)
TERMINATIONS = (0.0, 1e-3, 3e-3, 5e-3, 1e-2, 2e-2, 3e-2, 5e-2, 0.1, 0.2)
SCALES = (2, 4)
SPARED_LEVELS = (1, 2, 3)
DEFAULT = RenderOptions()
FULL = np.uint64(2**64 - 1)  # a tet's mask without an empty sub-tet


@dataclass(frozen=True)
class Setting:
    """One set of options to compare."""

    name: str
    family: str  # the kind of difference from default mode
    options: RenderOptions = DEFAULT
    scale: int = 1  # of the image's sides: 2 is a quarter of the pixels, enlarged again
    masked: bool = True  # whether empty sub-tets are left out
    candidate: bool = False  # whether default mode may use it


CONFORMANCE = Setting("conformance", "conformance", RenderOptions(conformance=True))


@dataclass(frozen=True)
class RenderingRow:
    """Time and error of a setting."""

    setting: Annotated[str, "setting"]
    family: str
    psnr: Annotated[float, "PSNR [dB]"]  # of all views together
    worst_psnr: Annotated[float, "worst view [dB]"]
    largest: Annotated[float, "largest [1/255]"]  # of random pixels and suspects
    largest_anywhere: Annotated[float | None, "all pixels, from conformance [1/255]"]
    photo_psnr: Annotated[float | None, "photographs [dB]"]
    frame: Annotated[Timing, "ms a view"]
    relative: Annotated[Share, "of the default's [%]"]  # in the same turn
    samples: Annotated[float, "samples a pixel"]
    front: Annotated[bool, "on the front"]  # no other setting is both faster and closer
    candidate: bool
    default: bool
    chosen: Annotated[bool, "the rule's"]

    @property
    def within(self) -> bool:
        """Whether its error is within the bounds of default mode."""
        largest = max(self.largest, self.largest_anywhere or 0.0)
        return self.worst_psnr >= BOUND and largest <= LARGEST


def settings(level_count: int, half: bool, deferred=False, wavefront=False) -> list[Setting]:
    """The settings to compare, default mode first.

    Args:
        half: Default mode's networks use half precision.
        deferred: A ray has one color.
        wavefront: Default mode's rounds do not wait for the host.
    """
    found = [Setting("default", "default", candidate=True)]

    def add(name, family, candidate=False, **options):
        found.append(Setting(name, family, RenderOptions(**options), candidate=candidate))

    for stop in TERMINATIONS:
        if stop != default_stop(deferred):
            add(f"stop {stop:g}", "termination", True, termination=stop)
    for spared in SPARED_LEVELS:
        if (count := level_count - spared) > 0:
            add(_less(spared), "levels", True, level_count=count)
    if level_count > 1:
        for stop in (0.05, 0.1):
            name, count = f"{_less(1)}, stop {stop:g}", level_count - 1
            add(name, "levels and termination", True, termination=stop, level_count=count)
    if half:
        add("float32", "precision", True, single_precision=True)
    if wavefront:
        add("half, waited for", "precision", path="host")
    for factor in STEP_FACTORS:
        add(f"step × {factor:g}", "step", step_factor=factor)
    found.append(CONFORMANCE)
    found.append(Setting("no mask", "mask", masked=False))
    for scale in SCALES:
        found.append(Setting(f"1/{scale} of the pixels a side", "resolution", scale=scale))
    if level_count > 1:  # about what the viewer does on a CPU while something moves
        fast = RenderOptions(step_factor=2.0, level_count=level_count - 1)
        found.append(Setting(f"1/2, step × 2, {_less(1)}", "several", fast, scale=2))
    return found


def _less(count):
    return f"{count} {'level' if count == 1 else 'levels'} less"


class RenderingStudy:
    """Renders a field at rest with many settings.

    Attributes:
        pictures: Views and their references.
        times: Time of each measured setting in each turn [ms].  name -> [R]
    """

    def __init__(self, field: TetField, device, effort: Effort):
        """Compute the references."""
        self.field, rest = field, field.mesh.rest_vertices
        self._renderer = Renderer(field, device)
        self._renderer.set_vertices(rest)
        self.device = self._renderer.device
        self.pictures = [
            pictures.picture(field, rest, camera, effort.pixel_count, seed)
            for seed, camera in enumerate(pictures.views(field, effort.view_count, effort.size))
        ]
        self.size, self.times = effort.size, {}

    @property
    def half(self) -> bool:
        """Whether default mode evaluates networks in half precision here."""
        return self.wavefront or (self.device.is_cpu and multiplies_pairs())

    @property
    def wavefront(self) -> bool:
        """Whether default mode runs in rounds that do not wait for the host."""
        return self._renderer.shading.in_place is not None

    def measure(
        self,
        compared: list[Setting],
        turns: int,
        photos: list[Photograph] | None = None,
        step: Callable[[float], None] = lambda share: None,
    ) -> list[RenderingRow]:
        """A row for each setting, the first of which is the default; see section() in tell.py."""
        for _ in range(WARM_UP):
            self._images(compared[0])
        exact, _ = self._images(CONFORMANCE)
        found = []
        for number, setting in enumerate(compared):  # compiles and allocates, too
            found.append(self._images(setting))
            step(0.5 * (number + 1) / len(compared))
        suspects = self._suspects(compared, [images for images, _ in found], exact)
        times = self._times(compared, turns, lambda share: step(0.5 + 0.5 * share))
        self.times = {s.name: t.tolist() for s, t in zip(compared, times, strict=True)}
        shares = rule.shares(times)
        rows = []
        for number, (setting, (images, samples)) in enumerate(zip(compared, found, strict=True)):
            together = pictures.picture_error(images, self.pictures)
            pairs = zip(images, self.pictures, strict=True)
            single = [pictures.picture_error([image], [picture]).psnr for image, picture in pairs]
            suspected = pictures.picture_error(images, suspects).largest
            anywhere = float(differences(images, exact).max())
            photo_psnr = None
            if photos and setting.scale == 1:
                renderer = self._renderer if setting.masked else self._unmasked
                photo_psnr = pictures.photo_psnr(photos, renderer, setting.options)
            row = RenderingRow(
                setting=setting.name,
                family=setting.family,
                psnr=together.psnr,
                worst_psnr=min(single),
                largest=max(together.largest, suspected),
                largest_anywhere=None if setting.options.conformance else anywhere,
                photo_psnr=photo_psnr,
                frame=timing_of(times[number]),
                relative=timing_of(100.0 * shares[number], Share),
                samples=samples,
                front=False,
                candidate=setting.candidate,
                default=number == 0,
                chosen=False,
            )
            rows.append(row)
        errors = [-row.worst_psnr if row.candidate and row.within else np.inf for row in rows]
        chosen = rule.cheapest(times, errors, -BOUND)
        best = rule.front([row.relative.median for row in rows], [-row.psnr for row in rows])
        return [replace(row, front=bool(best[i]), chosen=i == chosen) for i, row in enumerate(rows)]

    def stages(self, repeats: int) -> dict[str, Timing]:
        """Milliseconds per view of each stage in default mode, and of all "together"."""
        renderer, rest, found = self._renderer, self.field.mesh.rest_vertices, {}
        for repeat in range(-WARM_UP, repeats):
            seconds = renderer.stage.seconds = {}
            for picture in self.pictures:
                renderer.set_vertices(rest)
                with held_back(self.device):
                    renderer.render(picture.camera, DEFAULT)
            if repeat >= 0:
                for name, total in (*seconds.items(), ("together", sum(seconds.values()))):
                    found.setdefault(name, []).append(1e3 * total / len(self.pictures))
        renderer.stage.seconds = None
        return {name: timing_of(times) for name, times in found.items()}

    def _suspects(self, compared, shown, exact):
        """A Picture of each view: the pixels where candidates differ most from conformance."""
        worst = [
            np.argsort(differences(images, exact).reshape(len(exact), -1))[:, -SUSPECTS:]
            for setting, images in zip(compared, shown, strict=True)
            if setting.candidate or setting is compared[0]
        ]
        return [
            pictures.picture_of(self.field, picture.vertices, picture.camera, np.unique(pixels))
            for picture, *pixels in zip(self.pictures, *worst, strict=True)
        ]

    def _times(self, compared, turns, step):
        """Milliseconds per view, for each setting in each turn.  [S, R]"""
        times = np.empty((len(compared), turns))
        rng = np.random.default_rng(0)
        for turn in range(turns):
            for number in rng.permutation(len(compared)):  # no setting always follows the same one
                if self.wavefront:  # it predicts its rounds from the last image
                    self._rendered(compared[number], 1)
                taken = milliseconds(lambda n=number: self._rendered(compared[n]), self.device)
                times[number, turn] = taken / len(self.pictures)
            step((turn + 1) / turns)
        return times

    def _rendered(self, setting, count=None):
        """Images of the first `count` views (default: all), before they are enlarged."""
        renderer = self._renderer if setting.masked else self._unmasked
        side = self.size // setting.scale
        return [
            renderer.render(picture.camera.resized(side, side), setting.options)
            for picture in self.pictures[:count]
        ]

    def _images(self, setting):
        """The colors of all views [P, H, W, 3], and samples per pixel."""
        images, size = self._rendered(setting), self.size
        colors = [enlarged(image.color_array()[..., :3], size, size) for image in images]
        samples = sum(image.sample_count for image in images)
        return np.stack(colors), samples / (len(images) * size**2)

    @cached_property
    def _unmasked(self) -> Renderer:
        """A renderer of the same field with every sub-tet occupied."""
        full = np.full_like(self.field.occupancy, FULL)
        renderer = Renderer(replace(self.field, occupancy=full), self.device)
        renderer.set_vertices(self.field.mesh.rest_vertices)
        return renderer


def enlarged(image, width: int, height: int):
    """A uint8 image [h, w, 3], enlarged with the viewer's interpolation."""
    resized = Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR)
    return np.asarray(resized)
