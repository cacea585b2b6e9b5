"""From where photographs look at the object, what is far from all of them, and what to take next.

Directions are those from the point that the cameras look at, in a frame in which the first
photograph is taken from the front: x is to its right, y behind the object, z up.  How well a
direction is seen is told by its angle to the nearest photograph:

    angle(d) = min over photographs p of arccos(d · p)

What is farther than FAR from all of them is said, once for each region that hangs together, and
wide steps around the object, too.  An object that stands is not seen from below level: there
nothing is missed, unless some photographs are taken from there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.training import (
    AROUND,
    STEEP,
    DatasetError,
    angles_to_nearest,
    directions_from,
    focus,
    up_of,
    upright,
    widest_step,
)

NEAR, FAR = 20.0, 45.0  # degrees to the nearest photograph: well seen, hardly seen
GAP = 60.0  # degrees around the object without a photograph, from which it is told
BELOW, BELOW_SHARE = -20.0, 0.1  # if so many are from lower, the object does not stand
STEP = 15.0  # degrees from a photograph to the next, that are advised
RING_STEP, RING_TOP = 30.0, 60.0  # degrees from a ring to the next, and up to the highest
LOPSIDED = 0.3  # of its distance from the axis: a region's middle is nearer if it goes around
COUNT = 2000  # directions that are asked, 4.5° from each other
TOUCH = 7.0  # degrees between directions that hang together
LEAST = 0.006  # of the sphere: a spot of 9° around its middle, below which nothing is said
SIDES = (
    "the right",
    "behind on the right",
    "behind",
    "behind on the left",
    "the left",
    "the front left",
    "the front",
    "the front right",
)  # each 45° on from the last, from +x


@dataclass(frozen=True)
class Around:
    """Photographs around an object.

    Attributes:
        names: Of their files.  [n]
        center: What they look at, in the world.  [3]
        turn: From the world to this module's frame.  [3, 3]
        directions: From the center to each photograph, in the frame.  [n, 3]
    """

    names: tuple[str, ...]
    center: np.ndarray
    turn: np.ndarray
    directions: np.ndarray


@dataclass(frozen=True)
class Gap:
    """Where photographs are missing.

    Attributes:
        sentence: That says where, and what to take.
        middle: A direction in it, in the frame.  [3]
        names: Of the photographs that the sentence names.
    """

    sentence: str
    middle: np.ndarray
    names: tuple[str, ...] = ()


def around(names: Sequence[str], poses) -> Around | None:
    """Where photographs look from; None if no point is what most of them look at.

    Args:
        poses: Camera to world, OpenGL's axes.  [n, 4, 4]
    """
    poses = np.array(poses, float).reshape(-1, 4, 4)
    if len(poses) < 2:
        return None
    try:
        center = focus(poses)
    except DatasetError:
        return None
    turn = upright(up_of(poses))
    directions = directions_from(center, poses)
    x, y, _ = turn @ directions[0]
    length = np.hypot(x, y)
    if length > 1e-6:
        turn = np.array([(-y, x, 0.0), (-x, -y, 0.0), (0.0, 0.0, length)]) / length @ turn
    return Around(tuple(names), center, turn, directions @ turn.T)


def azimuths(directions):
    """Degrees from the frame's +x towards +y.  [..., 3] -> [...]"""
    return np.degrees(np.arctan2(directions[..., 1], directions[..., 0]))


def elevations(directions):
    """Degrees above level.  [..., 3] -> [...]"""
    return np.degrees(np.arcsin(np.clip(directions[..., 2], -1.0, 1.0)))


def direction(azimuth: float, elevation: float):
    """The opposite of `azimuths` and `elevations`.  [3]"""
    a, e = np.radians((azimuth, elevation))
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


def side_of(azimuth: float) -> str:
    """Words for where a direction is."""
    return SIDES[round(azimuth / 45.0) % len(SIDES)]


def lowest(view: Around) -> float:
    """Degrees above level, below which no photograph is missed."""
    stands = np.quantile(elevations(view.directions), BELOW_SHARE) > BELOW
    return 0.0 if stands else -90.0


def gaps(view: Around) -> list[Gap]:
    """What to photograph next; nothing if nothing is missing."""
    steps = steps_around(view)
    found = [step.gap for step in steps]
    asked = lattice()
    up = elevations(asked)
    missing = (angles_to_nearest(asked, view.directions) > FAR) & (up >= lowest(view))
    is_pole = (up > RING_TOP) & is_open(view, 1.0) | (up < -RING_TOP) & is_open(view, -1.0)
    for step in steps:
        inside = (azimuths(asked) - step.begin) % 360.0 < step.width
        missing &= ~inside | is_pole
    for part in parts(asked, missing):
        if len(part) >= LEAST * len(asked):
            found.append(hole(view, part))
    return found


def is_open(view: Around, sign: float) -> bool:
    """Whether straight above (sign 1) or below (-1) is far from all photographs."""
    return bool((sign * elevations(view.directions)).max() < 90.0 - FAR)


@dataclass(frozen=True)
class WideStep:
    """A wide step around the object: where it begins and how wide it is [degrees]."""

    gap: Gap
    begin: float
    width: float


def steps_around(view: Around) -> list[WideStep]:
    """Wide steps between neighbors around the object; the widest if they see one side of it."""
    level = np.abs(elevations(view.directions)) < STEEP
    rows = np.flatnonzero(level if level.mean() > 0.5 else np.ones_like(level))
    turned = azimuths(view.directions[rows])
    order = np.argsort(turned)
    steps = np.diff(turned[order], append=turned[order[0]] + 360.0)
    sees = 360.0 - widest_step(turned)
    wide = [int(steps.argmax())] if sees < AROUND else np.flatnonzero(steps > GAP).tolist()
    height = float(np.clip(np.median(elevations(view.directions[rows])), 0.0, RING_TOP))
    found = []
    for i in wide:
        one, other = (view.names[rows[order[k % len(order)]]] for k in (i, i + 1))
        begin, width = float(turned[order[i]]), float(steps[i])
        side = side_of(begin + 0.5 * width)
        more = math.ceil(width / STEP - 1e-6) - 1
        sentence = (
            f"the cameras see {sees:.0f}° of the object: its back stays unknown; if you can walk "
            f"on around it, take {more} more on the way from {one} to {other}"
            if sees < AROUND
            else f"no photograph is taken from {side} ({width:.0f}° between {one} and {other}): "
            f"take {more} more there"
        )
        middle = direction(begin + 0.5 * width, height)
        found.append(WideStep(Gap(sentence, middle, (one, other)), begin, width))
    return found


def hole(view: Around, part) -> Gap:
    """What to photograph in a region that hangs together.

    Args:
        part: Its directions.  [m, 3]
    """
    up, middle = elevations(part), part.mean(axis=0)
    if up.max() > 90.0 - TOUCH and is_open(view, 1.0):
        return cap(view, 1.0, "above", "top")
    if up.min() < TOUCH - 90.0 and is_open(view, -1.0):
        return cap(view, -1.0, "below", "underside")
    if np.linalg.norm(middle[:2]) < LOPSIDED * np.cos(np.radians(up.mean())):
        at, seen = round_5(up.mean()), elevations(view.directions)
        than = (
            f"more than {seen.max():.0f}°" if at > seen.mean() else f"less than {seen.min():.0f}°"
        )
        sentence = f"no photograph is taken from {than} above level: take a ring of them at {at}°"
        return Gap(sentence, direction(-90.0, at))
    middle /= np.linalg.norm(middle)
    nearest = int((view.directions @ middle).argmax())
    away = angles_to_nearest(middle, view.directions)
    at, side = round_5(elevations(middle)), side_of(azimuths(middle))
    where = f"{abs(at)}° {'above' if at > 0 else 'below'} level" if at else "level"
    more = math.ceil(len(part) / len(lattice()) * 4.0 * np.pi / np.radians(NEAR) ** 2)
    name = view.names[nearest]
    return Gap(
        f"no photograph is taken from {side}, {where} (the nearest, {name}, is {away:.0f}° away): "
        f"take {more} more there",
        middle,
        (name,),
    )


def cap(view: Around, sign: float, word: str, what: str) -> Gap:
    """What to photograph of the top (sign 1) or the underside (sign -1)."""
    last = float((sign * elevations(view.directions)).max())
    count = max(math.ceil((RING_TOP - max(last, 0.0)) / RING_STEP - 0.2), 1)
    rings = [last + (RING_TOP - last) * (k + 1) / count for k in range(count)]
    at = " and ".join(f"{round_5(ring)}°" for ring in rings)
    than = f"more than {last:.0f}° {word} level" if last > 0.0 else word
    ring = f"a ring at {at}" if count == 1 else f"rings at {at}"
    each = "" if count == 1 else " each"
    number = math.ceil(360.0 * math.cos(math.radians(RING_TOP)) / STEP - 1e-6)
    return Gap(
        f"no photograph is taken from {than}: take {ring}, of some {number} photographs{each}, "
        f"which show the {what}",
        np.array([0.0, 0.0, sign]),
    )


def round_5(angle: float) -> int:
    return 5 * round(float(angle) / 5.0)


def lattice():
    """Directions spread evenly over the sphere.  [COUNT, 3]"""
    number = np.arange(COUNT) + 0.5
    z = 1.0 - 2.0 * number / COUNT
    turned = np.pi * (1.0 + np.sqrt(5.0)) * number
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(turned), flat * np.sin(turned), z], axis=-1)


def parts(directions, which) -> list:
    """Regions of the directions in question that hang together, the largest first.  [m, 3] each"""
    chosen = directions[which]
    touching = chosen @ chosen.T > np.cos(np.radians(TOUCH))
    left, found = np.ones(len(chosen), bool), []
    while left.any():
        reached = np.zeros(len(chosen), bool)
        edge = np.arange(len(chosen)) == left.argmax()
        while edge.any():
            reached |= edge
            edge = touching[edge].any(axis=0) & ~reached
        left &= ~reached
        found.append(chosen[reached])
    return sorted(found, key=len, reverse=True)
