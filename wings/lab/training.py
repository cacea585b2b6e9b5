"""The section on training: the error over time, from the history in the model file.

A history's rows (training/run/monitoring.py) give the PSNR of the training rays after so many
seconds and steps.  Any key may be missing: older models keep figures of the end alone, and
fields that were never trained keep nothing.
"""

from dataclasses import dataclass
from typing import Annotated

from ...core.field import TetField
from ...core.training import angles_told
from .report.contents import Figure, Section, Table
from .report.plots import label, new_figure, png

COLORS = {1: "#e07a1f", 2: "#2a6f97"}  # of the stages
TEST_COLOR = "#7b2d8b"
PARTS = {  # of the scores beside a sector that was held out
    "held_out": "training views of the sector, held out",
    "test_inside": "test views in the sector",
    "test_outside": "test views elsewhere",
}
TRIED = {"depth_gain": "a cost of depth", "decay_gain": "strong decay"}  # for stage 2
TITLE = "Training error against time"
METHOD = [
    "A row is the mean error of the rays drawn since the row before, of the weights as they are "
    "then. For images with alpha the background is random in the first half of a stage and white "
    "in the second, so that the curve may jump. The test PSNR is the mean over views held aside, "
    "of the finished model, whose weights are averages. Seconds include compiling kernels, but "
    "not the test views.",
]
HELD_OUT_METHOD = (
    "Test views lie between training views, so that their score tells how well gaps are filled in. "
    "All training views of one sector of 60° around the object were held out, so that theirs tells "
    "how well the model shows a side that no training view shows. The angle is that between a view "
    "and the nearest training view, seen from the point that the training views look at."
)


@dataclass(frozen=True)
class Moment:
    """A row of the history."""

    seconds: Annotated[float, "time [s]"]  # of the run so far
    share: Annotated[float, "of all [%]"]
    stage: Annotated[int, "stage"]
    step: Annotated[int, "step"]
    psnr: Annotated[float, "PSNR of the training rays [dB]"]  # since the row before


@dataclass(frozen=True)
class Scored:
    """Views that the model was not trained on."""

    which: Annotated[str, "views"]
    count: Annotated[int, "number"]
    psnr: Annotated[float | None, "PSNR [dB]"]
    ssim: Annotated[float | None, "SSIM"]
    angle: Annotated[float | None, "angle to the nearest training view, median [°]"]
    largest: Annotated[float | None, "largest [°]"]


def section(field: TetField) -> Section:
    """The section on the training that the model's `meta` describes."""
    meta = field.meta
    moments = history(meta)
    keys = ("data", "device", "workers", "seconds", "test_view_count")
    known = {key: meta.get(key) for key in keys} | {"test_psnr": _test_psnr(meta)}
    scored = held_out(meta)
    tables = []
    if scored:
        caption = "What the model was not trained on, and how far that is from what it was."
        tables.append(Table("held_out", caption, scored))
    if not moments:
        said = ["the model keeps no history of its training", _duration(meta), _test(meta)]
        findings = [_sentence(said), *_sector(scored)]
        return Section("training", TITLE, findings, tables=tables, values=known)
    end = f"the training rays end at {moments[-1].psnr:.2f} dB"
    findings = [_sentence([_duration(meta), end, _test(meta)]), _stages(meta, moments)]
    for key, name in TRIED.items():
        if (gain := meta.get(key)) is not None:
            choice = "with" if gain > 0.0 else "without"
            said = f"stage 2 began {choice} {name}, which gave {gain:+.2f} dB in a trial"
            findings.append(_sentence([said]))
    if out := meta.get("levels_left_out"):
        findings.append(f"Finest levels left out, because no image shows them: {out}.")
    findings += _sector(scored)
    if meta.get("interrupted"):
        findings.append("The run was interrupted: the history ends there.")
    if meta.get("diverged"):
        findings.append(f"The run ended early: {meta['diverged']}.")
    caption = "What was last known after each tenth of the training time."
    figure_caption = "PSNR of the training rays over the seconds of training"
    if _test_psnr(meta) is not None:
        figure_caption += "; diamond and dashed line: the test views' mean at the end"
    return Section(
        key="training",
        title=TITLE,
        findings=findings,
        method=[*METHOD, HELD_OUT_METHOD] if scored else METHOD,
        tables=[*tables, Table("training", caption, tenths(moments))],
        figures=[Figure("training", f"{figure_caption}.", picture(meta, moments))],
        values=known | {"history": moments},
    )


def held_out(meta: dict) -> list[Scored]:
    """Scores beside a sector that training held out; none if it held none out."""
    scores = meta.get("sector_scores") or {}
    rows = []
    for word, which in PARTS.items():
        if not (part := scores.get(word)) or not part["view_count"]:
            continue
        mean, angles = part["mean"], part["angles"] or {}
        figures = mean.get("psnr"), mean.get("ssim"), angles.get("median"), angles.get("largest")
        rows.append(Scored(which, part["view_count"], *figures))
    return rows


def history(meta: dict) -> list[Moment]:
    """The rows of a model's history, none where there is none."""
    rows = meta.get("history") or []
    total = rows and (meta.get("seconds") or rows[-1]["seconds"])
    return [
        Moment(r["seconds"], 100.0 * r["seconds"] / total, r["stage"], r["step"], r["psnr"])
        for r in rows
    ]


def tenths(moments: list[Moment]) -> list[Moment]:
    """The last row of each tenth of the time that has one, and the last of all."""
    found = [[m for m in moments if m.share <= 10.0 * (i + 1)] for i in range(9)]
    return list(dict.fromkeys([*(rows[-1] for rows in found if rows), moments[-1]]))


def picture(meta: dict, moments: list[Moment]) -> bytes:
    """PSNR over seconds, a PNG."""
    figure = new_figure(8.0, 3.6)
    axes = figure.add_subplot()
    for stage in sorted({moment.stage for moment in moments}):
        mine = [moment for moment in moments if moment.stage == stage]
        style = {"color": COLORS[stage], "label": f"stage {stage}, training rays"}
        axes.plot([m.seconds for m in mine], [m.psnr for m in mine], ".-", markersize=4, **style)
    end, psnr = meta.get("seconds") or moments[-1].seconds, _test_psnr(meta)
    if psnr is not None:
        axes.axhline(psnr, color=TEST_COLOR, linestyle="--", linewidth=1.0)
        axes.plot([end], [psnr], "D", color=TEST_COLOR, label=f"test views, {psnr:.2f} dB")
    axes.set_xlim(0.0, 1.02 * end)
    label(axes, "seconds of training", "PSNR [dB]")
    axes.legend(loc="lower right", frameon=False)
    return png(figure)


def _test_psnr(meta) -> float | None:
    return (meta.get("test_mean") or {}).get("psnr")


def _stages(meta, moments) -> str:
    """The steps and seconds of each stage; the time before the first step is the first stage's."""
    last = {moment.stage: moment for moment in moments}
    total = meta.get("seconds") or moments[-1].seconds
    first = 0.0
    if 1 in last:
        first = meta.get("stage_1_seconds") or (last[1].seconds if 2 in last else total)
    seconds = {1: first, 2: total - first}
    return _sentence(
        [
            f"stage {stage} took {seconds[stage]:.1f} s for {moment.step:,} steps"
            for stage, moment in last.items()
        ]
    )


def _duration(meta) -> str:
    where = f" on {meta['device']}" if meta.get("device") else ""
    if (meta.get("workers") or 1) > 1:
        where += f", {meta['workers']} of them"
    return f"training took {meta['seconds']:.1f} s{where}" if meta.get("seconds") else ""


def _test(meta) -> str:
    psnr, count = _test_psnr(meta), meta.get("test_view_count")
    views = f"the {count} test views" if count else "the test views"
    return f"{views} are at {psnr:.2f} dB{_angles(meta)}" if psnr is not None else ""


def _angles(meta) -> str:
    told = angles_told(meta.get("test_angles"))
    return told and f", {told}"


def _sector(scored: list[Scored]) -> list[str]:
    """The finding about a sector that was held out, if one was."""
    known = [row for row in scored if row.psnr is not None]
    return [_sentence([f"{row.which}: {row.psnr:.2f} dB" for row in known])] if known else []


def _sentence(facts: list[str]) -> str:
    """One sentence from the known facts."""
    words = "; ".join(filter(None, facts))
    return f"{words[0].upper()}{words[1:]}." if words else ""
