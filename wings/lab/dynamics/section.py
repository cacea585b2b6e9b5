"""The section on dynamics: time and error of a frame on the model's own mesh."""

from collections.abc import Callable
from dataclasses import replace

from ....core.deform import TIME_STEP
from ....core.geometry import TetMesh
from ..report.contents import Figure, Section, Table
from ..report.plots import INK, label, new_figure, png
from . import measure as study
from .measure import BOUND, DEFAULT_COUNT, SCENES, load_cases, measure

TITLE = "Dynamics: error against time"
FRAME_MS = 1e3 * TIME_STEP
COUNTS = (1, 2, 5, 10, 15, 20, 25, 30, 40, 50, 100, 200)
QUICK_COUNTS = (5, 10, 20, 30, 40)
QUICK_SETTLING = 600  # frames: some of a stiff body's slowest way is left
STYLES = {"static": "-", "dynamic": "--"}


def section(
    mesh: TetMesh, device, quick: bool = False, step: Callable[[float], None] = lambda share: None
) -> Section:
    """Measure both scenes; `step` is called with the finished share."""
    try:
        cases = load_cases(study.standing(mesh))
        exact = [case.reference[1] for case in cases]
    except RuntimeError as error:
        return Section("dynamics", TITLE, [f"There is no reference for this mesh: {error}."])
    counts = sorted({*(QUICK_COUNTS if quick else COUNTS), DEFAULT_COUNT})
    runs = [(case, count) for case in cases for count in counts]
    settling = QUICK_SETTLING if quick else study.SETTLING_FRAMES
    rows = []
    for case, count in runs:
        rows.append(measure(case, count, device, settling))
        step(len(rows) / len(runs))
    chosen = chosen_count(rows)
    rows = [replace(row, chosen=row.count == chosen) for row in rows]
    caption = (
        "Error over the milliseconds a frame takes, for more and more substeps; the star is the"
        " default, the ring the rule's."
    )
    return Section(
        key="dynamics",
        title=TITLE,
        findings=_findings(rows, chosen),
        method=_method(mesh, cases[0].gravity[0], exact, quick),
        tables=[Table("dynamics", "Errors of the solver, with the default material.", rows)],
        figures=[Figure("dynamics", caption, plot(rows))],
        values={"bound": BOUND, "recommended_substeps": chosen},
    )


def chosen_count(rows) -> int | None:
    """The rule's number of substeps: the least within the bound, as each costs the same."""
    worst = {}
    for row in rows:
        worst[row.count] = max(row.of_motion, worst.get(row.count, 0.0))
    held = [count for count, error in worst.items() if error <= 100.0 * BOUND]
    return min(held, default=None)


def _findings(rows, chosen):
    static, dynamic = (next(r for r in rows if r.default and r.scene == s) for s in SCENES)
    said = [
        f"By default ({DEFAULT_COUNT} substeps) a frame takes {static.frame.median:.3g} ms; under "
        f"load the pose is off by {static.of_motion:.2g} % of its motion ({static.of_size:.2g} % "
        f"of the size), in motion by {dynamic.of_motion:.2g} %."
    ]
    if chosen is None:
        return [*said, "No number of substeps that was tried is within the bound."]
    row = next(r for r in rows if r.chosen and r.scene == "static")
    share = 100.0 * row.frame.median / FRAME_MS
    said.append(
        f"Of the numbers tried, the default material needs {chosen} substeps here (error at most "
        f"{100 * BOUND:g} % of the motion): {row.frame.median:.3g} ms, {share:.2g} % of a "
        "frame at 60 Hz."
    )
    return said


def _method(mesh, gravity, exact, quick):
    return [
        f"The mesh has {mesh.tet_count} tets. Its foot is held, and a sideways gravity of "
        f"{gravity:.2g} m/s² pushes it, so that a linear body moves by {100 * study.PUSH:g} % of "
        "its size. Static: until it is still, against Newton's method in float64 (forces left: "
        f"{exact[0]:.0e} of the load). Dynamic: {study.MOTION_FRAMES} frames from rest, undamped, "
        f"against Verlet in float64 (its own error: {100 * exact[1]:.1g} % of the motion). "
        "Error: RMS over vertices and frames, over the reference's RMS motion, and over the "
        "object's size."
        + (" Static scenes end after 10 s even if they still move." if quick else ""),
        "The rule takes the least number of substeps whose error is at most "
        f"{100 * BOUND:g} % of the motion in both scenes.",
    ]


def plot(rows) -> bytes:
    """Errors over milliseconds."""
    figure = new_figure(7.0, 4.0)
    axis = figure.subplots()
    for scene, style in STYLES.items():
        mine = [row for row in rows if row.scene == scene]
        times, errors = [r.frame.median for r in mine], [r.of_motion for r in mine]
        axis.plot(times, errors, style, label=scene, marker="o", markersize=3, linewidth=1.1)
    for row in rows:
        if row.default:
            axis.plot(row.frame.median, row.of_motion, "*", color="black", markersize=12)
        if row.chosen:
            ring = {"markersize": 13, "markerfacecolor": "none", "color": "black"}
            axis.plot(row.frame.median, row.of_motion, "o", **ring)
    axis.axhline(100.0 * BOUND, color=INK, linewidth=0.8, linestyle="--")
    label(axis, "ms a frame", "RMS error [% of the motion]", log="xy")
    axis.legend(fontsize=7, frameon=False)
    return png(figure)
