"""Which vertices follow the bones exactly, where physics moves the others.

Each bone has the vertices to which it is the nearest one.  Of these, the share 1 − softness that
is nearest to it follows; a few always do, so that no bone loses what it moves.
"""

import math

import numpy as np

from ...core.geometry import TetMesh
from .skeleton import Skeleton

FEWEST = 4  # vertices of a bone, which fix a rigid motion


def driven_vertices(mesh: TetMesh, skeleton: Skeleton, softness: float) -> np.ndarray:
    """The vertices that follow, sorted; all of them at softness 0.  [K] ids"""
    if not 0.0 <= softness <= 1.0:
        raise ValueError(f"the softness is {softness}; it is from 0 to 1")
    used = np.unique(mesh.tets)
    distances = np.stack(
        [
            _from_segment(mesh.rest_vertices[used], head, tail)
            for head, tail in zip(skeleton.heads, skeleton.tails, strict=True)
        ]
    )  # [B, N]
    nearest, found = distances.argmin(axis=0), []
    for bone in range(skeleton.bone_count):
        own = np.flatnonzero(nearest == bone)
        count = min(max(math.ceil((1.0 - softness) * len(own)), FEWEST), len(own))
        found.append(own[np.argsort(distances[bone, own], kind="stable")[:count]])
    return np.sort(used[np.concatenate(found)])


def _from_segment(points, head, tail):
    """The distances of points [N, 3] from the line between two.  [N]"""
    along = tail - head
    share = np.clip((points - head) @ along / max(along @ along, 1e-30), 0.0, 1.0)
    return np.linalg.norm(points - head - share[:, None] * along, axis=1)
