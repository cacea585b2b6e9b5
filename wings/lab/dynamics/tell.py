"""The section on dynamics: time and error of a frame on the model's own mesh."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

from ....core.deform import PRESETS, TIME_STEP, Material
from ....core.geometry import TetMesh
from ..report.parts import Figure, Section, Table
from ..report.plots import INK, label, new_figure, png
from ..stopwatch import Timing
from . import measure as study
from .measure import BOUND, DEFAULT_COUNT, SCENES, Body, load_cases, measure
from .references import NoEquilibrium

TITLE = "Dynamics: error against time"
FRAME_MS = 1e3 * TIME_STEP
MOST_SUBSTEPS = 200
MORE = 1.1  # times as many substeps, where a guess was too few
COUNTS = (1, 2, 5, 10, 15, 20, 25, 30, 40, 50, 100, 200)
QUICK_COUNTS = (5, 10, 20, 30, 40)
COMPLIANCES = {0.0: SCENES, 1e-8: SCENES[:1], 1e-6: SCENES[:1], 1e-4: SCENES}
QUICK_SETTLING = 600  # frames: some of a stiff body's slowest way is left
STYLES = {"static": "-", "dynamic": "--"}


@dataclass(frozen=True)
class MaterialRow:
    """The number of substeps that hold a material; a guess if its error was not measured."""

    material: Annotated[str, "material"]
    young_modulus: Annotated[float, "E [Pa]"]
    substeps: Annotated[int, "substeps"]
    measured: Annotated[bool, "measured"]
    of_motion: Annotated[float | None, "under load [% of the motion]"]
    in_motion: Annotated[float | None, "in motion [% of it]"]
    frame: Annotated[Timing | None, "ms a frame"]
    default: bool


def section(
    mesh: TetMesh, device, quick: bool = False, step: Callable[[float], None] = lambda share: None
) -> Section:
    """Measure all cases; `step` is called with the finished share."""
    body = study.standing(mesh)
    try:
        of_material = load_cases(body)
        exact = [case.reference[1] for case in of_material]
    except RuntimeError as error:
        return Section("dynamics", TITLE, [f"There is no reference for this mesh: {error}."])
    runs = plan(of_material, quick)
    settling = QUICK_SETTLING if quick else study.SETTLING_FRAMES
    whole = sum(1 + count for _, count in runs)
    done, rows, lost = 0, [], {}
    for case, count in runs:
        try:
            rows.append(measure(case, count, device, settling))
        except NoEquilibrium:
            words = f"No reference was found for compliance {case.compliance:g}."
            lost[words] = None
        done += 1 + count
        step(0.9 * done / whole)
    chosen = chosen_count(rows)
    rows = [replace(row, chosen=_is_own(row) and row.count == chosen) for row in rows]
    tables = [Table("dynamics", "Errors of the solver.", rows)]
    if chosen is not None and not quick:
        caption = (
            "Substeps that hold each material on this mesh, at most "
            f"{100 * BOUND:g} % off in both scenes; a frame at 60 Hz has {FRAME_MS:.3g} ms. The "
            "default's count is the rule's. For the others the count begins at a guess and "
            f"grows by a tenth until it holds; where more than {MOST_SUBSTEPS} would be needed, "
            "the guess stands, and the material acts softer."
        )
        tables.append(Table("materials", caption, held_materials(body, device, rows, chosen)))
    figure = Figure(
        "dynamics",
        "Left: error over the milliseconds a frame takes, default material; the star is the "
        "default, the ring the rule's. Right: error over substeps, for each compliance. Solid "
        "lines: static; broken lines: dynamic.",
        plot(rows),
    )
    return Section(
        key="dynamics",
        title=TITLE,
        findings=[*_findings(rows, chosen), *lost],
        method=_method(mesh, of_material[0].gravity[0], exact, quick),
        tables=tables,
        figures=[figure],
        values={"bound": BOUND, "recommended_substeps": chosen},
    )


def plan(of_material, quick) -> list[tuple]:
    """The load cases and numbers of substeps to measure."""
    counts = sorted({*(QUICK_COUNTS if quick else COUNTS), DEFAULT_COUNT})
    few = (DEFAULT_COUNT,) if quick else (5, DEFAULT_COUNT, 100)
    runs = [(case, count) for case in of_material for count in counts]
    for compliance, scenes in COMPLIANCES.items():
        # In other stiff bodies Verlet's steps are so short that a motion would take an hour.
        for case in of_material if compliance == 0.0 or not quick else ():
            if case.scene in scenes:
                stiff = replace(case, compliance=compliance)  # one case: it keeps its reference
                runs += [(stiff, count) for count in few]
    return runs


def chosen_count(rows) -> int | None:
    """The rule's number of substeps: the least within the bound, as each costs the same."""
    worst = {}
    for row in filter(_is_own, rows):
        worst[row.count] = max(row.of_motion, worst.get(row.count, 0.0))
    held = [count for count, error in worst.items() if error <= 100.0 * BOUND]
    return min(held, default=None)


def held_materials(body: Body, device, rows, chosen) -> list[MaterialRow]:
    """The number of substeps that each preset needs.

    The first guess comes from the default material's error e with the rule's number n of
    substeps.  Errors fall at least with the square of r ∝ ρ n² / μ, so that a guess is
    n' = n √(μ' ρ / (μ ρ')) (e / BOUND)^¼.  The number grows until both scenes are within BOUND.
    """
    own = [row for row in rows if _is_own(row) and row.count == chosen]  # in the order of SCENES
    standard, error = Material(), max(row.of_motion for row in own) / 100.0
    found = [("default", standard, chosen, own)]
    for preset, material in PRESETS.items():
        material = replace(material, yield_strain=math.inf)
        ratio = softness(material) / softness(standard) * math.sqrt(error / BOUND)
        count, measured = max(1, math.ceil(chosen * math.sqrt(ratio))), []
        cases = load_cases(body, material)  # which keep their references
        while count <= MOST_SUBSTEPS:
            measured = [measure(case, count, device) for case in cases]
            if max(row.of_motion for row in measured) <= 100.0 * BOUND:
                break
            count, measured = max(count + 1, math.ceil(MORE * count)), []
        found.append((preset, material, count, measured))
    return [
        MaterialRow(
            material=name,
            young_modulus=material.young_modulus,
            substeps=count,
            measured=bool(measured),
            of_motion=measured[0].of_motion if measured else None,
            in_motion=measured[1].of_motion if measured else None,
            frame=measured[0].frame if measured else None,
            default=name == "default",
        )
        for name, material, count, measured in found
    ]


def softness(material: Material) -> float:
    """μ / ρ: the error with n substeps grows with its square, see held_materials."""
    return material.shear_modulus / material.density


def _is_own(row):
    return row.compliance == "material"


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
    fits = "which leaves the rest to rendering" if share < 100 else "more than there is"
    said.append(
        f"Of the numbers tried, the default material needs {chosen} substeps here (error at most "
        f"{100 * BOUND:g} % of the motion): {row.frame.median:.3g} ms, {share:.2g} % of a "
        f"frame at 60 Hz, {fits}."
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
        "object's size. With compliance 0 nothing should move."
        + (" Static scenes end after 10 s even if they still move." if quick else ""),
        "The rule takes the least number of substeps whose error is at most "
        f"{100 * BOUND:g} % of the motion in both scenes.",
    ]


def plot(rows) -> bytes:
    """Errors over milliseconds of the default material, and over substeps by compliance."""
    figure = new_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    marks = {"marker": "o", "markersize": 3, "linewidth": 1.1}
    for scene, style in STYLES.items():
        own = [row for row in rows if row.scene == scene and _is_own(row)]
        times, errors = [r.frame.median for r in own], [r.of_motion for r in own]
        left.plot(times, errors, style, label=scene, **marks)
        for index, compliance in enumerate(dict.fromkeys(r.compliance for r in rows)):
            line = [r for r in rows if (r.scene, r.compliance) == (scene, compliance)]
            counts, errors = [r.count for r in line], [r.of_size for r in line]
            name = compliance if scene == "static" else None
            right.plot(counts, errors, style, color=f"C{index}", label=name, **marks)
    for row in rows:
        if row.default:
            left.plot(row.frame.median, row.of_motion, "*", color="black", markersize=12)
        if row.chosen:
            ring = {"markersize": 13, "markerfacecolor": "none", "color": "black"}
            left.plot(row.frame.median, row.of_motion, "o", **ring)
    left.axhline(100.0 * BOUND, color=INK, linewidth=0.8, linestyle="--")
    label(left, "ms a frame", "RMS error [% of the motion]", log="xy")
    label(right, "substeps", "RMS error [% of the size]", log="xy")
    left.legend(fontsize=7, frameon=False)
    right.legend(fontsize=7, frameon=False, title="compliance [m/N]", title_fontsize=7)
    return png(figure)
