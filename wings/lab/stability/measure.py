"""Recovery of the solver from stress cases: its distance to rest and its time.

    error      the largest distance to the rest shape / size, after the best proper rotation of
               each part (rescue.distortion), as they have no place beside each other
    recovered  error < 1 % and every tet's V has its sign at rest, and both stay so
    limit      10 s of simulated time for E ≥ 1e4 Pa, 40 s below

Shapes: V vertices, T tets.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ....core.deform import (
    Material,
    XpbdOptions,
    XpbdSolver,
    distortion,
    lowest_pins,
    lumped_masses,
)
from ....core.geometry import components, signed_volumes
from .stress import STARTS, StressCase, uneven_masses, with_broken_tets

TOLERANCE = 0.01  # of the size
STAYS = 2.0  # s for which a body must have recovered
CHECK = 0.1  # s between measurements
SOFT = 1e4  # Pa
AIR_DRAG = 3.0  # 1/s, on free bodies: what turns stays stretched
FLAT = 1e-6  # of the mean volume; a flatter rest tet has no sign


class NamedMaterial(NamedTuple):
    """A material and its name; `rigid` sets all compliances to exactly 0."""

    name: str
    material: Material
    rigid: bool = False


@dataclass(frozen=True)
class StressResult:
    """The result of a case: values at the end, unless the heading says otherwise.

    The error is nan where a coordinate isn't finite; `finite` says that none ever was not.
    """

    material: Annotated[str, "material"]
    case: Annotated[str, "case"]
    passed: Annotated[bool, "result"]  # finite, and recovered in time unless uneven
    finite: bool
    recovery_seconds: Annotated[float | None, "back after [s]"]  # simulated, from letting go on
    limit: float  # of them
    error: Annotated[float, "error at the end [% of size]"]
    inverted: Annotated[int, "inverted at the end"]
    nan_count: Annotated[int, "NaN"]
    rescues: Annotated[int, "rescues"]


def recovery_limit(young_modulus):
    """Seconds within which a body of this modulus [Pa] has to recover."""
    return 10.0 if young_modulus >= SOFT else 40.0


class RecoverableShape:
    """The rest shape [V, 3] to recover, without flat tets."""

    def __init__(self, rest, tets):
        volumes = signed_volumes(rest, tets)
        solid = np.abs(volumes) > FLAT * np.abs(volumes).mean()
        labels = components(len(rest), tets)
        self.rest, self.size = rest, float(np.ptp(rest, axis=0).max())
        self.tets, self.volumes = tets[solid], volumes[solid]
        self.parts = [np.flatnonzero(labels == label) for label in np.unique(labels)]

    def measure(self, vertices) -> tuple[float, int]:
        """The error [% of the size] and the inverted tets of finite vertices [V, 3]."""
        inverted = signed_volumes(vertices, self.tets) / self.volumes <= 0.0
        error = max(distortion(self.rest[part], vertices[part]) for part in self.parts)
        return 100.0 * error / self.size, int(inverted.sum())


def run_case(
    mesh, solid: NamedMaterial, case: StressCase, device="cpu", seed=0, make_solver=XpbdSolver
) -> StressResult:
    """Put a body through a case and measure whether it recovers.

    Args:
        mesh: Anything with rest_vertices [V, 3] and tets [T, 4].
        make_solver: Called as XpbdSolver is.
    """
    rng, material = np.random.default_rng(seed), solid.material
    rest, tets = mesh.rest_vertices, mesh.tets
    if case.broken_tets:
        rest, tets = with_broken_tets(rest, tets, rng)
    rest = np.array(rest, np.float32).astype(np.float64)  # as in the solver
    pins = lowest_pins(rest, tets) if case.drive else np.zeros(len(rest), bool)
    options = XpbdOptions(air_drag=0.0 if case.drive else AIR_DRAG)
    solver = make_solver(rest, tets, material, pins, options, device)
    if solid.rigid:
        solver.set_compliances(0.0, 0.0)
    if case.uneven:
        solver.set_masses(uneven_masses(lumped_masses(rest, tets, material.density), rng))
    solver.set_state(STARTS[case.start](rest, rng))
    if case.drive:
        for _ in case.drive(solver, case.dt, rng):
            solver.step(case.dt)
        solver.release()
    limit = recovery_limit(material.young_modulus)
    seen = _watch(solver, RecoverableShape(rest, tets), case.dt, limit)
    return StressResult(
        material=solid.name,
        case=case.name,
        passed=seen["finite"] and (case.uneven or seen["recovery_seconds"] is not None),
        limit=limit,
        nan_count=int((~np.isfinite(solver.vertices.numpy())).sum()),
        **seen,
    )


def _watch(solver, shape, dt, limit):
    """Step until the body has recovered and stayed so, or its time is over.

    Returns:
        What was seen from letting go on, and at the end, by the names of StressResult.
    """
    seen = {"finite": True, "recovery_seconds": None, "rescues": 0}
    frames_between = max(1, round(CHECK / dt))
    frame, good_frames, was_rescuing = 0, 0, False
    while True:
        x, v = (array.numpy().astype(np.float64) for array in (solver.vertices, solver.velocities))
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return seen | {"finite": False, "error": np.nan, "inverted": 0}
        error, inverted = shape.measure(x)
        good = error < 100.0 * TOLERANCE and inverted == 0
        good_frames = good_frames + frames_between if good else 0
        if good_frames * dt >= STAYS or frame * dt >= limit + STAYS:
            recovered = (frame - good_frames + frames_between) * dt
            if good_frames > 0 and recovered <= limit:
                seen["recovery_seconds"] = recovered
            return seen | {"error": error, "inverted": inverted}
        for _ in range(frames_between):
            solver.step(dt)
            seen["rescues"] += solver.rescue.running and not was_rescuing
            was_rescuing = solver.rescue.running
        frame += frames_between
