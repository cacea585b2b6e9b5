"""The section on training: the error over time, from the history in the model file.

A history's rows (training/run/monitoring.py) give the PSNR of the training rays after so many
seconds and steps.  Any key may be missing: older models keep figures of the end alone, and
fields that were never trained keep nothing.
"""

from dataclasses import dataclass
from typing import Annotated

from ....core.field import TetField
from ..report.parts import Figure, Section, Table
from ..report.plots import label, new_figure, png

COLORS = {1: "#e07a1f", 2: "#2a6f97"}  # of the stages
TEST_COLOR = "#7b2d8b"
TOLD = (10, 50, 100)  # % of the time, in the findings
TITLE = "Training error against time"
METHOD = [
    "A row is the mean error of the rays drawn since the row before, of the weights as they are "
    "then. For images with alpha the background is random in the first half of a stage and white "
    "in the second, so that the curve may jump. The test PSNR is the mean over views held aside, "
    "of the finished model, whose weights are averages. Seconds include compiling kernels, but "
    "not the test views.",
]


@dataclass(frozen=True)
class Moment:
    """A row of the history."""

    seconds: Annotated[float, "time [s]"]  # of the run so far
    share: Annotated[float, "of all [%]"]
    stage: Annotated[int, "stage"]
    step: Annotated[int, "step"]
    psnr: Annotated[float, "PSNR of the training rays [dB]"]  # since the row before


@dataclass(frozen=True)
class StageTime:
    """Seconds and steps of a stage; the time before the first step is the first stage's."""

    stage: int
    seconds: float
    steps: int


def section(field: TetField) -> Section:
    """The section on the training that the model's `meta` describes."""
    meta, moments = field.meta, history(field.meta)
    keys = ("data", "device", "workers", "seconds", "test_psnr", "test_view_count")
    known = {key: meta.get(key) for key in keys} | {"test_psnr": _test_psnr(meta)}
    if not moments:
        said = ["the model keeps no history of its training", _duration(meta), _test(meta)]
        return Section("training", TITLE, [_sentence(said)], values=known)
    stages = stage_times(meta, moments)
    told = {share: _by(moments, share) for share in TOLD}
    gain = told[100].psnr - told[50].psnr if told[50] else None
    known |= {
        "stages": stages,
        "psnr_at_percent": {str(share): row and row.psnr for share, row in told.items()},
        "last_half_gain_db": gain,
    }
    caption = "What was last known after each tenth of the training time."
    tables = [
        Table("training_tenths", caption, tenths(moments)),
        Table("training", "All rows of the history.", moments, first=3),
    ]
    figure = Figure("training", _caption(meta), picture(meta, moments))
    findings = _findings(meta, stages, told, gain)
    return Section("training", TITLE, findings, METHOD, tables, [figure], values=known)


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
    shown = [_by(moments, 10.0 * (i + 1)) for i in range(10)]
    return list(dict.fromkeys(moment for moment in shown if moment))


def stage_times(meta: dict, moments: list[Moment]) -> list[StageTime]:
    """The stages that the history knows."""
    last = {moment.stage: moment for moment in moments}
    total = meta.get("seconds") or moments[-1].seconds
    first = 0.0
    if 1 in last:
        first = meta.get("stage_1_seconds") or (last[1].seconds if 2 in last else total)
    seconds = {1: first, 2: total - first}
    return [StageTime(stage, seconds[stage], moment.step) for stage, moment in last.items()]


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


def _findings(meta, stages, told, gain) -> list[str]:
    places = [
        f"{moment.psnr:.2f} dB after {share} % of the time (stage {moment.stage})"
        for share, moment in told.items()
        if moment
    ]
    course = f"The training rays are at {', '.join(places)}."
    if gain is not None:
        verb = "gained" if gain >= 0.0 else "lost"
        course += f" The last half of the time {verb} {abs(gain):.2f} dB."
    end = f"the training rays end at {told[100].psnr:.2f} dB"
    times = [f"stage {s.stage} took {s.seconds:.1f} s for {s.steps:,} steps" for s in stages]
    findings = [_sentence([_duration(meta), end, _test(meta)]), course, _sentence(times)]
    if meta.get("interrupted"):
        findings.append("The run was interrupted: the history ends there.")
    if meta.get("diverged"):
        findings.append(f"The run ended early: {meta['diverged']}.")
    return findings


def _by(moments, share) -> Moment | None:
    """The last row up to that share [%] of the time."""
    return next((m for m in reversed(moments) if m.share <= share or share >= 100.0), None)


def _test_psnr(meta) -> float | None:
    return (meta.get("test_mean") or {}).get("psnr")


def _duration(meta) -> str:
    where = f" on {meta['device']}" if meta.get("device") else ""
    if (meta.get("workers") or 1) > 1:
        where += f", {meta['workers']} of them"
    return f"training took {meta['seconds']:.1f} s{where}" if meta.get("seconds") else ""


def _test(meta) -> str:
    psnr, count = _test_psnr(meta), meta.get("test_view_count")
    views = f"the {count} test views" if count else "the test views"
    return f"{views} are at {psnr:.2f} dB" if psnr is not None else ""


def _sentence(parts: list[str]) -> str:
    """One sentence from the known facts."""
    words = "; ".join(filter(None, parts))
    return f"{words[0].upper()}{words[1:]}." if words else ""


def _caption(meta) -> str:
    known = [f"on {meta['data']}"] if meta.get("data") else []
    known += [meta["device"]] if meta.get("device") else []
    caption = f"PSNR of the training rays over the seconds of training {', '.join(known)}".strip()
    if _test_psnr(meta) is None:
        return f"{caption}."
    return f"{caption}. Diamond and dashed line: the test views' mean at the end."
