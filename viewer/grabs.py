"""What the mouse holds: a patch of vertices, exactly or by springs, or a ball that pushes.

Shapes: V vertices, K vertices that are held.
"""

from dataclasses import dataclass

import numpy as np

from ..core.deform import falloff

# A patch of radius R of an elastic body with Young's modulus E (the one that the substeps
# hold) resists a pull like a spring of at most 2 E R: 0.8 E times the size for the largest
# grab radius.  Springs of 4 E times the size together therefore follow the mouse closely.
# Their force is limited to that of the patch at an eighth of the size, since thin parts
# would be torn long by more.
SOFT_STIFFNESS = 4.0  # of all springs of a drag together, in E times the object's size
SOFT_FORCE = 0.25  # of all of them, in E R times the object's size
LEAST_PULL = 1e-3  # of the strongest spring; weaker ones are left out


@dataclass
class Grab:
    """A drag in progress: `vertex` and those around it are moved, or pulled, as one body."""

    vertex: int
    ids: np.ndarray  # of the vertices that move along, `vertex` among them  [K]
    offsets: np.ndarray  # their positions relative to `vertex` when it was grabbed  [K, 3]
    target: np.ndarray  # target position of `vertex`  [3]
    reached: np.ndarray  # target of the steps so far  [3]
    before: tuple[np.ndarray, np.ndarray]  # positions and velocities of all vertices
    rest_lengths: np.ndarray | None  # of all edges, if the material yields


@dataclass
class Ball:
    """A ball that the mouse pushes with."""

    radius: float
    target: np.ndarray  # of its center  [3]
    reached: np.ndarray  # its center after the steps so far  [3]


def soft_springs(solver, vertex, ids, radius):
    """The vertices around `vertex` that a soft grab pulls, and their springs.

    Args:
        ids: Those within the radius [model units].  [K]

    Returns:
        ids; stiffnesses [N/m] and force limits [N].  [K], ([K], [K])
    """
    pull = falloff(solver.rest_vertices, vertex, ids, radius)
    ids, pull = ids[pull >= LEAST_PULL], pull[pull >= LEAST_PULL]
    share = solver.held_young_modulus() * solver.object_size * pull / pull.sum()
    radius = max(radius, solver.edges.rest_values.mean())
    return ids, (SOFT_STIFFNESS * share, SOFT_FORCE * radius * share)
