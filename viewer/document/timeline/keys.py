"""Keys of a timeline: the camera or the pose at a tick, and what lies between two of them.

A key's easing is that of the way to the next key.  Shapes: V vertices.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass, fields, replace

import numpy as np

from ....core.deform import Material
from ....wings.rig import BonePose, Skeleton
from ....wings.rig import mixed as mixed_bones
from ...camera import CLOSEST, FARTHEST, Orbit

EASINGS = {  # the share of the way [0, 1] after a share of the time
    "linear": lambda share: share,
    "smooth": lambda share: share * share * (3.0 - 2.0 * share),  # slow at both keys
    "hold": lambda share: float(share >= 1.0),
}
MATERIAL_STEPS = 16  # from one key to the next: a change costs more than a step of the solver
LONGEST = 10 * 60 * 60  # ticks: ten minutes
ANGLES = "yaw", "roll"  # which turn the shorter way
STEEPEST = 0.5 * math.pi
LIMITS = {"distance": (CLOSEST, FARTHEST), "pitch": (-STEEPEST, STEEPEST)}  # of a spline, too


@dataclass(frozen=True, eq=False)
class CameraKey:
    """The camera at a tick."""

    tick: int
    orbit: Orbit
    easing: str = "smooth"


@dataclass(frozen=True, eq=False)
class Bones:
    """A pose that bones have given the object."""

    skeleton: Skeleton
    pose: BonePose


@dataclass(frozen=True, eq=False)
class PoseKey:
    """The object at a tick."""

    tick: int
    vertices: np.ndarray  # [V, 3] float32
    pinned: np.ndarray  # [V] bool
    held: np.ndarray  # pinned, or held by the mouse  [V] bool
    material: Material  # the real one
    easing: str = "smooth"
    bones: Bones | None = None  # None: a hand or the solver has made it


@dataclass(frozen=True, eq=False)
class SavedPose:
    """A pose that was saved under a name, and how much of it is blended in."""

    name: str
    vertices: np.ndarray  # [V, 3] float32
    weight: float = 0.0


def key_at(keys, tick: int):
    """The key at exactly that tick, or None."""
    return next((key for key in keys if key.tick == tick), None)


def with_key(keys, key) -> tuple:
    """These keys and another one, in the place of one that was at its tick; sorted."""
    others = [other for other in keys if other.tick != key.tick]
    return tuple(sorted([*others, key], key=lambda one: one.tick))


def around(keys, tick: float):
    """The last key until a tick, the next one, and the eased share of the way between them.

    Before the first key and after the last one, both are the same.
    """
    after = bisect_right([key.tick for key in keys], tick)
    if after in (0, len(keys)):
        only = keys[min(after, len(keys) - 1)]
        return only, only, 0.0
    first, second = keys[after - 1 : after + 1]
    share = (tick - first.tick) / (second.tick - first.tick)
    return first, second, EASINGS[first.easing](share)


# -- the camera --------------------------------------------------------------------------------


def orbit_at(keys, tick: float) -> Orbit:
    """The camera on its way through all keys: exactly at each, in a smooth curve between them.

    The curve is a cubic spline with the slopes of parabolas through three keys each; through
    keys on a line it is that line.
    """
    first, second, share = around(keys, tick)
    if share == 0.0:
        return first.orbit
    if share == 1.0:
        return second.orbit
    at = keys.index(first)
    near = keys[max(at - 1, 0) : at + 3]
    at = near.index(first)
    times = [key.tick for key in near]
    ways = [key.easing != "hold" for key in near[:-1]]  # whether one leads to the next key
    numbers = _numbers(near)
    for name in ANGLES:
        numbers[name] = list(np.unwrap(numbers[name]))
    values = {name: _spline(times, given, ways, at, share) for name, given in numbers.items()}
    for name, (low, high) in LIMITS.items():
        values[name] = min(max(values[name], low), high)
    for name in ANGLES:
        values[name] = (values[name] + math.pi) % (2.0 * math.pi) - math.pi
    return replace(first.orbit, **values)


def _numbers(keys):
    """What can be interpolated: of each such attribute, the values of all keys."""
    names = [f.name for f in fields(keys[0].orbit)]
    values = {name: [getattr(key.orbit, name) for key in keys] for name in names}
    kinds = int, float, np.floating, np.ndarray
    return {
        name: [np.asarray(one, float) for one in all_of]
        for name, all_of in values.items()
        if all(isinstance(one, kinds) and not isinstance(one, bool) for one in all_of)
    }


def _spline(times, values, ways, at, share):
    """The value between the keys `at` and `at` + 1."""
    lengths = np.diff(times)
    slopes = [way / length for way, length in zip(np.diff(values, axis=0), lengths, strict=True)]

    def slope(index):  # at a key
        sides = [i for i in (index - 1, index) if 0 <= i < len(ways) and ways[i]]
        if len(sides) == 2:
            before, after = lengths[index - 1], lengths[index]
            return (slopes[index - 1] * after + slopes[index] * before) / (before + after)
        return slopes[sides[0]]

    s, length = share, lengths[at]
    start, end = values[at], values[at + 1]
    bend = s * (1.0 - s) * length
    lead, lag = slope(at) - slopes[at], slope(at + 1) - slopes[at]
    value = (1.0 - s) * start + s * end + bend * ((1.0 - s) * lead - s * lag)
    return value if np.ndim(value) else float(value)


# -- the pose ----------------------------------------------------------------------------------


def vertices_at(keys, tick: float):
    """The eased blend of the two poses around a tick; exactly a key's at it.  [V, 3] float32"""
    first, second, share = around(keys, tick)
    return mixed(first.vertices, second.vertices, share)


def bones_at(keys, tick: float, skeleton) -> BonePose | None:
    """The eased blend of two poses of a skeleton's bones; None if a key around has none."""
    first, second, share = around(keys, tick)
    if any(key.bones is None or key.bones.skeleton is not skeleton for key in (first, second)):
        return None
    if share in (0.0, 1.0) or first is second:
        return (second if share == 1.0 else first).bones.pose
    return mixed_bones(first.bones.pose, second.bones.pose, share)


def mixed(start, end, share):
    """Positions on the straight way, exactly `start` at 0 and `end` at 1.  float32"""
    if share in (0.0, 1.0) or start is end:
        return end if share == 1.0 else start
    return np.float32(1.0 - share) * start + np.float32(share) * end


def material_at(keys, tick: float) -> Material:
    """The material on its way: moduli and densities by factors, ratios and rates by differences."""
    first, second, share = around(keys, tick)
    a, b = first.material, second.material
    share = round(share * MATERIAL_STEPS) / MATERIAL_STEPS
    if a == b or share == 0.0:
        return a
    values = {
        name: getattr(a, name) ** (1.0 - share) * getattr(b, name) ** share
        for name in ("young_modulus", "density")
    }
    for name in ("poisson_ratio", "damping"):
        values[name] = (1.0 - share) * getattr(a, name) + share * getattr(b, name)
    return b if share == 1.0 else replace(a, **values)


def blend(rest, poses):
    """The rest shape and, of each pose, its difference from it times its weight.  [V, 3]"""
    rest = np.asarray(rest, np.float32)
    moved = sum(np.float32(pose.weight) * (pose.vertices - rest) for pose in poses if pose.weight)
    return rest + moved
