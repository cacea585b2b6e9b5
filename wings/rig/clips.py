"""Clips: bones, or all vertices, over time.

A channel animates one property of one bone by keys, interpolated as glTF 2.0 defines it
(appendix C of its specification).  With t between the keys t_k and t_{k+1}, d = t_{k+1} − t_k
and s = (t − t_k) / d:

    STEP         v_k
    LINEAR       (1 − s) v_k + s v_{k+1}; for rotations the slerp of both
    CUBICSPLINE  (2s³ − 3s² + 1) v_k + d (s³ − 2s² + s) b_k
                 + (3s² − 2s³) v_{k+1} + d (s³ − s²) a_{k+1}
                 a, v, b: in-tangent, value, out-tangent of a key; rotations are normalized

Before the first key its value holds, after the last key the last one.  Times are seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from . import rotations
from .skeleton import BonePose, Skeleton, check_name, pose_of, skinning_matrices

PATHS = ("translation", "rotation", "scale")
INTERPOLATIONS = ("STEP", "LINEAR", "CUBICSPLINE")
LONGEST_CLIP = 86400.0  # s
LARGEST_VALUE = 1e6
LOST = 1e-3  # of skinning matrices that no pose gives; see clip_of_matrices


@dataclass(frozen=True)
class Channel:
    """One property of one bone over time.

    Raises:
        ValueError: The arrays are no channel; one sentence.
    """

    bone: int
    path: str  # of PATHS
    interpolation: str  # of INTERPOLATIONS
    times: np.ndarray  # [K] float64, rising [s]
    values: np.ndarray  # [K, 3 or 4]; CUBICSPLINE: [K, 3, 3 or 4] in-tangents, values, out-tangents

    def __post_init__(self):
        if self.path not in PATHS or self.interpolation not in INTERPOLATIONS:
            raise ValueError(
                f"a channel is called {self.path!r} and {self.interpolation!r}; it can be "
                f"{', '.join(PATHS)} and {', '.join(INTERPOLATIONS)}"
            )
        check_times(self.times, f"the keys of a {self.path}")
        width = 4 if self.path == "rotation" else 3
        inner = (3, width) if self.interpolation == "CUBICSPLINE" else (width,)
        if self.values.shape != (len(self.times), *inner):
            raise ValueError(
                f"a {self.path} of {len(self.times)} keys has values {list(self.values.shape)}, "
                f"not {[len(self.times), *inner]}"
            )
        if not (np.abs(self.values) <= LARGEST_VALUE).all():  # NaN fails, too
            raise ValueError(f"the keys of a {self.path} hold NaN, or numbers beyond 1e6")


def interpolated(channel: Channel, values, seconds: float) -> np.ndarray:
    """What the keys of a channel say at a time; `values` may be those of several that go alike.

    Args:
        values: [K, ..., 3 or 4]; CUBICSPLINE: [K, ..., 3, 3 or 4].
    """
    times, turns = channel.times, channel.path == "rotation"
    after = int(times.searchsorted(seconds, side="right"))
    k, following = max(after - 1, 0), min(after, len(times) - 1)
    span = float(times[following] - times[k])
    share = (seconds - times[k]) / span if span > 0.0 else 0.0
    first, second = values[k], values[following]
    if channel.interpolation == "CUBICSPLINE":
        s = share
        value = (2 * s**3 - 3 * s**2 + 1) * first[..., 1, :]
        value = value + (3 * s**2 - 2 * s**3) * second[..., 1, :]
        if span > 0.0:
            value = value + span * (s**3 - 2 * s**2 + s) * first[..., 2, :]
            value = value + span * (s**3 - s**2) * second[..., 0, :]
    elif channel.interpolation == "STEP" or share == 0.0:
        value = first
    elif turns:
        return rotations.slerp(rotations.unit(first), rotations.unit(second), share)
    else:
        value = (1.0 - share) * first + share * second
    return rotations.unit(value) if turns else np.array(value, float)


@dataclass(frozen=True)
class Clip:
    """An animation of a skeleton's bones.  Bones without a channel keep their rest pose."""

    name: str
    duration: float  # s
    channels: tuple[Channel, ...]

    def __post_init__(self):
        check_name(self.name, "clip")
        if not 0.0 <= self.duration <= LONGEST_CLIP:
            raise ValueError(f"clip {self.name!r} lasts {self.duration} s, not 0 to a day")
        last = max((float(c.times[-1]) for c in self.channels), default=0.0)
        if last > self.duration:
            raise ValueError(f"clip {self.name!r} lasts {self.duration} s, its keys {last} s")
        targets = [(c.bone, c.path) for c in self.channels]
        if len(set(targets)) < len(targets):
            raise ValueError(f"clip {self.name!r} animates a bone's {'/'.join(PATHS)} twice")

    def check(self, skeleton: Skeleton) -> None:
        """ValueError if the clip animates a bone that the skeleton has not."""
        for channel in self.channels:
            if not 0 <= channel.bone < skeleton.bone_count:
                raise ValueError(
                    f"clip {self.name!r} animates bone number {channel.bone}, but the skeleton "
                    f"has {skeleton.bone_count}"
                )

    def pose_at(self, skeleton: Skeleton, seconds: float) -> BonePose:
        rest = skeleton.rest_pose
        arrays = {
            "translation": rest.translations.copy(),
            "rotation": rest.rotations.copy(),
            "scale": rest.scales.copy(),
        }
        for channel, bones, values in self._alike:
            arrays[channel.path][bones] = interpolated(channel, values, seconds)
        return BonePose(*(arrays[path] for path in PATHS))

    @cached_property
    def _alike(self):
        """Channels that differ in their bones and values alone: one, bones [C], values [K, C, ...].

        Most clips have three such groups, and a pose is wanted in every frame.
        """
        groups = {}
        for channel in self.channels:
            key = channel.path, channel.interpolation, channel.times.tobytes()
            groups.setdefault(key, []).append(channel)
        return [
            (some[0], [one.bone for one in some], np.stack([one.values for one in some], axis=1))
            for some in groups.values()
        ]

    def matrices_at(self, skeleton: Skeleton, seconds: float) -> np.ndarray:
        """Skinning matrices.  [B, 4, 4]"""
        return skinning_matrices(skeleton, self.pose_at(skeleton, seconds))


@dataclass(frozen=True)
class VertexClip:
    """All vertices of a model over time, as point caches store them."""

    name: str
    times: np.ndarray  # [K] float64, rising [s]
    vertices: np.ndarray  # [K, V, 3] float32, model space

    def __post_init__(self):
        check_name(self.name, "clip")
        check_times(self.times, f"the frames of clip {self.name!r}")
        if self.vertices.ndim != 3 or self.vertices.shape[::2] != (len(self.times), 3):
            raise ValueError(
                f"clip {self.name!r} has {len(self.times)} times and vertices "
                f"{list(self.vertices.shape)}, not [times, vertices, 3]"
            )
        if not (np.abs(self.vertices) <= LARGEST_VALUE).all():
            raise ValueError(f"clip {self.name!r} holds NaN, or vertices beyond 1e6")

    @property
    def duration(self) -> float:
        return float(self.times[-1])

    def vertices_at(self, seconds: float) -> np.ndarray:
        """Between frames on straight lines.  [V, 3] float32"""
        after = int(np.searchsorted(self.times, seconds, side="right"))
        k, following = max(after - 1, 0), min(after, len(self.times) - 1)
        span = self.times[following] - self.times[k]
        share = np.float32((seconds - self.times[k]) / span if span > 0.0 else 0.0)
        if share == 0.0:
            return self.vertices[k]
        return (1 - share) * self.vertices[k] + share * self.vertices[following]


def clip_of_poses(name: str, times: np.ndarray, poses: Sequence[BonePose]) -> Clip:
    """A clip with a key of every bone at each time; what never changes has one key."""
    times = np.array(times, float)
    channels = []
    for path in PATHS:
        values = np.array([getattr(pose, f"{path}s") for pose in poses], float)  # [K, B, n]
        for bone in range(values.shape[1]):
            keys = values[:, bone]
            count = len(times) if (keys != keys[0]).any() else 1
            channels.append(Channel(bone, path, "LINEAR", times[:count], keys[:count]))
    return Clip(name, float(times[-1]) if len(times) else 0.0, tuple(channels))


def clip_of_matrices(name: str, skeleton: Skeleton, times: ArrayLike, matrices: ArrayLike) -> Clip:
    """A clip from skinning matrices [K, B, 4, 4] in the skeleton's space.

    Raises:
        ValueError: They aren't finite, or a bone shears, which poses can't say.
    """
    matrices = np.asarray(matrices, float)
    wanted = (len(times), skeleton.bone_count, 4, 4)
    if matrices.shape != wanted or not (np.abs(matrices) <= LARGEST_VALUE).all():
        raise ValueError(
            f"the skinning matrices of clip {name!r} are {list(matrices.shape)} or hold NaN; "
            f"they have to be {list(wanted)} of finite numbers"
        )
    poses = []
    for k, these in enumerate(matrices):
        frames = these @ skeleton.rest
        singular = np.abs(np.linalg.det(frames[:, :3, :3])) < 1e-9
        if not singular.any():
            pose = pose_of(skeleton, frames)
            lost = np.abs(skinning_matrices(skeleton, pose) - these).max(axis=(1, 2))
            singular = lost > LOST * np.maximum(1.0, np.abs(these).max(axis=(1, 2)))
        if singular.any():
            raise ValueError(
                f"frame {k} of clip {name!r} flattens or shears bone "
                f"{skeleton.names[int(np.argmax(singular))]!r}, which a pose can't hold"
            )
        poses.append(pose)
    return clip_of_poses(name, times, poses)


def phase(duration: float, seconds: float) -> float:
    """The time within a clip that is played again and again, after so many seconds."""
    return float(seconds % duration) if duration > 0.0 else 0.0


def check_times(times: np.ndarray, whose: str):
    """ValueError if times are not finite, rising numbers from 0 to a day."""
    if times.ndim != 1 or len(times) == 0:
        raise ValueError(f"{whose} have no times")
    if not ((times >= 0.0) & (times <= LONGEST_CLIP)).all():
        raise ValueError(f"{whose} have times that are not between 0 and {LONGEST_CLIP:g} s")
    if (np.diff(times) <= 0.0).any():
        k = int(np.argmax(np.diff(times) <= 0.0))
        raise ValueError(f"{whose} are not in order: {times[k + 1]:g} s after {times[k]:g} s")
