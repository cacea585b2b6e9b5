"""Cases that bring a body into a state from which a solver may not return.

A case starts a body somewhere, may then drive it, and lets it go.  Random numbers come
from the generator that is passed alone.  Shapes: V vertices, T tets, K handles.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....core.deform import TIME_STEP, control_vertices
from ....core.geometry import boundary_faces, tet_neighbours

FAR = 100.0  # sizes
SHAKE_RATE = 30.0  # Hz
SHAKE_SECONDS = 1.0
SHAKE_AMPLITUDE = 0.15  # sizes
MASS_RATIO = 1e6
LEAST_TETS = 20


def scaled(*factors):
    """A start: the body at rest, scaled by factors around its middle."""

    def start(rest, rng):
        middle = rest.mean(axis=0)
        return middle + (rest - middle) * factors

    return start


def at_rest(rest, rng):
    """A start: exactly the rest shape."""
    return rest.copy()


def random(rest, rng):
    """A start: each vertex anywhere in the bounding box."""
    return rng.uniform(rest.min(axis=0), rest.max(axis=0), rest.shape)


STARTS = {  # (rest [V, 3], generator) -> [V, 3]
    "at rest": at_rest,
    "plane": scaled(1, 1, 0),
    "line": scaled(1, 0, 0),
    "point": scaled(0, 0, 0),
    "mirrored": scaled(-1, 1, 1),
    "random": random,
    "squashed": scaled(1, 1, 0.3),
}


def drag_far(solver, dt, rng):
    """One vertex, 100 sizes away at once; yields before each step, as does `shake`."""
    handles = control_vertices(solver.rest_vertices, solver.tets)
    handle = handles[~solver.pinned[handles]][:1]
    solver.grab(handle)
    solver.move(solver.rest_vertices[handle] + FAR * solver.object_size * _directions(rng, 1))
    yield


def shake(solver, dt, rng):
    """All control vertices, each to and fro along its own line."""
    handles = control_vertices(solver.rest_vertices, solver.tets)
    way = SHAKE_AMPLITUDE * solver.object_size * _directions(rng, len(handles))
    solver.grab(handles)
    for frame in range(round(SHAKE_SECONDS / dt)):
        # A cosine: at 60 frames a second the sine of 30 Hz is always 0.
        phase = np.cos(2.0 * np.pi * SHAKE_RATE * dt * frame)
        solver.move(solver.rest_vertices[handles] + phase * way)
        yield


def _directions(rng, count):
    ways = rng.normal(size=(count, 3))
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)


def with_broken_tets(rest, tets, rng):
    """A mesh with tets that are inside out or have no volume at rest.

    Every 20th tet is listed inside out.  Of two inner vertices, one lies on a neighbor and
    one is pushed past a neighbor.  One vertex more belongs to a flat tet alone, so that it
    has no mass, and one tet names two corners twice.

    Returns:
        Rest vertices [V + 1, 3] and tets [T + 2, 4].
    """
    rest, tets = np.array(rest), np.array(tets)
    outside, _ = boundary_faces(tets, tet_neighbours(tets))
    inner = np.setdiff1d(tets, outside)
    if len(inner) < 2:  # a thin body
        inner = np.unique(tets)
    one, two = rng.choice(inner, 2, replace=False)
    for vertex, other, share in ((one, two, 1.5), (two, one, 1.0)):
        around = np.setdiff1d(tets[(tets == vertex).any(axis=1)], [vertex, other])
        rest[vertex] += share * (rest[rng.choice(around)] - rest[vertex])
    tets[::20] = tets[::20][:, [0, 1, 3, 2]]
    face = outside[rng.integers(len(outside))]
    added = [[*face, len(rest)], tets[0][[0, 0, 1, 1]]]
    return np.concatenate([rest, rest[face].mean(axis=0)[None]]), np.concatenate([tets, added])


def uneven_masses(masses, rng):
    """Half of the vertices, at random, a million times as heavy.  [V]"""
    return np.where(rng.random(len(masses)) < 0.5, MASS_RATIO, 1.0) * masses


@dataclass(frozen=True)
class StressCase:
    """One way to break a body."""

    name: str
    start: str = "at rest"  # a key of STARTS
    drive: Callable | None = None  # moves handles, as drag_far; the foot is pinned, else free
    dt: float = TIME_STEP  # of a frame [s]
    broken_tets: bool = False
    uneven: bool = False  # masses differ by 1e6; then it is enough that the body stays finite

    def suits(self, tets) -> bool:
        """Whether a body has enough tets: to hold some and drag others, or break some."""
        return len(tets) >= LEAST_TETS or not (self.drive or self.broken_tets or self.uneven)


CASES = (
    *(StressCase(name, name) for name in ("plane", "line", "point", "mirrored", "random")),
    StressCase("drag 100x", drive=drag_far),
    StressCase("shake 30 Hz", drive=shake),
    StressCase("dt 1/5 s", "random", dt=0.2),
    StressCase("dt 1 s", "random", dt=1.0),
    StressCase("broken tets", "random", broken_tets=True),
    StressCase("mass ratio 1e6", "squashed", uneven=True),
)
