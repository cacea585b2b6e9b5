"""The section on rendering: error of an image against its run time, for many settings.

PSNR compares random pixels with the float64 reference at the model's own step, which
defines the image of a field.  Random pixels miss single sparkling pixels, so all pixels are
compared with conformance mode.

Default mode may end rays early, use half precision and leave levels out, as long as every
view has at least BOUND dB and no channel of any pixel is more than LARGEST off, from the
reference or from conformance mode.  (PSNR alone would allow single pixels that sparkle when
the object moves: docs/design/005-rendering.md.)

The rule that chooses a default takes the fastest setting whose error is within the bound.  The
speed of a shared machine varies between turns, so each time is divided by the default's time in
the same turn; the least median wins.  Of equals, the most exact wins.

Shapes: S settings, R turns, P views.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np

from ....core.field import TetField, multiplies_pairs
from ....core.render import Renderer, RenderOptions, default_stop
from ..effort import Effort
from ..report.contents import Figure, Section, Table
from ..report.plots import INK, label, new_figure, png
from ..stopwatch import WARM_UP, Share, Spread, milliseconds, spread_of
from . import moving, pictures
from .pictures import ExpectedPixels, PhotoPixels, largest_difference, picture_error

BOUND = 45.0  # dB, of default mode
LARGEST = 8.0  # 1/255
STEP_FACTORS = (4.0, 2.0, 0.5)
TERMINATIONS = (0.0, 1e-3, 2e-3, 3e-3, 5e-3, 1e-2, 2e-2, 3e-2, 5e-2, 0.1, 0.2)
SPARED_LEVELS = (1, 2, 3)
DISCRETIZATION_PIXELS = 500
ENOUGH = 12  # turns that resolve differences of some percent
COLORS = {  # of families
    "termination": "tab:blue",
    "levels": "tab:green",
    "precision": "tab:purple",
    "step": "tab:orange",
    "conformance": "tab:gray",
}


class Setting(NamedTuple):
    """One set of options to compare."""

    name: str
    family: str  # the kind of difference from default mode
    options: RenderOptions = RenderOptions()
    candidate: bool = False  # whether default mode may use it


CONFORMANCE = Setting("conformance", "conformance", RenderOptions(conformance=True))


@dataclass(frozen=True)
class RenderingRow:
    """Time and error of a setting."""

    setting: Annotated[str, "setting"]
    family: str
    psnr: Annotated[float, "PSNR [dB]"]  # of all views together
    worst_psnr: Annotated[float, "worst view [dB]"]
    largest: Annotated[float, "largest [1/255]"]  # of random pixels
    largest_anywhere: Annotated[float | None, "all pixels, from conformance [1/255]"]
    photo_psnr: Annotated[float | None, "photographs [dB]"]
    frame: Annotated[Spread, "ms a view"]
    relative: Annotated[Share, "of the default's [%]"]  # in the same turn
    samples: Annotated[float, "samples a pixel"]
    candidate: bool
    default: bool
    chosen: Annotated[bool, "the rule's"]

    @property
    def within(self) -> bool:
        """Whether its error is within the bounds of default mode."""
        largest = max(self.largest, self.largest_anywhere or 0.0)
        return self.worst_psnr >= BOUND and largest <= LARGEST


def section(
    field: TetField,
    device: str,
    effort: Effort,
    photos: list[PhotoPixels] | None = None,
    step: Callable[[float], None] = lambda share: None,
) -> Section:
    """Measure all settings of a model at rest; `step` is called with the finished share."""
    renderer, rest = Renderer(field, device), field.mesh.rest_vertices
    renderer.set_vertices(rest)
    expected = []
    for seed, camera in enumerate(pictures.views(field, effort.view_count, effort.size)):
        numbers = pictures.random_pixels(camera, effort.pixel_count, seed)
        expected.append(pictures.expected_pixels(field, rest, camera, numbers))
    own = pictures.discretization(field, expected, DISCRETIZATION_PIXELS)
    on_cpu = renderer.device.is_cpu
    share = 0.8 if on_cpu else 1.0
    part = lambda done: step(share * done)  # noqa: E731
    rows, times = measure(renderer, settings(renderer), expected, effort.turns, photos, part)
    tables = [Table("rendering", "Settings, each different from the default.", rows)]
    if on_cpu:  # CUDA renders full images while things move
        part = lambda done: step(share + (1.0 - share) * done)  # noqa: E731
        tables.append(moving.table(field, effort.moving_size, part))
    caption = (
        "Error against time: the default's time, times each setting's share of it. Up and left is"
        f" better. Dashed: {BOUND:g} dB, the bound of default mode. The table names all points."
    )
    values = {"bound": BOUND, "largest_bound": LARGEST, "reference_psnr": own.psnr}
    values |= {"reference_largest": own.largest, "times": times}
    return Section(
        key="rendering",
        title="Rendering: error against time",
        findings=_findings(rows, expected, photos) + moving.findings(tables[1:]),
        method=_method(expected, effort.turns, own),
        tables=tables,
        figures=[Figure("rendering", caption, plot(rows))],
        passed=rows[0].within,
        values=values,
    )


def settings(renderer: Renderer) -> list[Setting]:
    """The settings to compare, default mode first."""
    options, level_count = renderer.field.options, renderer.field.layout.level_count
    half = renderer.shading.in_place is not None or (renderer.device.is_cpu and multiplies_pairs())
    found = [Setting("default", "default", candidate=True)]

    def add(name, family, candidate, **options):
        found.append(Setting(name, family, RenderOptions(**options), candidate=candidate))

    for stop in TERMINATIONS:
        if stop != default_stop(options.deferred):
            add(f"stop {stop:g}", "termination", True, termination=stop)
    for spared in SPARED_LEVELS:
        if level_count > spared:
            name = f"{spared} {'level' if spared == 1 else 'levels'} less"
            add(name, "levels", True, level_count=level_count - spared)
    if half:
        add("float32", "precision", True, single_precision=True)
    for factor in STEP_FACTORS:
        add(f"step × {factor:g}", "step", False, step_factor=factor)
    return [*found, CONFORMANCE]


def measure(
    renderer: Renderer,
    compared: list[Setting],
    expected: list[ExpectedPixels],
    turns: int,
    photos: list[PhotoPixels] | None,
    step: Callable[[float], None],
) -> tuple[list[RenderingRow], dict[str, list]]:
    """A row for each setting, the first of which is the default, and its times [ms].  [R]"""
    cameras = [mine.camera for mine in expected]
    for _ in range(WARM_UP):
        _render(renderer, cameras, compared[0])
    exact, _ = _images(renderer, cameras, CONFORMANCE)
    shown = []
    for number, setting in enumerate(compared):  # compiles and allocates, too
        shown.append(_images(renderer, cameras, setting))
        step(0.5 * (number + 1) / len(compared))
    times = _times(renderer, cameras, compared, turns, lambda share: step(0.5 + 0.5 * share))
    errors = [picture_error(images, expected) for images, _ in shown]
    worst = [
        min(
            picture_error([image], [mine]).psnr
            for image, mine in zip(images, expected, strict=True)
        )
        for images, _ in shown
    ]
    anywhere = [largest_difference(images, exact) for images, _ in shown]
    relative = shares(times)
    rows = [
        RenderingRow(
            setting=setting.name,
            family=setting.family,
            psnr=errors[i].psnr,
            worst_psnr=worst[i],
            largest=errors[i].largest,
            largest_anywhere=None if setting.options.conformance else anywhere[i],
            photo_psnr=pictures.photo_psnr(photos, renderer, setting.options) if photos else None,
            frame=spread_of(times[i]),
            relative=spread_of(100.0 * relative[i], Share),
            samples=shown[i][1],
            candidate=setting.candidate,
            default=i == 0,
            chosen=False,
        )
        for i, setting in enumerate(compared)
    ]
    bounded = [-row.worst_psnr if row.candidate and row.within else np.inf for row in rows]
    chosen = cheapest(times, bounded, -BOUND)
    rows = [replace(row, chosen=i == chosen) for i, row in enumerate(rows)]
    return rows, {setting.name: times[i].tolist() for i, setting in enumerate(compared)}


def shares(times, base=0):
    """Times relative to that of setting `base` in the same turn.  [S, R]"""
    times = np.asarray(times, float)
    return times / times[base]


def cheapest(times, errors, bound: float, base=0) -> int | None:
    """The index of the setting that the rule chooses; None if no error is within the bound.

    Args:
        times: In any unit.  [S, R]
        errors: Less is better.  [S]
        base: The setting that the others are compared with.
    """
    errors = np.asarray(errors, float)
    allowed = np.flatnonzero(errors <= bound)
    if not len(allowed):
        return None
    relative = np.median(shares(times, base), axis=1)
    return int(allowed[np.lexsort((errors[allowed], relative[allowed]))[0]])


def _render(renderer, cameras, setting):
    return [renderer.render(camera, setting.options) for camera in cameras]


def _images(renderer, cameras, setting):
    """The colors of all views [P, H, W, 3], and samples per pixel."""
    images = _render(renderer, cameras, setting)
    colors = np.stack([image.color_array()[..., :3] for image in images])
    return colors, sum(image.sample_count for image in images) / colors[..., 0].size


def _times(renderer, cameras, compared, turns, step):
    """Milliseconds per view, for each setting in each turn.  [S, R]"""
    times = np.empty((len(compared), turns))
    rng = np.random.default_rng(0)
    for turn in range(turns):
        for number in rng.permutation(len(compared)):  # no setting always follows the same one
            setting = compared[number]
            if renderer.device.is_cuda:  # it predicts its rounds from the last image
                _render(renderer, cameras[:1], setting)
            taken = milliseconds(lambda s=setting: _render(renderer, cameras, s), renderer.device)
            times[number, turn] = taken / len(cameras)
        step((turn + 1) / turns)
    return times


def _findings(rows, expected, photos):
    default, camera = rows[0], expected[0].camera
    pixels = sum(len(mine.numbers) for mine in expected)
    largest = max(default.largest, default.largest_anywhere)
    found = [
        f"By default a view of {camera.width} × {camera.height} pixels takes"
        f" {default.frame.median:.3g} ms. In {pixels} random pixels it is {default.psnr:.1f} dB"
        f" from the float64 reference, {default.worst_psnr:.1f} dB in the worst view; no pixel"
        f" is more than {largest:.1f}/255 off.",
        _verdict(default, next((row for row in rows if row.chosen), None)),
    ]
    if photos:
        best = max(rows, key=lambda row: row.photo_psnr)
        compared = sum(len(photo.colors) for photo in photos)
        found.append(
            f"Against {compared} random pixels of {len(photos)} test views the model has"
            f" {default.photo_psnr:.2f} dB by default and {best.photo_psnr:.2f} dB at best"
            f" (“{best.setting}”)."
        )
    return found


def _verdict(default, chosen):
    rule_text = (
        f"The rule (the cheapest with at least {BOUND:g} dB in every view and at most"
        f" {LARGEST:g}/255)"
    )
    if chosen is None:
        return f"{rule_text} gives nothing here: no setting of default mode is within its bounds."
    if chosen is default:
        return f"{rule_text} gives the default here."
    time = chosen.relative
    unclear = ", so it may be chance" if time.low <= 100.0 <= time.high else ""
    return (
        f"{rule_text} gives “{chosen.setting}” here, with {time.median:.1f} % of the default's"
        f" time ({time.low:.0f} to {time.high:.0f} from turn to turn{unclear}); the default is what"
        " it gives for the published models together."
    )


def _method(expected, turns, own):
    pixels = sum(len(mine.numbers) for mine in expected)
    few = " So few turns do not tell apart what differs by less than a tenth."
    return [
        f"{len(expected)} views from all around show the object at rest. {pixels} random pixels"
        " are compared with the float64 reference, which tries every ray against every tet and"
        f" ends no ray; with a quarter of its step it differs from itself by {own.psnr:.1f} dB, at"
        f" most {own.largest:.1f}/255. All pixels are compared with conformance mode.",
        f"Times are medians of {turns} turns with the tenth and ninetieth percentile. Each turn"
        " renders all views with every setting once, in another order. The rule compares the times"
        f" over the default's in the same turn.{few if turns < ENOUGH else ''}",
    ]


def plot(rows) -> bytes:
    """Every setting's error over its time."""
    figure = new_figure(8.4, 4.4)
    axis = figure.subplots()
    frame = rows[0].frame
    unit = frame.median / 100.0  # shares of time are drawn in milliseconds
    places = [(unit * row.relative.median, row.psnr) for row in rows]
    for family, color in COLORS.items():
        members = [place for row, place in zip(rows, places, strict=True) if row.family == family]
        if members:
            axis.scatter(*zip(*members, strict=True), s=26, color=color, label=family)
    spread = [[frame.median - frame.low], [frame.high - frame.median]]
    style = {"fmt": "*", "markersize": 14, "color": "black", "label": "default"}
    axis.errorbar(frame.median, rows[0].psnr, xerr=spread, **style)
    for row, place in zip(rows, places, strict=True):
        if row.chosen:
            ring = {"s": 170, "facecolors": "none", "edgecolors": "black"}
            axis.scatter(*place, label="the rule's choice", **ring)
        if not row.default:  # the star names that
            style = {"textcoords": "offset points", "fontsize": 6, "color": INK}
            axis.annotate(row.setting, place, (5, -8), **style)
    axis.axhline(BOUND, color=INK, linewidth=0.8, linestyle="--")
    label(axis, "ms a view", "PSNR to the float64 reference [dB]", log="x")
    figure.legend(fontsize=7, frameon=False, loc="outside right upper")
    return png(figure)
