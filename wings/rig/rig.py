"""A rig: a skeleton, how much each bone moves each vertex, and clips; names of ways to skin.

Shapes: V vertices, B bones.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from .clips import Clip, VertexClip
from .skeleton import Skeleton

MOST_CLIPS = 1000
SUM_ERROR = 1e-4  # of a vertex's weights from 1; of its offsets from 0, if the longest is 1
FARTHEST = 1e6  # of a number in a file
Method = Literal["linear", "dual quaternion"]  # to move vertices by bones, see skinning.py
METHODS: tuple[Method, ...] = get_args(Method)


@dataclass(frozen=True)
class Rig:
    """What poses the vertices of one model.

    Raises:
        ValueError: These don't fit each other; one sentence.
    """

    skeleton: Skeleton
    weights: np.ndarray  # [V, B] float32, ≥ 0, rows that sum to 1
    clips: tuple[Clip | VertexClip, ...] = ()
    # [V, B, 3] float32, sums over bones are 0, and so is what has no weight (skinning.py); None: 0
    offsets: np.ndarray | None = None

    def __post_init__(self):
        check_weights(self.weights, self.skeleton)
        if self.offsets is not None:
            check_offsets(self.offsets, self.weights)
        if len(self.clips) > MOST_CLIPS:
            raise ValueError(f"the rig has {len(self.clips)} clips, more than {MOST_CLIPS}")
        names = [clip.name for clip in self.clips]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"the rig has two clips with the name {name!r}")
        for clip in self.clips:
            if isinstance(clip, Clip):
                clip.check(self.skeleton)
            elif clip.vertices.shape[1] != len(self.weights):
                raise ValueError(
                    f"clip {clip.name!r} moves {clip.vertices.shape[1]} vertices, but the rig "
                    f"has weights for {len(self.weights)}"
                )

    def clip(self, name: str) -> Clip | VertexClip:
        """The clip of that name; ValueError without one."""
        found = [clip for clip in self.clips if clip.name == name]
        if not found:
            others = ", ".join(clip.name for clip in self.clips) or "none"
            raise ValueError(f"the rig has no clip {name!r}; its clips: {others}")
        return found[0]


def check_method(method: str):
    if method not in METHODS:
        raise ValueError(f"skinning is {method!r}; it can be {' or '.join(METHODS)}")


def check_weights(weights: np.ndarray, skeleton: Skeleton) -> None:
    """ValueError unless weights are [V, B], not negative, and rows sum to 1."""
    if weights.ndim != 2 or weights.shape[1] != skeleton.bone_count:
        raise ValueError(
            f"the weights are {list(weights.shape)}; the skeleton has {skeleton.bone_count} bones"
        )
    if not ((weights >= 0.0) & (weights <= 1.0 + SUM_ERROR)).all():  # NaN fails, too
        vertex = int(np.argmin(((weights >= 0.0) & (weights <= 1.0 + SUM_ERROR)).all(axis=1)))
        raise ValueError(f"the weights of vertex {vertex} hold NaN, or leave 0 to 1")
    sums = weights.sum(axis=1, dtype=np.float64)
    wrong = np.abs(sums - 1.0) > SUM_ERROR
    if wrong.any():
        vertex = int(np.argmax(wrong))
        raise ValueError(
            f"the weights of vertex {vertex} sum to {sums[vertex]:.4g}, not 1 "
            f"({int(wrong.sum())} of {len(sums)} vertices do so); normalize them"
        )


def check_offsets(offsets: np.ndarray, weights: np.ndarray):
    """ValueError unless offsets are [V, B, 3], finite, 0 without weight, and sum to 0."""
    if offsets.shape != (*weights.shape, 3):
        raise ValueError(
            f"the offsets are {list(offsets.shape)}, but the weights are {list(weights.shape)}: "
            "offsets have three numbers for each weight"
        )
    good = (np.abs(offsets) <= FARTHEST).all(axis=(1, 2))  # NaN fails, too
    if not good.all():
        raise ValueError(
            f"the offsets of vertex {int(np.argmin(good))} hold NaN, or numbers beyond 1e6"
        )
    stray = (offsets.any(axis=2) & (weights == 0.0)).any(axis=1)
    if stray.any():
        raise ValueError(
            f"vertex {int(np.argmax(stray))} has an offset for a bone that has no weight there "
            f"({int(stray.sum())} of {len(stray)} vertices do so)"
        )
    sums = np.abs(offsets.sum(axis=1, dtype=np.float64)).max(axis=1)
    wrong = sums > SUM_ERROR * np.abs(offsets).max(initial=0.0)
    if wrong.any():
        vertex = int(np.argmax(wrong))
        raise ValueError(
            f"the offsets of vertex {vertex} sum to {sums[vertex]:.2g}, not 0 "
            f"({int(wrong.sum())} of {len(sums)} vertices do so)"
        )
