"""The section on rendering: time and error of an image."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..report.parts import Figure, Section, Table
from ..report.plots import INK, label, new_figure, png
from ..stopwatch import Timing
from .measure import BOUND, LARGEST, SUSPECTS, RenderingStudy, settings
from .pictures import Photograph, discretization

COLORS = {
    "termination": "tab:blue",
    "levels": "tab:green",
    "levels and termination": "tab:olive",
    "precision": "tab:purple",
    "step": "tab:orange",
    "conformance": "tab:gray",
    "mask": "tab:brown",
    "resolution": "tab:red",
    "several": "tab:pink",
}
LABEL_SIZE = (90.0, 12.0)  # pixels, of a point's name
DISCRETIZATION_PIXELS = 500
ENOUGH = 12  # turns that resolve differences of some percent


@dataclass(frozen=True)
class StageRow:
    """A stage of a frame."""

    stage: Annotated[str, "stage"]
    time: Annotated[Timing, "ms"]


def section(
    study: RenderingStudy,
    turns: int,
    photos: list[Photograph] | None = None,
    step: Callable[[float], None] = lambda share: None,
) -> Section:
    """Measure all settings; `step` is called with the finished share."""
    own_error = discretization(study.field, study.pictures, DISCRETIZATION_PIXELS)
    stages = [StageRow(name, time) for name, time in study.stages(turns).items()]
    options = study.field.options
    compared = settings(options.level_count, study.half, options.deferred, study.wavefront)
    rows = study.measure(compared, turns, photos, step)
    default = rows[0]
    stages.append(StageRow("the view, by itself", default.frame))
    pixels = sum(len(picture.pixels) for picture in study.pictures)
    return Section(
        key="rendering",
        title="Rendering: error against time",
        findings=_findings(study, rows, pixels, photos),
        method=_method(study, turns, pixels, own_error),
        tables=[
            Table("rendering", "Settings, each different from the default.", rows),
            Table("stages", _stages_caption(study), stages),
        ],
        figures=[
            Figure(
                "rendering",
                "Error against time: the default's time, times each setting's share of it. Up and "
                "left is better. The line joins the settings that nothing beats in both; dashed: "
                f"{BOUND:g} dB, the bound of default mode. The table names the other points.",
                plot(rows),
            )
        ],
        passed=default.within,
        values={
            "bound": BOUND,
            "largest_bound": LARGEST,
            "reference_psnr": own_error.psnr,
            "reference_largest": own_error.largest,
            "times": study.times,
        },
    )


def _findings(study, rows, pixels, photos):
    default, camera = rows[0], study.pictures[0].camera
    found = [
        f"By default a view of {camera.width} × {camera.height} pixels takes "
        f"{default.frame.median:.3g} ms and is {default.psnr:.1f} dB from the float64 "
        f"reference, {default.worst_psnr:.1f} dB in the worst view, at most "
        f"{default.largest:.1f}/255 off in {pixels} random pixels and the suspects.",
        _verdict(default, next((row for row in rows if row.chosen), None)),
    ]
    if photos:
        known = [row for row in rows if row.photo_psnr is not None]
        best = max(known, key=lambda row: row.photo_psnr)
        compared = sum(len(photo.colors) for photo in photos)
        found.append(
            f"Against {compared} random pixels of {len(photos)} test views the "
            f"model has {default.photo_psnr:.2f} dB by default and {best.photo_psnr:.2f} dB at "
            f"best (“{best.setting}”)."
        )
    return found


def _verdict(default, chosen):
    rule_text = (
        f"The rule (the cheapest with at least {BOUND:g} dB in every view and at most "
        f"{LARGEST:g}/255)"
    )
    if chosen is None:
        return f"{rule_text} gives nothing here: no setting of default mode is within its bounds."
    if chosen is default:
        return f"{rule_text} gives the default here."
    time = chosen.relative
    unclear = ", so it may be chance" if time.low <= 100.0 <= time.high else ""
    return (
        f"{rule_text} gives “{chosen.setting}” here, with {time.median:.1f} % of the default's "
        f"time ({time.low:.0f} to {time.high:.0f} from turn to turn{unclear}) and "
        f"{chosen.worst_psnr:.1f} dB; the default is what the rule gives for the published models "
        "together."
    )


def _stages_caption(study):
    clock = "those of all threads are added up."
    if study.wavefront:
        clock = (
            "by events, on a device that always has the next launch at hand, except for the pose, "
            "which includes its upload; the view by itself waits for the host between views."
        )
    elif study.device.is_cuda:
        clock = "by events; the host waits between rounds."
    return (
        f"Milliseconds of a view in default mode, stage by stage; {clock} The pose, and the search "
        "for overlap, are in the stages alone."
    )


def _method(study, turns, pixels, own_error):
    text = [
        f"{len(study.pictures)} views from all around show the object at rest. {pixels} random "
        "pixels are compared with the float64 reference, which tries every ray against every tet "
        "and ends no ray; with a quarter of its step it differs from itself by "
        f"{own_error.psnr:.1f} dB, at most {own_error.largest:.1f}/255. PSNR is that of the random "
        "pixels. All pixels are compared with conformance mode; the suspects, the "
        f"{SUSPECTS} of each view that differ most, with the reference, too.",
        f"Times are medians of {turns} turns with the tenth and ninetieth percentile. Each turn "
        "renders all views with every setting once, in another order; enlarging is not timed.",
        "The rule takes the cheapest setting of default mode (which may end rays early, leave "
        f"levels out{', use half precision' if study.half else ''}) whose error is within the "
        "bounds. Settings are compared by the median of their time over the default's in the same "
        "turn. Longer steps and fewer pixels are for motion on a CPU; without the mask, density "
        "that was never trained is sampled.",
    ]
    if turns < ENOUGH:
        text[1] += " So few turns do not tell apart what differs by less than a tenth."
    if study.wavefront:
        text.append(
            "On CUDA, default mode runs in rounds that the host does not wait for; float32 and "
            "conformance mode wait, as does “half, waited for”, so that their cost can be compared."
        )
    return text


def plot(rows) -> bytes:
    """Every setting's error over its time, and the front."""
    figure = new_figure(8.4, 4.4)
    axis = figure.subplots()
    unit = rows[0].frame.median / 100.0  # shares of time are drawn in milliseconds
    places = [(unit * row.relative.median, row.psnr) for row in rows]
    front = sorted(place for row, place in zip(rows, places, strict=True) if row.front)
    axis.plot(*zip(*front, strict=True), color=INK, linewidth=0.8, zorder=1)
    for family, color in COLORS.items():
        members = [place for row, place in zip(rows, places, strict=True) if row.family == family]
        if members:
            axis.scatter(*zip(*members, strict=True), s=26, color=color, label=family, zorder=2)
    frame = rows[0].frame
    spread = [[frame.median - frame.low], [frame.high - frame.median]]
    style = {"fmt": "*", "markersize": 14, "color": "black", "label": "default", "zorder": 3}
    axis.errorbar(frame.median, rows[0].psnr, xerr=spread, **style)
    ring = {"s": 170, "facecolors": "none", "edgecolors": "black", "zorder": 3}
    for row, place in zip(rows, places, strict=True):
        if row.chosen:
            axis.scatter(*place, label="the rule's choice", **ring)
    axis.axhline(BOUND, color=INK, linewidth=0.8, linestyle="--")
    label(axis, "ms a view", "PSNR to the float64 reference [dB]", log="x")
    figure.legend(fontsize=7, frameon=False, loc="outside right upper")
    figure.draw_without_rendering()  # where the layout puts the axis
    labeled = []
    for row, place in zip(rows, places, strict=True):
        at = axis.transData.transform(place)
        free = all((np.abs(at - other) > LABEL_SIZE).any() for other in labeled)
        if row.front and not row.default and free:  # the star names the default
            style = {"textcoords": "offset points", "fontsize": 6, "color": INK}
            axis.annotate(row.setting, place, (5, -8), **style)
            labeled.append(at)
    return png(figure)
