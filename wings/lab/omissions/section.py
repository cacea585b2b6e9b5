"""The section on what is left out for a model on a device, and what that saves.

If an omission saves nothing or costs time, the text gives the reason for it.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ....core.deform import XpbdOptions
from ....core.field import TetField
from ..effort import Effort
from ..report.contents import Figure, Section, Table
from ..report.plots import INK, label, new_figure, png
from .frames import frame_switches
from .starts import start_switches
from .steps import step_switches
from .switch import COSTS, ENOUGH_TURNS, NONE, NOT_MEASURED, NOTHING, SAVES, Omission, measured

COLORS = {SAVES: "#4477aa", NOTHING: "#999999", COSTS: "#cc3311"}
DRAWN = -100.0, 200.0  # %: a bar that is longer is cut off


def section(
    field: TetField,
    model_path,
    device: str,
    effort: Effort,
    step: Callable[[float], None] = lambda share: None,
) -> Section:
    """Measure all switches; `step` is called with the finished share."""
    path = Path(model_path).absolute()  # so that errors can be said without folders
    switches = [
        *frame_switches(field, device, effort),
        *step_switches(field, device, effort.step_turns),
        *start_switches(path, device, effort.start_turns),
    ]
    rows = []
    for switch in switches:
        rows.append(measured(switch))
        step(len(rows) / len(switches))
    return section_of(rows, effort)


def section_of(rows: list[Omission], effort: Effort) -> Section:
    """The report's section of these rows, in their order."""
    known = [row for row in rows if row.verdict != NOT_MEASURED]
    figure_caption = (
        "What leaving it out saves, in percent of the frame, the solver's step, the file or the"
        " start, with the tenth and ninetieth percentile of the turns."
    )
    caption = (
        "What is left out: with it and without it, the median and in brackets the tenth and"
        " ninetieth percentile. Saving: the difference from turn to turn."
    )
    return Section(
        key="left_out",
        title="Left out",
        findings=[_summary(known), *filter(None, map(_finding, rows))],
        method=_method(effort),
        tables=[Table("left_out", caption, rows)],
        figures=[Figure("left_out", figure_caption, _bars(known))] if known else [],
    )


def _summary(known) -> str:
    count = {v: sum(row.verdict == v for row in known) for v in (SAVES, NOTHING, COSTS)}
    same = sum(row.change == NONE for row in known)
    return (
        f"Of {len(known)} things that are left out, {count[SAVES]} save something that can be"
        f" measured, {count[NOTHING]} nothing, and {count[COSTS]} cost something; {same} change"
        " nothing in the result, bit by bit."
    )


def _finding(row: Omission) -> str | None:
    """The finding of a row as text; None if the table is enough."""
    if row.verdict == NOT_MEASURED:
        return f"Not measured: {row.name}. {row.why}"
    if row.verdict == SAVES:
        return None
    effect = f"costs {-row.saving.median:.3g} {row.unit}"
    if row.verdict == NOTHING:
        sides = f"with it {_range(row.with_it)}, without {_range(row.without)} {row.unit}"
        effect = f"saves nothing that can be measured ({sides})"
    return f"Leaving out {row.name} {effect}. Why is it left out? {row.why}"


def _range(spread) -> str:
    return f"{spread.low:.3g} to {spread.high:.3g}"


def _method(effort) -> list[str]:
    return [
        "Each row switches one thing on and nothing else; both sides take turns. The saving is the"
        " median difference from turn to turn, and nothing measurable if it changes its sign, or if"
        f" both sides overlap in fewer than {ENOUGH_TURNS} turns.",
        f"Rendering: {effort.frame_turns} turns at {effort.frame_size}×{effort.frame_size} pixels,"
        f" {effort.view_count} views, the object at rest, over white; images are compared in"
        f" bytes. Dynamics: {effort.step_turns} turns of 1/60 s with"
        f" {XpbdOptions().substep_count} substeps, the default material, the lowest vertices"
        " pinned, the highest dragged from side to side; poses are compared in object sizes.",
        f"Start: {effort.start_turns} turns of fresh interpreters that load the model and render"
        " one small image, after a turn that doesn't count; memory is the peak of a process.",
    ]


def _bars(rows) -> bytes:
    figure = new_figure(9.0, 1.2 + 0.29 * len(rows))
    axes = figure.add_subplot()
    for place, row in enumerate(rows):
        saved = row.percent
        low, median, high = np.clip([saved.low, saved.median, saved.high], *DRAWN)
        axes.barh(place, median, height=0.68, color=COLORS[row.verdict])
        axes.plot([low, high], [place, place], color=INK, linewidth=1.1)
        saved_text = f"{row.saving.median:.3g} {row.unit}"
        style = {"textcoords": "offset points", "va": "center", "fontsize": 8, "color": INK}
        axes.annotate(saved_text, (max(high, 0.0), place), (4, 0), **style)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(rows)), [row.name for row in rows], fontsize=8)
    axes.invert_yaxis()
    axes.margins(x=0.09, y=0.01)
    label(axes, "saved, % of the whole", grid="x")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False)
    return png(figure)
