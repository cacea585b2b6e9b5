"""The section on stability: every stress case on the model's mesh, for solver and renderer."""

from collections.abc import Callable

from ....core.deform import Material, XpbdSolver
from ....core.field import TetField
from ....core.render import Renderer
from ..rendering.section import BOUND, LARGEST
from ..report.contents import Section, Table
from . import poses
from .measure import AIR_DRAG, NamedMaterial, recovery_limit, run_case
from .stress import CASES

SEED = 0
EXTREMES = ("random", "drag 100x")  # what stiff materials go through in a quick report
PIXELS, QUICK_PIXELS = 96, 24
MATERIALS = (  # the default material, and stiff ones
    NamedMaterial("default", Material()),
    NamedMaterial("E = 1e9 Pa", Material(young_modulus=1e9)),
    NamedMaterial("compliance 0", Material(), rigid=True),
    NamedMaterial("ν = 0.499", Material(poisson_ratio=0.499)),
)


def section(
    field: TetField,
    device,
    quick: bool = False,
    step: Callable[[float], None] = lambda share: None,
    make_solver=XpbdSolver,
) -> Section:
    """Run all cases by `run_case`; `step` is called with the finished share."""
    runs = [(solid, case) for solid, case in plan(quick) if case.suits(field.mesh.tets)]
    rows = []
    for number, (solid, case) in enumerate(runs, 1):
        rows.append(run_case(field.mesh, solid, case, device, SEED, make_solver))
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
        findings=[*_findings(rows), _pose_finding(shown)],
        method=_method(quick),
        tables=[
            Table("stability", "The solver: how each case ended.", rows),
            Table("poses", "The renderer in extreme poses.", shown),
        ],
        passed=all(row.passed for row in (*rows, *shown)),
    )


def plan(quick):
    """Materials and cases to run."""
    return [
        (solid, case)
        for number, solid in enumerate(MATERIALS)
        for case in CASES
        if number == 0 or case.name in EXTREMES or not (quick or case.uneven)
    ]


def _method(quick):
    return [
        "A free body begins squeezed into a plane, a line or a point, mirrored, or with each "
        "vertex anywhere in its box (random; dt names frames of 1/5 and 1 s). Or its foot is "
        "pinned, and one vertex is dragged 100 sizes away, or all handles are shaken at 30 Hz. Air "
        f"brakes free bodies ({AIR_DRAG:g}/s), which would stay stretched as long as they turn. In "
        "broken tets every twentieth tet is inside out at rest, others are flat or name a corner "
        "twice. With the mass ratio half of the vertices are a million times as heavy; then the "
        "body only has to stay finite, and only the default material is tried.",
        "A body recovers when each part is back at its rest shape, to 1 % of its size after "
        "the best proper rotation, every tet's volume has its sign, and both stay so for 2 s. It "
        f"has {recovery_limit(1e6):g} s of simulated time for that from E = 10⁴ Pa on and "
        f"{recovery_limit(1e3):g} s below, rescues included.",
        f"The renderer's images of {poses.SIZE} × {poses.SIZE} pixels are compared with "
        f"conformance mode, and up to {QUICK_PIXELS if quick else PIXELS} pixels with the float64 "
        f"reference; {BOUND:g} dB are owed in every pose, and {LARGEST:g}/255 in every pixel.",
    ]


def _findings(rows):
    passed = [row for row in rows if row.passed]
    nan = sum(row.nan_count for row in rows)
    uneven = {case.name for case in CASES if case.uneven}  # which needn't come back
    times = [row.recovery_seconds for row in passed if row.case not in uneven]
    times = [time for time in times if time is not None]
    slowest = f", the slowest in {max(times):.1f} s" if times else ""
    rescued = sum(row.rescues > 0 for row in rows)
    return [
        f"{len(passed)} of {len(rows)} stress cases passed{slowest}; {nan} coordinates that "
        f"aren't numbers; {rescued} cases took a rescue.",
        *(
            f"FAILED: {row.case}, {row.material}: {row.error:.3g} % from its rest shape, "
            f"{row.inverted} tets inside out, {row.nan_count} coordinates not numbers."
            for row in rows
            if not row.passed
        ),
    ]


def _pose_finding(rows):
    seen = [row for row in rows if row.shown] or rows
    worst = min(seen, key=lambda row: row.psnr)
    good = sum(row.passed for row in rows)
    return (
        f"The renderer shows {good} of {len(rows)} extreme poses as it should, with {BOUND:g} dB "
        f"or more and no pixel more than {LARGEST:g}/255 off; {len(rows) - len(seen)} of them "
        f"show nothing. The worst is “{worst.pose}” with {worst.psnr:.1f} dB, at most "
        f"{worst.largest:.1f}/255 off."
    )
