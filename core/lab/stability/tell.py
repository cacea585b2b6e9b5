"""Section 4: every stress case on the model's own mesh, for the solver and for the renderer."""

from collections.abc import Callable
from dataclasses import dataclass

from ...deform import Material, XpbdSolver
from ...field import TetField
from ...render import Renderer
from ..rendering import BOUND, LARGEST
from ..report import INK, Figure, Section, Table, log_scale, new_figure, png
from . import poses
from .measure import CaseResult, recovery_limit, run_case
from .stress import CASES, suits

SEED = 0
EXTREMES = ("random", "drag 100x")  # what stiff materials go through in a quick report
PIXELS, QUICK_PIXELS = 96, 24
LEAST_SECONDS = 0.02  # drawn for what recovers at once


@dataclass(frozen=True)
class Solid:
    """A material of the table, by its name; `rigid` is compliance 0."""

    name: str
    material: Material
    rigid: bool = False


@dataclass(frozen=True)
class StabilityRow:
    """The solver in one case; error and strains in percent, of the size and of the length."""

    material: str
    case: str
    passed: bool
    recovery_seconds: float | None
    limit: float
    error: float
    inverted: int
    smallest_volume: float
    largest_strain: float
    peak_strain: float
    most_inverted: int
    nan_count: int
    rescues: int
    seed: int


def section(
    field: TetField,
    device,
    quick: bool = False,
    step: Callable[[float], None] = lambda share: None,
    make_solver=XpbdSolver,
) -> Section:
    """Run and tell; `step` is called with the share that is done.

    Args:
        make_solver: Called as XpbdSolver is.
    """
    runs = [(solid, case) for solid, case in plan(quick) if suits(case, field.mesh.tets)]
    rows = []
    for number, (solid, case) in enumerate(runs, 1):
        result = run_case(
            *(field.mesh, solid.material, case, device, SEED, solid.rigid, make_solver)
        )
        rows.append(_row(solid, result))
        step(0.8 * number / len(runs))
    renderer = Renderer(field, device)
    found = poses.poses(field, device, SEED).items()
    shown = []
    for number, (name, vertices) in enumerate(found, 1):
        pixels, repeats = (QUICK_PIXELS, 1) if quick else (PIXELS, 3)
        shown.append(poses.measure(renderer, name, vertices, pixels, repeats))
        step(0.8 + 0.2 * number / len(found))
    return Section(
        key="stability",
        title="Stability",
        findings=[*_findings(rows), *_pose_findings(shown)],
        method=[
            "The cases. The body begins, free, squeezed into a plane, a line or a point, mirrored, "
            "or with each vertex anywhere in its box (random; at frames of 1/5 and of 1 s in those "
            "called dt). Or it stands, its foot pinned: one vertex is dragged 100 sizes away "
            "(drag 100x), or all handles are shaken (shake 30 Hz). In broken tets every twentieth "
            "tet is inside out at rest and others are flat or name a corner twice, and it begins "
            "at random; with the mass ratio half of the vertices are a million times as heavy, "
            "and it begins squashed.",
            "A body recovers when it is back at its rest shape, to 1 % of its size after the best "
            "proper rotation, every tet's volume has its sign, and both stay so for 2 s. It has "
            f"{recovery_limit(1e6):g} s of simulated time for that from E = 10⁴ Pa on and "
            f"{recovery_limit(1e3):g} s below, rescues included; the parts of a body in several "
            "components each for itself. With masses that differ by a million it has to stay "
            "finite, and the default material alone is tried. Random numbers have the seed "
            f"{SEED}.",
            f"Rendered: {poses.SIZE} × {poses.SIZE} pixels in default mode, up to "
            f"{QUICK_PIXELS if quick else PIXELS} of them against the float64 reference, half of "
            "them where the image isn't white, and all of them against conformance mode; "
            f"{BOUND:g} dB are owed in every pose, and {LARGEST:g}/255 in every pixel. What is "
            "flat, a line or a point is not to be seen.",
        ],
        tables=[_table(rows), _pose_table(shown)],
        figures=[
            Figure(
                "stability",
                "Simulated seconds until the body is back, for each case and material; what "
                "failed is a cross.",
                plot(rows),
            )
        ],
        passed=all(row.passed for row in (*rows, *shown)),
    )


def solids() -> list[Solid]:
    """The default material, and stiff ones."""
    return [
        Solid("default", Material()),
        Solid("E = 1e9 Pa", Material(young_modulus=1e9)),
        Solid("compliance 0", Material(), rigid=True),
        Solid("ν = 0.499", Material(poisson_ratio=0.499)),
    ]


def plan(quick):
    """Materials and cases to run."""
    runs = []
    for number, solid in enumerate(solids()):
        for case in CASES:
            if number == 0 or case.name in EXTREMES or not (quick or case.uneven):
                runs.append((solid, case))
    return runs


def _row(solid, result: CaseResult):
    return StabilityRow(
        material=solid.name,
        case=result.name,
        passed=result.passed,
        recovery_seconds=result.recovery_seconds,
        limit=recovery_limit(solid.material.young_modulus),
        error=100.0 * result.error,
        inverted=result.inverted,
        smallest_volume=result.smallest_volume,
        largest_strain=100.0 * result.largest_strain,
        peak_strain=100.0 * result.peak_strain,
        most_inverted=result.most_inverted,
        nan_count=result.nan_count,
        rescues=result.rescues,
        seed=SEED,
    )


def _findings(rows):
    passed = [row for row in rows if row.passed]
    nan = sum(row.nan_count for row in rows)
    uneven = {case.name for case in CASES if case.uneven}  # which needn't come back
    back = [row for row in passed if row.case not in uneven]
    times = [row.recovery_seconds for row in back if row.recovery_seconds is not None]
    slowest = f", the slowest in {max(times):.1f} s" if times else ""
    rescued = sum(row.rescues > 0 for row in rows)
    said = [
        f"{len(passed)} of {len(rows)} stress cases passed{slowest}; {nan} coordinates that "
        f"aren't numbers; {rescued} cases took a rescue."
    ]
    for row in rows:
        if not row.passed:
            said.append(
                f"FAILED: {row.case}, {row.material}: {row.error:.3g} % from its rest shape, "
                f"{row.inverted} tets inside out, {row.nan_count} coordinates not numbers."
            )
    return said


def _pose_findings(rows):
    seen = [row for row in rows if row.shown] or rows
    worst = min(seen, key=lambda row: row.psnr)
    good = sum(row.passed for row in rows)
    return [
        f"The renderer shows {good} of {len(rows)} extreme poses as it should, with {BOUND:g} dB "
        f"or more and no pixel more than {LARGEST:g}/255 off; in {len(rows) - len(seen)} of them "
        f"nothing is to be seen. The worst is “{worst.pose}” with {worst.psnr:.1f} dB, at most "
        f"{worst.largest:.1f}/255 off."
    ]


def _table(rows):
    return Table(
        "stability",
        "The solver: what each case did to the body, measured every 0.1 s from letting go on, and "
        "how it ended.",
        {
            "material": "material",
            "case": "case",
            "passed": "result",
            "recovery_seconds": "back after [s]",
            "peak_strain": "peak strain [%]",
            "most_inverted": "most inverted",
            "error": "error at the end [% of size]",
            "inverted": "inverted at the end",
            "smallest_volume": "least V/V₀ at the end",
            "largest_strain": "strain at the end [%]",
            "nan_count": "NaN",
            "rescues": "rescues",
        },
        rows,
    )


def _pose_table(rows):
    return Table(
        "poses",
        "The renderer in extreme poses.",
        {
            "pose": "pose",
            "passed": "result",
            "inverted": "inverted tets",
            "shown": "pixels that show it",
            "psnr": "PSNR [dB]",
            "largest": "largest [1/255]",
            "largest_anywhere": "all pixels, from conformance [1/255]",
            "frame": "ms an image",
        },
        rows,
    )


def plot(rows) -> bytes:
    """Seconds to recovery by case, a color for each material."""
    names = list(dict.fromkeys(row.case for row in rows))
    figure = new_figure(8.4, 0.32 * len(names) + 1.2)
    axis = figure.subplots()
    for index, material in enumerate(dict.fromkeys(row.material for row in rows)):
        mine = [row for row in rows if row.material == material]
        back = [row for row in mine if row.recovery_seconds is not None]
        lost = [row for row in mine if not row.passed]
        shift = 0.12 * (index - 1.5)
        axis.scatter(
            [max(row.recovery_seconds, LEAST_SECONDS) for row in back],
            [names.index(row.case) + shift for row in back],
            s=18,
            color=f"C{index}",
            label=material,
        )
        axis.scatter(
            [row.limit for row in lost],
            [names.index(row.case) + shift for row in lost],
            s=60,
            marker="x",
            color=f"C{index}",
        )
    axis.axvline(recovery_limit(1e6), color=INK, linewidth=0.8, linestyle="--")
    log_scale(axis.xaxis)
    axis.set_yticks(range(len(names)), names)
    axis.invert_yaxis()
    axis.set_xlabel("simulated seconds until it is back (dashed: the limit from E = 10⁴ Pa on)")
    axis.grid(True, axis="x", which="major", linewidth=0.4)
    figure.legend(fontsize=7, frameon=False, loc="outside right upper")
    return png(figure)
