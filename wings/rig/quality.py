"""What a clip does to tets: volume ratios, inverted tets, per bone, and the worst place.

A tet belongs to the bone that has the largest weight in it.  Its volume ratio is its volume over
that at rest, negative if it is inverted.

Shapes: K times, B bones, T tets.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry import TetMesh
from .caches import FRAMES_PER_SECOND
from .clips import Clip, VertexClip
from .rig import Method, Rig
from .skinning import skinned
from .untangle import Untangler

MOST_FRAMES = 240


@dataclass(frozen=True)
class Worst:
    """The tet of smallest volume ratio."""

    seconds: float
    tet: int
    bone: int
    ratio: float
    place: np.ndarray  # [3] its middle at rest


@dataclass(frozen=True)
class TetQuality:
    """Of one clip."""

    times: np.ndarray  # [K] s
    smallest: np.ndarray  # [K] volume ratio
    inverted: np.ndarray  # [K] tets
    bone_smallest: np.ndarray  # [B] at any time; 1 for bones without tets
    bone_inverted: np.ndarray  # [B] tets that are inverted at any time
    bone_tets: np.ndarray  # [B] tets that belong to each bone
    worst: Worst
    worst_ratios: np.ndarray  # [T] at the time of the worst tet
    worst_vertices: np.ndarray  # [V, 3] at that time


def clip_quality(
    mesh: TetMesh,
    rig: Rig,
    clip: Clip | VertexClip,
    method: Method = "linear",
    times: ArrayLike | None = None,
    untangle: bool = False,
) -> TetQuality:
    """Play a clip and look at each tet.

    Args:
        times: Seconds [K]; None: 24 a second, at most 240.
        untangle: Whether poses are untangled first (untangle.py).
    """
    times = frame_times(clip.duration) if times is None else np.asarray(times, float)
    untangler = Untangler(mesh)
    bones = rig.weights[mesh.tets].sum(axis=1).argmax(axis=1)  # [T]
    lowest = np.full(mesh.tet_count, np.inf)
    smallest, inverted, worst = [], [], None
    for seconds in times.tolist():
        vertices = _clip_vertices(mesh, rig, clip, seconds, method)
        if untangle:
            vertices = untangler(vertices)
        ratios = untangler.ratios(vertices)
        smallest.append(ratios.min())
        inverted.append(int((ratios <= 0.0).sum()))
        if worst is None or ratios.min() < worst.ratio:
            tet = int(ratios.argmin())
            place = mesh.rest_vertices[mesh.tets[tet]].mean(axis=0)
            worst = Worst(seconds, tet, int(bones[tet]), float(ratios[tet]), place)
            worst_ratios, worst_vertices = ratios, vertices
        lowest = np.minimum(lowest, ratios)
    count = rig.skeleton.bone_count
    bone_smallest = np.ones(count)
    np.minimum.at(bone_smallest, bones, lowest)
    return TetQuality(
        times,
        np.array(smallest),
        np.array(inverted),
        bone_smallest,
        np.bincount(bones, lowest <= 0.0, count).astype(int),
        np.bincount(bones, minlength=count),
        worst,
        worst_ratios,
        worst_vertices,
    )


def _clip_vertices(mesh, rig, clip, seconds, method):
    """The vertices at a time of a clip, by skinning or from its frames.  [V, 3] float64"""
    if isinstance(clip, VertexClip):
        return clip.vertices_at(seconds).astype(float)
    matrices = clip.matrices_at(rig.skeleton, seconds)
    return skinned(mesh.rest_vertices, rig.weights, matrices, method, rig.offsets)


def frame_times(duration: float) -> np.ndarray:
    """Times of a clip, 24 a second, both ends included.  [K] s"""
    count = int(np.clip(np.ceil(duration * FRAMES_PER_SECOND), 0, MOST_FRAMES - 1))
    return np.linspace(0.0, duration, count + 1)
