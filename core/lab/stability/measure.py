"""Can a body be broken?  How far and how soon the solver comes back from a stress case.

    error      max_i |R (x_i − x̄) − (X_i − X̄)| / size,   R the best proper rotation of each
               component: what nothing joins and nothing holds has no place beside the rest
    recovered  error < 1 % and every tet's V has its sign at rest, and both stay so
    limit      10 s of simulated time for E ≥ 1e4 Pa, 40 s below

R is Kabsch's: with X̂ᵀx̂ = U S Wᵀ, R = U diag(1, 1, det(U Wᵀ)) Wᵀ (Acta Cryst. A32, 1976),
so that a mirrored body is not aligned with its rest pose.

X rest, x current vertices [m].  Shapes: V vertices, T tets, E edges.
"""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...deform import Material, XpbdSolver, lowest_pins, lumped_masses
from ...geometry import components, edges, signed_volumes
from .stress import Case, uneven_masses, with_broken_tets

TOLERANCE = 0.01  # of the size
STAYS = 2.0  # s for which a body must have recovered
CHECK = 0.1  # s between measurements
SOFT = 1e4  # Pa
FLAT = 1e-6  # of the mean volume; a flatter rest tet has no sign


@dataclass(frozen=True)
class CaseResult:
    """What a case ended in; what isn't said to be otherwise is as it was at the end.

    Attributes:
        name: The case's.
        passed: Finite, and recovered in time unless the case asks for less.
        finite: No position and no velocity was ever infinite or not a number.
        recovery_seconds: Simulated time from letting go to recovery; None if it didn't.
        nan_count: Coordinates that aren't finite.
        error: Of the size; nan if not finite, as the next three.
        inverted: Tets whose volume hasn't the sign that it has at rest.
        smallest_volume: The least V/V0.
        largest_strain: The largest |length/rest length − 1| of an edge.
        peak_strain: The same, of all measurements from letting go on.
        most_inverted: Of all these measurements.
        rescues: How often the solver began one.
        wall_seconds: Without the solver's construction.
    """

    name: str
    passed: bool
    finite: bool
    recovery_seconds: float | None
    nan_count: int
    error: float
    inverted: int
    smallest_volume: float
    largest_strain: float
    peak_strain: float
    most_inverted: int
    rescues: int
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

    def measure(self, vertices):
        """Error of the size, V/V0 [T], and strains [E]."""
        ratios = signed_volumes(vertices, self.tets) / self.volumes
        strains = _lengths(vertices, self.edges) / self.lengths - 1.0
        error = max(aligned_error(vertices[part], self.rest[part]) for part in self.parts)
        return error / self.size, ratios, strains


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
    mesh, material: Material, case: Case, device="cpu", seed=0, rigid=False, make_solver=XpbdSolver
) -> CaseResult:
    """Put a body through a case and see whether it comes back.

    Args:
        mesh: Anything with rest_vertices [V, 3] and tets [T, 4].
        rigid: Compliance exactly 0 of edges and volumes, in place of the material's.
        make_solver: Called as XpbdSolver is.
    """
    rng = np.random.default_rng(seed)
    rest, tets = mesh.rest_vertices, mesh.tets
    if case.broken_tets:
        rest, tets = with_broken_tets(rest, tets, rng)
    rest = np.array(rest, np.float32).astype(np.float64)  # as in the solver
    pins = lowest_pins(rest, tets) if case.drive else np.zeros(len(rest), bool)
    solver = make_solver(rest, tets, material, pins, device=device)
    if rigid:
        solver.set_compliances(0.0, 0.0)
    if case.uneven:
        solver.set_masses(uneven_masses(lumped_masses(rest, tets, material.density), rng))
    solver.set_state(case.start(rest, rng))

    begin = time.perf_counter()
    if case.drive:
        for _ in case.drive(solver, case.dt, rng):
            solver.step(case.dt)
        solver.release()
    seen = _watch(solver, shape_of(rest, tets), case.dt, recovery_limit(material.young_modulus))
    finite, recovery_seconds = seen.last is not None, seen.recovery_seconds
    nothing = np.nan, np.array([np.nan]), np.array([np.nan])
    error, ratios, strains = seen.last if finite else nothing
    return CaseResult(
        name=case.name,
        passed=finite and (case.uneven or recovery_seconds is not None),
        finite=finite,
        recovery_seconds=recovery_seconds,
        nan_count=int((~np.isfinite(solver.vertices.numpy())).sum()),
        error=error,
        inverted=int((ratios <= 0).sum()),
        smallest_volume=float(ratios.min()),
        largest_strain=float(np.abs(strains).max()),
        peak_strain=seen.peak_strain,
        most_inverted=seen.most_inverted,
        rescues=seen.rescues,
        wall_seconds=time.perf_counter() - begin,
    )


class _Seen(NamedTuple):
    """The last measurement, None if something wasn't finite; seconds to recovery, or None."""

    last: tuple | None
    recovery_seconds: float | None
    peak_strain: float
    most_inverted: int
    rescues: int


def _watch(solver, shape, dt, limit) -> _Seen:
    """Step until the body has recovered and stayed so, or its time is over."""
    frames_between = max(1, round(CHECK / dt))
    frame, good_frames, rescues, was_rescuing = 0, 0, 0, False
    peak, most = 0.0, 0
    while True:
        x, v = (array.numpy().astype(np.float64) for array in (solver.vertices, solver.velocities))
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return _Seen(None, None, peak, most, rescues)
        error, ratios, strains = shape.measure(x)
        peak = max(peak, float(np.abs(strains).max()))
        most = max(most, int((ratios <= 0).sum()))
        good = error < TOLERANCE and (ratios > 0).all()
        good_frames = good_frames + frames_between if good else 0
        if good_frames * dt >= STAYS or frame * dt >= limit + STAYS:
            recovered = (frame - good_frames + frames_between) * dt
            in_time = good_frames > 0 and recovered <= limit
            last = error, ratios, strains
            return _Seen(last, recovered if in_time else None, peak, most, rescues)
        for _ in range(frames_between):
            solver.step(dt)
            rescues += solver.rescuing and not was_rescuing
            was_rescuing = solver.rescuing
        frame += frames_between
