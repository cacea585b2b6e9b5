"""Bones drive some vertices, a solver moves the others.

The solver's frames are ticks of 1/60 s.  Its reset, grab, move, step and vertices are used.
"""

import numpy as np

from deformrf.core.deform import XpbdSolver
from deformrf.core.geometry import TetMesh
from deformrf.wings.rig import (
    BonePose,
    Method,
    Rig,
    driven_vertices,
    mixed,
    skinned,
)
from deformrf.wings.rig.skeleton import skinning_matrices
from deformrf.wings.rig.untangle import Untangler

TICK = 1.0 / 60.0  # s


def posed_with_physics(
    solver: XpbdSolver,
    mesh: TetMesh,
    rig: Rig,
    pose: BonePose,
    softness: float = 0.3,
    method: Method = "linear",
    ticks: int = 60,
    settle: int = 30,
) -> np.ndarray:
    """The vertices in a pose that is reached from rest, and held.  [V, 3] float64

    The bones move from rest to the pose in `ticks`, then the solver settles for `settle` more.
    Tets that are inverted after that are untangled.

    Args:
        solver: An XpbdSolver of that mesh.
    """
    ids = driven_vertices(mesh, rig.skeleton, softness)
    solver.reset()
    solver.grab(ids)
    rest = rig.skeleton.rest_pose
    offsets = None if rig.offsets is None else rig.offsets[ids]
    for tick in range(1, ticks + settle + 1):
        if tick <= ticks:
            between = mixed(rest, pose, tick / ticks)
            matrices = skinning_matrices(rig.skeleton, between)
            places, weights = mesh.rest_vertices[ids], rig.weights[ids]
            targets = skinned(places, weights, matrices, method, offsets)
        solver.move(targets)
        solver.step(TICK)
    vertices = solver.vertices.numpy().astype(float)
    solver.release()
    return Untangler(mesh)(vertices)
