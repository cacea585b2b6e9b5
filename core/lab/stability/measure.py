"""Whether a body can be broken: how far and how soon the solver comes back from a stress case.

    error      max_i |R (x_i − x̄) − (X_i − X̄)| / size,   R the best proper rotation of each
               component, as free components have no place beside each other
    recovered  error < 1 % and every tet's V has its sign at rest, and both stay so
    limit      10 s of simulated time for E ≥ 1e4 Pa, 40 s below

R is Kabsch's: with X̂ᵀx̂ = U S Wᵀ, R = U diag(1, 1, det(U Wᵀ)) Wᵀ (Acta Cryst. A32, 1976),
so that a mirrored body is not aligned with its rest pose.

X rest, x current vertices [m].  Shapes: V vertices, T tets, E edges.
"""

import time
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np

from ...deform import Material, XpbdSolver, lowest_pins, lumped_masses
from ...geometry import components, edges, signed_volumes
from .stress import StressCase, uneven_masses, with_broken_tets

TOLERANCE = 0.01  # of the size
STAYS = 2.0  # s for which a body must have recovered
CHECK = 0.1  # s between measurements
SOFT = 1e4  # Pa
FLAT = 1e-6  # of the mean volume; a flatter rest tet has no sign
UNKNOWN = float("nan")


class Solid(NamedTuple):
    """A material and its name; `rigid` sets all compliances to exactly 0."""

    name: str
    material: Material
    rigid: bool = False


@dataclass(frozen=True)
class StressResult:
    """How a case ended: values at the end, unless the heading says otherwise.

    Attributes:
        passed: Finite, and recovered in time unless the case asks for less.
        finite: All positions and velocities were finite all the time.
        recovery_seconds: Simulated time from letting go to recovery; None if it didn't.
        limit: Of that time.
        peak_strain, most_inverted: Over all measurements from letting go on.
        error: nan if not finite, as smallest_volume and largest_strain.
        inverted: Tets whose volume hasn't the sign that it has at rest.
        smallest_volume: The least V/V0.
        largest_strain: The largest |length/rest length − 1| of an edge.
        nan_count: Coordinates that aren't finite.
        rescues: How often the solver began one.
        wall_seconds: Without the solver's construction.
    """

    material: Annotated[str, "material"]
    case: Annotated[str, "case"]
    passed: Annotated[bool, "result"]
    finite: bool
    recovery_seconds: Annotated[float | None, "back after [s]"]
    limit: float
    peak_strain: Annotated[float, "peak strain [%]"]
    most_inverted: Annotated[int, "most inverted"]
    error: Annotated[float, "error at the end [% of size]"]
    inverted: Annotated[int, "inverted at the end"]
    smallest_volume: Annotated[float, "least V/V₀ at the end"]
    largest_strain: Annotated[float, "strain at the end [%]"]
    nan_count: Annotated[int, "NaN"]
    rescues: Annotated[int, "rescues"]
    seed: int
    wall_seconds: float


def recovery_limit(young_modulus):
    """Seconds within which a body of this modulus [Pa] has to recover."""
    return 10.0 if young_modulus >= SOFT else 40.0


def aligned_error(vertices, rest):
    """The largest distance to the rest pose after the best proper rotation.  [m]

    Args:
        vertices: [V, 3]
        rest: [V, 3]
    """
    x, goal = vertices - vertices.mean(axis=0), rest - rest.mean(axis=0)
    u, _, wt = np.linalg.svd(goal.T @ x)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ wt))]) @ wt
    return float(np.linalg.norm(x @ turn.T - goal, axis=1).max())


class Measures(NamedTuple):
    """Error [% of the size], inverted tets, least V/V0, largest strain [%]."""

    error: float = UNKNOWN
    inverted: int = 0
    smallest_volume: float = UNKNOWN
    largest_strain: float = UNKNOWN


NOT_FINITE = Measures()


@dataclass(frozen=True)
class Shape:
    """What a body has to come back to.

    Attributes:
        rest: [V, 3]
        size: The longest side of its bounding box.
        tets: Those that aren't flat.  [T, 4]
        volumes: Signed.  [T]
        edges: Those that aren't points.  [E, 2]
        lengths: [E]
        parts: The vertices of each component.
    """

    rest: np.ndarray
    size: float
    tets: np.ndarray
    volumes: np.ndarray
    edges: np.ndarray
    lengths: np.ndarray
    parts: list[np.ndarray]

    def measure(self, vertices) -> Measures:
        """Of vertices [V, 3] that are finite."""
        ratios = signed_volumes(vertices, self.tets) / self.volumes
        strains = _lengths(vertices, self.edges) / self.lengths - 1.0
        error = max(aligned_error(vertices[part], self.rest[part]) for part in self.parts)
        return Measures(
            error=100.0 * error / self.size,
            inverted=int((ratios <= 0).sum()),
            smallest_volume=float(ratios.min()),
            largest_strain=100.0 * float(np.abs(strains).max()),
        )


def shape_of(rest, tets) -> Shape:
    """Leaves out what has no volume or no length."""
    volumes = signed_volumes(rest, tets)
    solid = np.abs(volumes) > FLAT * np.abs(volumes).mean()
    pairs = edges(tets)
    pairs = pairs[_lengths(rest, pairs) > FLAT * _lengths(rest, pairs).mean()]
    size = float(np.ptp(rest, axis=0).max())
    labels = components(len(rest), tets)
    parts = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    return Shape(rest, size, tets[solid], volumes[solid], pairs, _lengths(rest, pairs), parts)


def _lengths(vertices, pairs):
    return np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1)


def run_case(
    mesh, solid: Solid, case: StressCase, device="cpu", seed=0, make_solver=XpbdSolver
) -> StressResult:
    """Put a body through a case and see whether it comes back.

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
    solver = make_solver(rest, tets, material, pins, device=device)
    if solid.rigid:
        solver.set_compliances(0.0, 0.0)
    if case.uneven:
        solver.set_masses(uneven_masses(lumped_masses(rest, tets, material.density), rng))
    solver.set_state(case.start(rest, rng))

    begin = time.perf_counter()
    if case.drive:
        for _ in case.drive(solver, case.dt, rng):
            solver.step(case.dt)
        solver.release()
    limit = recovery_limit(material.young_modulus)
    seen = _watch(solver, shape_of(rest, tets), case.dt, limit)
    return StressResult(
        material=solid.name,
        case=case.name,
        passed=seen.finite and (case.uneven or seen.recovery_seconds is not None),
        limit=limit,
        nan_count=int((~np.isfinite(solver.vertices.numpy())).sum()),
        seed=seed,
        wall_seconds=time.perf_counter() - begin,
        **seen.last._asdict(),
        **{k: v for k, v in vars(seen).items() if k != "last"},
    )


@dataclass(frozen=True)
class _Seen:
    """What was measured from letting go on; see StressResult."""

    last: Measures = NOT_FINITE
    finite: bool = True
    recovery_seconds: float | None = None
    peak_strain: float = 0.0
    most_inverted: int = 0
    rescues: int = 0


def _watch(solver, shape, dt, limit) -> _Seen:
    """Step until the body has recovered and stayed so, or its time is over."""
    frames_between = max(1, round(CHECK / dt))
    frame, good_frames, was_rescuing, seen = 0, 0, False, _Seen()
    while True:
        x, v = (array.numpy().astype(np.float64) for array in (solver.vertices, solver.velocities))
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return replace(seen, last=NOT_FINITE, finite=False)
        now = shape.measure(x)
        seen = replace(
            seen,
            last=now,
            peak_strain=max(seen.peak_strain, now.largest_strain),
            most_inverted=max(seen.most_inverted, now.inverted),
        )
        good = now.error < 100.0 * TOLERANCE and now.inverted == 0
        good_frames = good_frames + frames_between if good else 0
        if good_frames * dt >= STAYS or frame * dt >= limit + STAYS:
            recovered = (frame - good_frames + frames_between) * dt
            in_time = good_frames > 0 and recovered <= limit
            return replace(seen, recovery_seconds=recovered if in_time else None)
        for _ in range(frames_between):
            solver.step(dt)
            began = solver.rescuing and not was_rescuing
            seen, was_rescuing = replace(seen, rescues=seen.rescues + began), solver.rescuing
        frame += frames_between
