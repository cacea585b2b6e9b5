"""Error of rendering against the time that it takes, one setting beside the other.

Settings differ from default mode in one thing or two: the step, the levels that are
encoded, the transmittance at which a ray ends, the networks' precision, the mask of empty
sub-tets, the number of pixels.  Each is rendered in every turn, from all sides; the error is
that of random pixels against the float64 reference at the model's own step, which is what the
image of a field means, and of all pixels against conformance mode, which is the same but for
float32 (its row tells how much that is).

Default mode may end rays early, use half precision and leave levels out, as long as every
view has at least BOUND dB and no channel of any pixel is more than LARGEST off: PSNR alone
would allow single pixels that sparkle when the object moves, and so would random pixels,
which miss them (docs/design/005-rendering.md).

Shapes: S settings, R turns.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from ..field.field import TetField
from ..render.options import RenderOptions
from ..render.render import Renderer
from . import pictures, rule
from .photographs import Photographs
from .stopwatch import WARM_UP, Timing, milliseconds, timing_of

BOUND = 45.0  # dB, of default mode
LARGEST = 8.0  # 1/255
STEP_FACTORS = (4.0, 2.0, 1.5, 0.5, 0.25)
TERMINATIONS = (0.0, 1e-3, 5e-3, 1e-2, 2e-2, 3e-2, 5e-2, 0.1, 0.2)
SCALES = (2, 4)
SPARED_LEVELS = (1, 2, 3)
DISCRETIZATION_PIXELS = 500
DEFAULT = RenderOptions()
FULL = np.uint64(2**64 - 1)  # a tet's mask without an empty sub-tet


@dataclass(frozen=True)
class Setting:
    """A way to render.

    Attributes:
        name: In tables and plots.
        family: What differs from default mode.
        options: RenderOptions.
        scale: Of the image's sides: 2 is a quarter of the pixels, enlarged again.
        masked: Whether empty sub-tets are left out.
        candidate: Whether default mode may do so; see the module's text.
    """

    name: str
    family: str
    options: RenderOptions = DEFAULT
    scale: int = 1
    masked: bool = True
    candidate: bool = False


CONFORMANCE = Setting("conformance", "conformance", RenderOptions(conformance=True))


@dataclass(frozen=True)
class Row:
    """What a setting costs and how wrong it is.

    Attributes:
        setting, family: See Setting.
        psnr: Of all views together, random pixels against the reference [dB].
        worst_psnr: Of the worst view [dB].
        largest: Difference of a channel, of these pixels [1/255].
        largest_anywhere: The same, of all pixels against conformance mode [1/255].
        photo_psnr: Against photographs [dB], if there are any.
        frame: Of one view [ms].
        samples: A pixel.
        front: Whether nothing else is both quicker and closer.
        candidate: Whether default mode may do so.
        default: Whether it is what default mode does.
        chosen: Whether it is what the rule picks.
    """

    setting: str
    family: str
    psnr: float
    worst_psnr: float
    largest: float
    largest_anywhere: float
    photo_psnr: float | None
    frame: Timing
    samples: float
    front: bool
    candidate: bool
    default: bool
    chosen: bool


def settings(level_count: int, half: bool) -> list[Setting]:
    """What is compared, default mode first.

    Args:
        level_count: Of the field.
        half: Whether default mode evaluates networks in half precision.
    """
    found = [Setting("default", "default", candidate=True)]
    for stop in TERMINATIONS:
        if stop != DEFAULT.stop:
            options = RenderOptions(termination=stop)
            found.append(Setting(f"stop {stop:g}", "termination", options, candidate=True))
    for spared in SPARED_LEVELS:
        if (count := level_count - spared) > 0:
            options = RenderOptions(level_count=count)
            name = less(spared)
            found.append(Setting(name, "levels", options, candidate=True))
    for stop in (0.05, 0.1):
        options = RenderOptions(termination=stop, level_count=level_count - 1)
        name = f"{less(1)}, stop {stop:g}"
        if level_count > 1:
            found.append(Setting(name, "levels and termination", options, candidate=True))
    if half:
        options = RenderOptions(single_precision=True)
        found.append(Setting("float32", "precision", options, candidate=True))
    for factor in STEP_FACTORS:
        found.append(Setting(f"step × {factor:g}", "step", RenderOptions(step_factor=factor)))
    found.append(CONFORMANCE)
    found.append(Setting("no mask", "mask", masked=False))
    for scale in SCALES:
        found.append(Setting(f"1/{scale} of the pixels a side", "resolution", scale=scale))
    if level_count > 1:  # about what the viewer does on a CPU while something moves
        fast = RenderOptions(step_factor=2.0, level_count=level_count - 1)
        found.append(Setting(f"1/2, step × 2, {less(1)}", "several", fast, scale=2))
    return found


def less(count: int) -> str:
    """The name of the setting that leaves out so many of the finest levels."""
    return f"{count} {'level' if count == 1 else 'levels'} less"


class RenderingStudy:
    """Renders a field at rest in many ways.

    Attributes:
        device: Warp's.
        pictures: Views and their references.
        times: Of every setting that was measured, in every turn [ms].  name -> [R]
    """

    def __init__(self, field: TetField, device, size: int, view_count: int, pixel_count: int):
        """Compute the references.

        Args:
            size: Of the images, both sides.
            pixel_count: How many pixels of each view are compared.
        """
        self.field, rest = field, field.mesh.rest_vertices
        self._renderer = Renderer(field, device)
        self._renderer.set_vertices(rest)
        self.device = self._renderer.device
        self._unmasked = None
        self.pictures = [
            pictures.picture(field, rest, camera, pixel_count, seed)
            for seed, camera in enumerate(pictures.views(field, view_count, size))
        ]
        self.times = {}

    @property
    def half(self) -> bool:
        """Whether default mode evaluates networks in half precision here."""
        return self._renderer.shading.evaluate_slots is not None

    def reference_error(self) -> pictures.ImageError:
        """How far the reference is from its own limit of short steps; see pictures."""
        rng, parts = np.random.default_rng(0), []
        for picture in self.pictures:
            count = min(DISCRETIZATION_PIXELS // len(self.pictures), len(picture.pixels))
            some = rng.choice(len(picture.pixels), count, replace=False)
            parts.append(
                replace(picture, pixels=picture.pixels[some], expected=picture.expected[some])
            )
        return pictures.discretization(self.field, parts)

    def measure(
        self,
        compared: list[Setting],
        turns: int,
        photos: Photographs | None = None,
        step: Callable[[float], None] = lambda share: None,
    ) -> list[Row]:
        """A row for each setting, the first of which is the default.

        Args:
            turns: How often each is timed, one after the other in each turn.
            step: Called with the share that is done.
        """
        for _ in range(WARM_UP):
            self._images(compared[0])
        exact, _ = self._images(CONFORMANCE)
        found = []
        for number, setting in enumerate(compared):  # compiles and allocates, too
            images, samples = self._images(setting)
            single = [
                pictures.picture_error([image], [picture])
                for image, picture in zip(images, self.pictures, strict=True)
            ]
            found.append((images, samples, single, most_off(images, exact)))
            step(0.5 * (number + 1) / len(compared))
        times = self._times(compared, turns, lambda share: step(0.5 + 0.5 * share))
        self.times = {s.name: t.tolist() for s, t in zip(compared, times, strict=True)}
        worst = [min(error.psnr for error in single) for _, _, single, _ in found]
        together = [pictures.picture_error(images, self.pictures) for images, *_ in found]
        within = [
            setting.candidate and max(error.largest, anywhere) <= LARGEST
            for setting, error, (*_, anywhere) in zip(compared, together, found, strict=True)
        ]
        errors = np.where(within, -np.array(worst), np.inf)
        chosen = rule.cheapest(times, errors, -BOUND)
        best = rule.front(np.median(times, axis=1), [-error.psnr for error in together])
        return [
            Row(
                setting=setting.name,
                family=setting.family,
                psnr=together[i].psnr,
                worst_psnr=worst[i],
                largest=together[i].largest,
                largest_anywhere=found[i][3],
                photo_psnr=self._photo_psnr(setting, photos),
                frame=timing_of(times[i]),
                samples=found[i][1],
                front=bool(best[i]),
                candidate=setting.candidate,
                default=i == 0,
                chosen=i == chosen,
            )
            for i, setting in enumerate(compared)
        ]

    def _times(self, compared, turns, step):
        """Milliseconds of a view, of every setting in every turn.  [S, R]"""
        times = np.empty((len(compared), turns))
        rng = np.random.default_rng(0)
        for turn in range(turns):
            for number in rng.permutation(len(compared)):  # none always follows the same one
                if self.half:  # a wavefront guesses its rounds by the image before
                    self._rendered(compared[number], 1)
                taken = milliseconds(lambda n=number: self._rendered(compared[n]), self.device)
                times[number, turn] = taken / len(self.pictures)
            step((turn + 1) / turns)
        return times

    def stages(self, repeats: int) -> dict[str, Timing]:
        """Of a view in default mode, pose included; each stage is waited for, see Stages."""
        renderer, rest = self._renderer, self.field.mesh.rest_vertices
        default, found = Setting("default", "default"), {}
        for repeat in range(-WARM_UP, repeats):
            seconds = renderer.stage_seconds = {}
            for picture in self.pictures:
                renderer.set_vertices(rest)
                renderer.render(picture.camera, default.options)
            if repeat >= 0:
                for name, total in seconds.items():
                    found.setdefault(name, []).append(1e3 * total / len(self.pictures))
        renderer.stage_seconds = None
        return {name: timing_of(times) for name, times in found.items()}

    def _rendered(self, setting, count=None):
        """An Image of the first views, all by default; what enlarges it is OpenGL."""
        renderer, scale = self._renderer_for(setting), setting.scale
        cameras = [picture.camera for picture in self.pictures[:count]]
        return [
            renderer.render(
                camera.resized(camera.width // scale, camera.height // scale), setting.options
            )
            for camera in cameras
        ]

    def _images(self, setting):
        """The colors of every view [H, W, 3], and samples a pixel."""
        images, samples, pixel_count = [], 0, 0
        for picture, image in zip(self.pictures, self._rendered(setting), strict=True):
            width, height = picture.camera.width, picture.camera.height
            color = image.color_array()[..., :3]
            images.append(color if setting.scale == 1 else enlarged(color, width, height))
            samples += image.sample_count
            pixel_count += width * height
        return images, samples / pixel_count

    def _renderer_for(self, setting) -> Renderer:
        if setting.masked:
            return self._renderer
        if self._unmasked is None:
            full = np.full_like(self.field.occupancy, FULL)
            self._unmasked = Renderer(replace(self.field, occupancy=full), self.device)
            self._unmasked.set_vertices(self.field.mesh.rest_vertices)
        return self._unmasked

    def _photo_psnr(self, setting, photos):
        if photos is None or setting.scale > 1:
            return None
        return photos.psnr(self._renderer_for(setting), setting.options)


def most_off(images, others) -> float:
    """The largest difference of a channel of any pixel of images of bytes [1/255]."""
    pairs = zip(images, others, strict=True)
    return max(float(np.abs(a.astype(int) - b).max()) for a, b in pairs)


def enlarged(image, width: int, height: int):
    """An image of bytes [h, w, 3] with more pixels, interpolated as the viewer does."""
    resized = Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR)
    return np.asarray(resized)
