"""Bones drive some vertices, a solver moves the others.

The solver is any object with XpbdSolver's reset, grab, move, step and vertices: this room knows no
dynamics.  Its frames are ticks of 1/60 s.
"""

import numpy as np

from ..geometry import TetMesh, components
from .laplacian import laplacian
from .rig import Rig
from .skeleton import Pose, Skeleton, mixed, skinning_matrices
from .skinning import Method, skinned
from .untangle import Untangler
from .weights import bone_distances

TICK = 1.0 / 60.0  # s
LEAST_SHARE = 0.02  # of a part's vertices that bones drive, however soft it is


def driven_vertices(mesh: TetMesh, skeleton: Skeleton, softness: float) -> np.ndarray:
    """The vertices that bones drive: of each part those nearest to them.  Ids [K], rising

    Args:
        softness: 0: all vertices follow the bones; 1: the least that holds the parts.

    Raises:
        ValueError: The softness is not from 0 to 1.
    """
    if not 0.0 <= softness <= 1.0:
        raise ValueError(f"the softness is {softness}; give a number from 0 to 1")
    if softness == 0.0:
        return np.arange(mesh.vertex_count)
    distances = bone_distances(mesh, laplacian(mesh), skeleton).min(axis=1)
    labels = components(mesh.vertex_count, mesh.tets)
    share = max(LEAST_SHARE, 1.0 - softness)
    driven = []
    for label in range(labels.max() + 1):
        members = np.flatnonzero(labels == label)
        count = max(min(4, len(members)), int(np.ceil(share * len(members))))
        nearest = np.argsort(distances[members], kind="stable")[:count]
        driven.append(members[nearest])
    return np.sort(np.concatenate(driven))


def posed_with_physics(
    solver,
    mesh: TetMesh,
    rig: Rig,
    pose: Pose,
    softness: float = 0.3,
    method: Method = "linear",
    ticks: int = 60,
    settle: int = 30,
) -> np.ndarray:
    """The vertices in a pose that is reached from rest, and held.  [V, 3] float64

    The bones move from rest to the pose in `ticks`, then the solver settles for `settle` more.
    Tets that are inverted after that are untangled (untangle.py).

    Args:
        solver: An XpbdSolver of that mesh.
    """
    ids = driven_vertices(mesh, rig.skeleton, softness)
    solver.reset()
    solver.grab(ids)
    rest = rig.skeleton.rest_pose
    for tick in range(1, ticks + settle + 1):
        if tick <= ticks:
            between = mixed(rest, pose, tick / ticks)
            matrices = skinning_matrices(rig.skeleton, between)
            targets = skinned(mesh.rest_vertices[ids], rig.weights[ids], matrices, method)
        solver.move(targets)
        solver.step(TICK)
    vertices = solver.vertices.numpy().astype(float)
    solver.release()
    return Untangler(mesh)(vertices)
