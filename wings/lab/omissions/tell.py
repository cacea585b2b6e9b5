"""The section on omissions for a model on a device, and their savings.

If an omission saves nothing or costs time, the text gives the reason for it.
"""

from collections.abc import Callable
from pathlib import Path

from ....core.deform import XpbdOptions
from ....core.field import TetField
from ..effort import Effort
from ..report.parts import Figure, Section, Table
from ..report.plots import INK, label, new_figure, png
from .files import file_rows
from .frames import Frames, frame_switches
from .measure import (
    COSTS,
    DYNAMICS,
    ENOUGH_TURNS,
    FILE,
    NONE,
    NOT_MEASURED,
    NOTHING,
    RENDERING,
    SAVES,
    START,
    Bench,
    Omission,
    Part,
)
from .starts import import_rows, kernel_row
from .steps import change, step_switches

COLORS = {SAVES: "#4477aa", NOTHING: "#999999", COSTS: "#cc3311"}
ALL_OF_IT = 0.05  # below this share of the time remaining, the part was skipped entirely
LEAST_PERCENT = -100.0  # a bar of a larger loss is cut off


def section(
    field: TetField,
    model_path,
    device: str,
    effort: Effort,
    step: Callable[[float], None] = lambda share: None,
) -> Section:
    """Measure all parts; `step` is called with the finished share."""
    planned, rows, done = parts(field, model_path, device, effort), [], 0.0
    whole = sum(part.seconds for part in planned)
    for part in planned:
        rows += part.run()
        done += part.seconds
        step(done / whole)
    return section_of(rows, effort)


def parts(field: TetField, model_path, device: str, effort: Effort) -> list[Part]:
    """All parts of a field and its file, in order; nothing is measured before they run."""
    frames = Frames(field, device, effort.frame_size, effort.view_count)
    rendering = Bench(RENDERING, device, effort.frame_turns, 6.0, frames.change)
    dynamics = Bench(DYNAMICS, device, effort.step_turns, 1.2, change)
    path = Path(model_path).absolute()  # so that errors can be said without folders
    turns, compilations = effort.start_turns, effort.compilations
    others, kernels = "starts with what others import", "kernels of another device"
    return [
        *(switch.part(rendering) for switch in frame_switches(frames)),
        *(switch.part(dynamics) for switch in step_switches(field, device)),
        Part("the model file", FILE, 1.5, lambda: file_rows(frames, path)),
        Part(others, START, 16.0, lambda: import_rows(path, device, turns)),
        Part(kernels, START, 15.0, lambda: [kernel_row(device, compilations)]),
    ]


def section_of(rows: list[Omission], effort: Effort) -> Section:
    """The report's section of these rows, in their order."""
    measured = [row for row in rows if row.verdict != NOT_MEASURED]
    figure_caption = (
        "What leaving out each part saves, in percent of the frame, the solver's step, the file or"
        " the start that it is a part of, with the tenth and ninetieth percentile of the turns."
        " Hollow bars: what is kept, though it could be left out."
    )
    caption = (
        "What is left out, or could be: with it and without it, the median and in brackets the"
        " tenth and ninetieth percentile. Saving: the difference from turn to turn."
    )
    return Section(
        key="left_out",
        title="Left out",
        findings=[_summary(measured), *filter(None, map(_finding, rows))],
        method=_method(effort),
        tables=[Table("left_out", caption, rows)],
        figures=[Figure("left_out", figure_caption, _bars(measured))] if measured else [],
    )


def _summary(measured) -> str:
    left_out = [row for row in measured if row.left_out]
    count = {v: sum(row.verdict == v for row in left_out) for v in (SAVES, NOTHING, COSTS)}
    same = sum(row.change == NONE for row in left_out)
    summary = (
        f"Of {len(left_out)} rows of what is left out, {count[SAVES]} save something that can be"
        f" measured, {count[NOTHING]} nothing, and {count[COSTS]} cost something; {same} change"
        " nothing in the result, bit by bit."
    )
    parts = [
        row
        for row in left_out
        if row.verdict == SAVES and row.without.median > ALL_OF_IT * row.with_it.median
    ]
    if parts:
        most = max(parts, key=lambda row: row.percent.median)
        summary += (
            f" Besides what is left out whole, the largest part is {most.name},"
            f" {most.percent.median:.0f} % ({_amount(most)})."
        )
    return summary


def _finding(row: Omission) -> str | None:
    """The finding of a row as text; None if the table is enough."""
    if row.verdict == NOT_MEASURED:
        return f"Not measured: {row.name}. {row.why}"
    if not row.left_out:
        change = f"changes the result: {row.change}"
        if row.change == NONE:
            change = "changes nothing, bit by bit"
        return f"Not left out: {row.name}. Leaving that out {_effect(row)} and {change}. {row.why}"
    if row.verdict == SAVES:
        return None
    return f"Leaving out {row.name} {_effect(row)}. Why is it left out? {row.why}"


def _effect(row) -> str:
    if row.verdict == COSTS:
        return f"costs {-row.saving.median:.3g} {row.unit}"
    if row.verdict == SAVES:
        return f"saves {_amount(row)}"
    spread = _amount(row)
    if row.saving.count > 1:
        spread = f"{_range(row.saving)} {row.unit}"
    if row.saving.count > 1 and not row.saving.low <= 0.0 <= row.saving.high:
        ways = f"with it {_range(row.with_it)}, without {_range(row.without)} {row.unit}"
        spread = f"{row.saving.count} turns: {ways}"
    return f"saves nothing that can be measured ({spread})"


def _range(timing) -> str:
    return f"{timing.low:.3g} to {timing.high:.3g}"


def _amount(row) -> str:
    return f"{row.saving.median:.3g} {row.unit}"


def _method(effort) -> list[str]:
    return [
        "Each row switches one thing on and nothing else; both ways take turns. The saving is the"
        " median difference from turn to turn. It is nothing measurable where its tenth and"
        f" ninetieth percentile lie on both sides of 0, or where, with fewer than {ENOUGH_TURNS}"
        " turns, the times of both ways overlap.",
        f"Rendering: {effort.frame_turns} turns at {effort.frame_size}×{effort.frame_size} pixels,"
        f" {effort.view_count} views, the object at rest, over white; images are compared in"
        f" bytes. Dynamics: {effort.step_turns} turns of 1/60 s with"
        f" {XpbdOptions().substep_count} substeps, the default material, the lowest part pinned,"
        " the highest vertices dragged from side to side; poses are compared in object sizes.",
        f"Start: {effort.start_turns} turns of fresh interpreters that load the model and render"
        " one small image, after a turn that doesn't count; memory is the peak of a process."
        f" Kernels: compiled into an empty folder, repeats: {effort.compilations}.",
    ]


def _bars(rows) -> bytes:
    figure = new_figure(9.0, 1.2 + 0.29 * len(rows))
    axes = figure.add_subplot()
    for place, row in enumerate(rows):
        saved = row.percent
        low, median, high = (max(x, LEAST_PERCENT) for x in (saved.low, saved.median, saved.high))
        color = COLORS[row.verdict]
        style = {"color": color if row.left_out else "white", "edgecolor": color}
        axes.barh(place, median, height=0.68, linewidth=1.2, **style)
        axes.plot([low, high], [place, place], color=INK, linewidth=1.1)
        style = {"textcoords": "offset points", "va": "center", "fontsize": 8, "color": INK}
        axes.annotate(_amount(row), (max(high, 0.0), place), (4, 0), **style)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(rows)), [row.name for row in rows], fontsize=8)
    axes.invert_yaxis()
    axes.margins(x=0.09, y=0.01)
    label(axes, "saved, % of what it is a part of", grid="x")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False)
    return png(figure)
