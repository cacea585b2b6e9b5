"""Section 1: what a picture costs, and how wrong it is."""

from collections.abc import Callable
from dataclasses import dataclass

from ..report import INK, Figure, Section, Table, label_points, log_scale, new_figure, png
from ..stopwatch import Timing
from . import measure as study
from .photographs import Photographs

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
ENOUGH = 12  # turns to tell settings apart that differ by some percent
FEW = (
    " So few turns don't tell apart what differs by less than a tenth: neither which of these is "
    "the rule's nor which is on the front."
)
HEADINGS = {
    "setting": "setting",
    "psnr": "PSNR [dB]",
    "worst_psnr": "worst view [dB]",
    "largest": "largest [1/255]",
    "largest_anywhere": "all pixels, from conformance [1/255]",
    "photo_psnr": "photographs [dB]",
    "frame": "ms a view",
    "relative": "of the default's [%]",
    "samples": "samples a pixel",
    "front": "on the front",
    "chosen": "the rule's",
}


def section(
    rendering: study.RenderingStudy,
    turns: int,
    photos: Photographs | None = None,
    step: Callable[[float], None] = lambda share: None,
) -> Section:
    """Measure and tell; `step` is called with the share that is done."""
    level_count = rendering.field.layout.level_count
    own_error = rendering.reference_error()
    stages = rendering.stages(turns)
    compared = study.settings(level_count, rendering.half)
    rows = rendering.measure(compared, turns, photos, step)
    default, chosen = rows[0], next((row for row in rows if row.chosen), None)
    camera = rendering.pictures[0].camera
    pixels = sum(len(picture.pixels) for picture in rendering.pictures)
    headings = {k: v for k, v in HEADINGS.items() if photos is not None or k != "photo_psnr"}
    return Section(
        key="rendering",
        title="Rendering: error against time",
        findings=[
            f"By default a view of {camera.width} × {camera.height} pixels takes "
            f"{default.frame.median:.3g} ms and is {default.psnr:.1f} dB from the float64 "
            f"reference, {default.worst_psnr:.1f} dB in the worst view, at most "
            f"{default.largest:.1f}/255 off in {pixels} random pixels and those most suspicious.",
            _verdict(default, chosen),
            *_photo_finding(rows, photos),
        ],
        method=[
            f"{len(rendering.pictures)} views from all around, the object as large as the image, "
            f"at rest; {pixels} random pixels of them against the float64 reference, which tries "
            "every ray against every tet and ends no ray. Its own error: with a quarter of the "
            f"step it differs from itself by {own_error.psnr:.1f} dB, at most "
            f"{own_error.largest:.1f}/255. PSNR is that of the random pixels. These miss single "
            "ones that sparkle: all pixels are compared with conformance mode, and those that "
            f"differ most, {study.SUSPECTS} of each view and setting that default mode may use, "
            "with the reference, too; “largest” is the worst of both kinds. A shorter step is "
            "closer to the integral and so farther from the reference, whose step is the model's.",
            f"Times are medians of {turns} turns with the tenth and ninetieth percentile; each "
            "turn renders every setting once, all views, in another order. They are those of "
            "rendering alone: what enlarges an image of fewer pixels is OpenGL."
            + (FEW if turns < ENOUGH else ""),
            "The rule: of what default mode may do (end rays early, leave levels out"
            f"{', use half precision' if rendering.half else ''}) the cheapest that has at least "
            f"{study.BOUND:g} dB in every view and no pixel more than {study.LARGEST:g}/255 off, "
            "from conformance mode and, where it was asked, from the reference. What is cheapest, "
            "and what nothing beats, goes by the median of a setting's time over the default's in "
            "the same turn, which a change of the machine's pace does not move. The step belongs "
            "to the model; fewer pixels and longer steps are for pictures that move on a CPU. "
            "Without a mask, density that was never trained is sampled too, and the tets that hold "
            "nothing are walked through.",
            *_cuda_method(rendering),
        ],
        tables=[
            Table("rendering", "Settings, each different from the default.", headings, rows),
            Table(
                "stages",
                "Milliseconds of a view in default mode, stage by stage; "
                f"{_stage_clock(rendering)} The pose, and the search whether it overlaps, are in "
                "the stages alone.",
                {"stage": "stage", "time": "ms"},
                [
                    *(StageRow(name, time) for name, time in stages.items()),
                    StageRow("the view, by itself", default.frame),
                ],
            ),
        ],
        figures=[
            Figure(
                "rendering",
                "Error against time, that of the default times each setting's share of it; up and "
                "left is better. The line joins what nothing beats in both; dashed: "
                f"{study.BOUND:g} dB, the bound of default mode. Points without room for a name "
                "stand in the table.",
                plot(rows),
            )
        ],
        passed=study.within(default),
        values={
            "bound": study.BOUND,
            "largest_bound": study.LARGEST,
            "reference_psnr": own_error.psnr,
            "reference_largest": own_error.largest,
            "times": rendering.times,
        },
    )


@dataclass(frozen=True)
class StageRow:
    """A stage of a frame."""

    stage: str
    time: Timing


def _cuda_method(rendering):
    if not rendering.half:
        return []
    return [
        "On CUDA default mode runs in rounds that nothing waits for. Rows in float32, "
        "conformance too, are rendered another way, in rounds that the host waits for: what they "
        "cost beyond “half, waited for”, which is rendered in that way too, is float32's."
    ]


def _stage_clock(rendering):
    if rendering.half:
        return (
            "by events, on a device that always has the next launch at hand, but for the pose, "
            "which is with its upload; the view by itself waits for the host between views."
        )
    if rendering.device.is_cuda:
        return "by events; the host waits between rounds."
    return "those of all threads are added up."


def _verdict(default, chosen):
    rule_text = (
        f"The rule (the cheapest with at least {study.BOUND:g} dB in every view and at most "
        f"{study.LARGEST:g}/255)"
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
        f"{chosen.worst_psnr:.1f} dB; the default is what it gives for the published models "
        "together."
    )


def _photo_finding(rows, photos):
    if photos is None:
        return []
    best = max((row for row in rows if row.photo_psnr is not None), key=lambda r: r.photo_psnr)
    return [
        f"Against {len(photos.colors)} random pixels of {photos.view_count} test views the model "
        f"has {rows[0].photo_psnr:.2f} dB by default and {best.photo_psnr:.2f} dB at best "
        f"(“{best.setting}”)."
    ]


def plot(rows) -> bytes:
    """Every setting's error over its time, and the front."""
    figure = new_figure(8.4, 4.4)
    axis = figure.subplots()
    unit = rows[0].frame.median / 100.0  # of time, shares are drawn in milliseconds
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
    axis.axhline(study.BOUND, color=INK, linewidth=0.8, linestyle="--")
    log_scale(axis.xaxis)
    axis.set_xlabel("ms a view")
    axis.set_ylabel("PSNR to the float64 reference [dB]")
    axis.grid(True, which="major", linewidth=0.4)
    figure.legend(fontsize=7, frameon=False, loc="outside right upper")
    first = sorted(range(len(rows)), key=lambda i: not rows[i].front)
    names = ["" if rows[i].default else rows[i].setting for i in first]  # the star says so
    label_points(axis, names, [places[i] for i in first])
    return png(figure)
