"""Section 2: what a frame of the dynamics costs, and how wrong it is, on the model's own mesh."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...deform import PRESETS, TIME_STEP, Material, XpbdOptions
from ...geometry import TetMesh
from ..rendering import rule
from ..report import INK, Figure, Section, Table, log_scale, new_figure, png
from ..stopwatch import Timing
from . import error
from . import measure as own_mesh

TITLE = "Dynamics: error against time"
FRAME_MS = 1e3 * TIME_STEP
MOST_SUBSTEPS = 200
MORE = 1.1  # times as many substeps, where a guess was too few
DEFAULT_COUNT = XpbdOptions().substep_count
COMPLIANCES = (0.0, 1e-8, 1e-6, 1e-4)
FALLING = (0.0, 1e-4)  # of these, those with a dynamic scene
QUICK_SETTLING = 600  # frames: some of a stiff body's slowest way is left
STYLES = {"static": "-", "dynamic": "--"}
COLORS = {"substeps": "tab:blue", "iterations": "tab:orange", "unfloored": "tab:red"}
PLAIN_COLOR = "black"


@dataclass(frozen=True)
class DynamicsRow:
    """One solver on one scene; errors in percent.

    Nothing moves at compliance 0, so there `of_motion` is None.  `reference_error` is the
    reference's own, over its motion.
    """

    scene: str
    scheme: str
    compliance: str
    count: int
    of_motion: float | None
    of_size: float
    largest: float
    reference_error: float
    frame: Timing | None
    frames: int
    default: bool
    chosen: bool


@dataclass(frozen=True)
class MaterialRow:
    """What a material takes to be held, and its error with as many in both scenes."""

    material: str
    young_modulus: float
    substeps: int
    measured: bool
    of_motion: float | None
    in_motion: float | None
    frame: Timing | None
    default: bool


def section(
    name: str,
    mesh: TetMesh,
    device,
    quick: bool = False,
    step: Callable[[float], None] = lambda share: None,
) -> Section:
    """Measure and tell; `step` is called with the share that is done."""
    body = own_mesh.body_of(mesh)
    try:
        of_material = own_mesh.cases(name, body)
        errors = [case.reference_error for case in of_material]
    except RuntimeError as error_:
        return Section("dynamics", TITLE, [f"There is no reference for this mesh: {error_}."])
    jobs = plan(of_material, quick)
    weights = np.cumsum([1 + count for _, _, count in jobs], dtype=float)
    rows, lost = [], {}
    for (case, scheme, count), done in zip(jobs, weights, strict=True):
        settling = QUICK_SETTLING if quick else error.SETTLING_FRAMES
        try:
            exact = case.reference_error
        except RuntimeError:  # Newton's method found no rest
            lost[str(case.compliance)] = None
        else:
            measured = error.measure(case, scheme, count, device, settling)
            rows.append(_row(measured, exact))
        step(0.9 * done / weights[-1])
    chosen = chosen_count(rows)
    materials = [] if quick or chosen is None else held_materials(name, body, device, rows, chosen)
    found = [replace(row, chosen=_is_own(row) and row.count == chosen) for row in rows]
    return Section(
        key="dynamics",
        title=TITLE,
        findings=[
            *_findings(found, chosen),
            *_scheme_findings(found),
            *(f"No reference was found for compliance {compliance}." for compliance in lost),
        ],
        method=[
            f"{mesh.tet_count} tets, held at their foot and pushed sideways by a gravity of "
            f"{of_material[0].gravity[0]:.2g} m/s², so that a linear body moves by "
            f"{100 * own_mesh.PUSH:g} % of its size. Static: until it is still, against Newton's "
            f"method in float64 (forces left: {errors[0]:.0e} of the load). "
            f"Dynamic: {error.FALL_FRAMES} frames from rest, undamped, against Verlet in float64 "
            f"(itself wrong by {100 * errors[1]:.1g} % of the motion). "
            "Error: RMS over vertices and frames, over the reference's RMS motion, and over the "
            "object's size; with compliance 0 nothing should move.",
            "The scenes run one after the other. "
            + ("Static ones are ended after 10 s even if they still move. " if quick else "")
            + "Substeps: the program's solver. Iterations: one substep with so many iterations, on "
            "CUDA a launch for every color; unfloored: those without the floor under the "
            "compliance. Plain float32: substeps whose positions aren't kept as base plus delta "
            "(computed in NumPy, so without a time).",
            f"The rule: the cheapest, that is the least, number of substeps whose error is at most "
            f"{100 * own_mesh.BOUND:g} % of the motion in both scenes, which is to hold Young's "
            "modulus to about a tenth.",
        ],
        tables=[_table(found), *([_materials_table(materials)] if materials else [])],
        figures=[
            Figure(
                "dynamics",
                "Left: error over milliseconds a frame, the default material; the star is the "
                f"default, dashed gray {100 * own_mesh.BOUND:g} %. Right: over substeps and of the "
                "size, by the compliance of every edge [m/N], under the same push. Lines: static; "
                "broken lines: dynamic.",
                plot(found),
            )
        ],
        values={"bound": own_mesh.BOUND, "recommended_substeps": chosen},
    )


def plan(of_material, quick):
    """What is measured: (case, scheme, count), the cheap ones first."""
    counts = (5, 10, 20, 30, 40) if quick else (1, 2, 5, 10, 15, 20, 25, 30, 40, 50, 100, 200)
    counts = sorted({*counts, DEFAULT_COUNT})
    few = (DEFAULT_COUNT,) if quick else (5, DEFAULT_COUNT, 100)
    jobs = [(case, "substeps", count) for case in of_material for count in counts]
    for scheme in ("iterations",) if quick else ("iterations", "unfloored"):
        jobs += [(case, scheme, count) for case in of_material for count in few[:2]]
    jobs += [(of_material[1], "plain float32", count) for count in few[-2:]]
    for compliance in (0.0,) if quick else COMPLIANCES:
        # Verlet's steps in a stiff body are so short that its fall would take an hour.
        scenes = of_material if compliance in FALLING else of_material[:1]
        for case in scenes:
            stiff = replace(case, compliance=compliance)  # one case: it keeps its reference
            jobs += [(stiff, "substeps", count) for count in few]
    return jobs


def chosen_count(rows) -> int | None:
    """The rule's number of substeps: see method.  Each costs the same, so time is their number."""
    own = [row for row in rows if _is_own(row)]
    counts = sorted({row.count for row in own})
    errors = [max(row.of_motion for row in own if row.count == count) for count in counts]
    found = rule.cheapest([[count] for count in counts], errors, 100.0 * own_mesh.BOUND)
    return None if found is None else counts[found]


def held_materials(name, body, device, rows, chosen) -> list[MaterialRow]:
    """How many substeps each preset takes.

    A first guess by the default material's error e with the rule's number n of substeps:
    errors are about c/r with r ∝ ρ n² / μ (see Material.young_modulus_at), so that
    n' = n √(e c' μ' ρ / (BOUND c μ ρ')).  Then more, until both scenes are within the bound.
    """
    own = [row for row in rows if _is_own(row) and row.count == chosen]
    standard, error_ = Material(), max(row.of_motion for row in own) / 100.0
    found = [
        MaterialRow(
            *("default", standard.young_modulus, chosen, True),
            *(row.of_motion for row in own),  # in the order of error.SCENES
            own[0].frame,
            default=True,
        )
    ]
    for preset, material in PRESETS.items():
        ratio = softness(material) / softness(standard) * error_ / own_mesh.BOUND
        count, measured = max(1, math.ceil(chosen * math.sqrt(ratio))), None
        cases = own_mesh.cases(name, body, material)  # which keep their references
        while count <= MOST_SUBSTEPS:
            measured = [error.measure(case, "substeps", count, device) for case in cases]
            if max(row.of_motion for row in measured) <= own_mesh.BOUND:
                break
            count, measured = max(count + 1, math.ceil(MORE * count)), None
        errors = [100.0 * row.of_motion for row in measured] if measured else [None, None]
        frame = measured[0].frame if measured else None
        held = bool(measured)
        found.append(
            MaterialRow(preset, material.young_modulus, count, held, *errors, frame, default=False)
        )
    return found


def softness(material: Material) -> float:
    """What the error with n substeps is proportional to: c μ / ρ, see held_materials."""
    return material.softening * material.shear_modulus / material.density


def _row(row, exact):
    """A row of the study in percent; `exact` is the reference's own error."""
    own = row.scheme == "substeps" and row.compliance == "material"
    return DynamicsRow(
        scene=row.scene,
        scheme=row.scheme,
        compliance=row.compliance if row.compliance == "material" else f"{row.compliance:g}",
        count=row.count,
        of_motion=100.0 * row.of_motion if math.isfinite(row.of_motion) else None,
        of_size=100.0 * row.rms,
        largest=100.0 * row.largest,
        reference_error=100.0 * exact,
        frame=None if row.scheme == "plain float32" else row.frame,
        frames=row.frames,
        default=own and row.count == DEFAULT_COUNT,
        chosen=False,
    )


def _is_own(row):
    return row.scheme == "substeps" and _own(row)


def _findings(rows, chosen):
    default = [row for row in rows if row.default]
    static, dynamic = (next(r for r in default if r.scene == s) for s in error.SCENES)
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
        f"{100 * own_mesh.BOUND:g} % of the motion): {row.frame.median:.3g} ms, {share:.2g} % of a "
        f"frame at 60 Hz, {fits}."
    )
    return said


def _scheme_findings(rows):
    """Substeps against iterations at the same count, static, and what plain float32 loses."""
    said = []
    static = {(r.scheme, r.count): r for r in rows if r.scene == "static" and _own(r)}
    dynamic = {(r.scheme, r.count): r for r in rows if r.scene == "dynamic" and _own(r)}
    one, other = (static.get((s, DEFAULT_COUNT)) for s in ("substeps", "iterations"))
    if one and other:
        said.append(
            f"{DEFAULT_COUNT} iterations of one substep instead: {other.of_motion:.3g} % "
            f"under load against {one.of_motion:.2g} %."
        )
    count = max((c for s, c in dynamic if s == "plain float32"), default=None)
    if count is not None and ("substeps", count) in dynamic:
        plain, kept = (dynamic[s, count].of_motion for s in ("plain float32", "substeps"))
        said.append(
            f"With {count} substeps positions in plain float32 are off by {plain:.2g} % in "
            f"motion; kept as base plus delta, by {kept:.2g} %."
        )
    return said


def _own(row):
    return row.compliance == "material"


def _table(rows):
    return Table(
        "dynamics",
        "Errors of the solver.",
        {
            "scene": "scene",
            "scheme": "scheme",
            "compliance": "compliance [m/N]",
            "count": "count",
            "of_motion": "of the motion [%]",
            "of_size": "of the size [%]",
            "largest": "largest, of the size [%]",
            "reference_error": "reference's own [% of the motion]",
            "frame": "ms a frame",
            "chosen": "the rule's",
        },
        rows,
    )


def _materials_table(rows):
    return Table(
        "materials",
        "What each material takes to be held on this mesh, at most "
        f"{100 * own_mesh.BOUND:g} % off in both scenes; a frame at 60 Hz has {FRAME_MS:.3g} ms. "
        "The default's are the rule's, of the numbers tried. Others begin at a guess and take a "
        f"tenth more until they are held; beyond {MOST_SUBSTEPS} it stays a guess, and the "
        "material that acts is softer.",
        {
            "material": "material",
            "young_modulus": "E [Pa]",
            "substeps": "substeps",
            "measured": "measured",
            "of_motion": "under load [% of the motion]",
            "in_motion": "in motion [% of it]",
            "frame": "ms a frame",
        },
        rows,
    )


def plot(rows) -> bytes:
    """Errors over milliseconds by scheme, and over substeps by compliance."""
    figure = new_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    for scene, style in STYLES.items():
        mine = [row for row in rows if row.scene == scene]
        for scheme, color in COLORS.items():
            line = [r for r in mine if r.scheme == scheme and _own(r) and r.frame]
            label = scheme if scene == "static" else None
            _line(left, line, lambda r: r.frame.median, style, color, label)
        for index, compliance in enumerate(dict.fromkeys(r.compliance for r in rows)):
            line = [r for r in mine if r.scheme == "substeps" and r.compliance == compliance]
            label = compliance if scene == "static" else None
            _line(right, line, lambda r: r.count, style, f"C{index}", label, _of_size)
        plain = [r for r in mine if r.scheme == "plain float32"]
        label = "plain float32" if plain else None
        _line(right, plain, lambda r: r.count, ":", PLAIN_COLOR, label, _of_size)
    for row in rows:
        if row.default:
            left.plot(row.frame.median, row.of_motion, "*", color="black", markersize=12)
        if row.chosen:
            left.plot(
                *(row.frame.median, row.of_motion, "o"),
                markersize=13,
                markerfacecolor="none",
                color="black",
            )
    left.axhline(100.0 * own_mesh.BOUND, color=INK, linewidth=0.8, linestyle="--")
    for axis, label in ((left, "ms a frame"), (right, "substeps")):
        log_scale(axis.xaxis)
        log_scale(axis.yaxis)
        axis.set_xlabel(label)
        axis.grid(True, which="major", linewidth=0.4)
    left.legend(fontsize=7, frameon=False)
    right.legend(fontsize=7, frameon=False, title="compliance [m/N]", title_fontsize=7)
    left.set_ylabel("RMS error [% of the motion]")
    right.set_ylabel("RMS error [% of the size]")
    return png(figure)


def _of_motion(row):
    return row.of_motion


def _of_size(row):
    return row.of_size


def _line(axis, rows, along, style, color, label, error_of=_of_motion):
    if rows:
        axis.plot(
            [along(row) for row in rows],
            [error_of(row) for row in rows],
            style,
            color=color,
            label=label,
            marker="o",
            markersize=3,
            linewidth=1.1,
        )
