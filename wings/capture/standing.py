"""Refuse or drop cameras that can't be right, though their errors in pixels are small.

Mapping keeps a camera that lost its points when wrong matches were removed, and it joins few
photographs by a few points each.  Four tests, none of which depends on the scale:

* The median photograph sees POINTS points.  Mapping places a photograph by at least as many
  matches: with fewer left, most of them were wrong.
* A camera that sees less than half as many, or is FAR from all others, is dropped.
* The cameras stand in LEAST_PLACES places.  Cameras that are nearer to each other than NEAR of
  their distance from the object see it from one side.  On a turntable before a still background,
  mapping follows the background, and all cameras stand in one place.
* They see SPAN degrees of the object: twice the angle at what they look at, between a camera and
  the mean one, of nine in ten.  From less, nothing has a depth.
"""

from dataclasses import replace

import numpy as np

from ...core.training import nearest_to_axes
from .mapping import Mapped
from .photos import CaptureError

POINTS = 30  # pycolmap's abs_pose_min_num_inliers
# The next ones are judgments: an overview from 10 times as far is kept, and so are 8 photographs.
FAR = 20.0  # times the upper quartile of distances from the median center
NEAR = 0.01  # of the distance from the object: 0.6° around it
LEAST_PLACES = 8  # all around they are 45° apart
SPAN = 10.0  # degrees
WANTED = 40  # photographs
MORE = f"take {WANTED} all around the object, each a small step from the last"


def checked(folder, total: int, mapped: Mapped) -> Mapped:
    """The cameras that may be right.

    Args:
        total: Photographs, with cameras or without.

    Raises:
        CaptureError: Most can't be right, or they stand in too few places.
    """
    found = f"the cameras of {len(mapped.numbers)} of {total} photographs in {folder}"
    advice = MORE if total >= WANTED else f"too few photographs: {MORE}"
    seen = np.median(mapped.seen)
    if seen < POINTS:
        cloth = ", on a patterned cloth or a newspaper" if total >= WANTED else ""
        raise CaptureError(
            f"{found} can't be trusted, since the median one sees {seen:.0f} points and {POINTS} "
            f"are needed: {advice}{cloth}"
        )
    centers = mapped.poses[:, :3, 3]
    mapped = chosen(mapped, ~astray(centers, mapped.seen))
    places = place_count(mapped.poses[:, :3, 3], NEAR * np.median(mapped.nearest))
    if places < LEAST_PLACES:
        raise CaptureError(
            f"{found} stand in {places} {'places' if places > 1 else 'place'}, and {LEAST_PLACES} "
            f"are needed: {advice}, and walk around it, or turn it before a camera that "
            f"does not move at all"
        )
    if (sees := span(mapped.poses, np.median(mapped.nearest))) < SPAN:
        raise CaptureError(
            f"{found} see {sees:.0f}° of the object, and {SPAN:.0f}° are needed: {advice}"
        )
    return mapped


def astray(centers, seen):
    """Which cameras are not known: they see hardly anything, or lie far from all others.  [n] bool

    Args:
        centers: [n, 3]
        seen: How many points each camera sees.  [n]
    """
    away = np.linalg.norm(centers - np.median(centers, axis=0), axis=1)
    return (2 * seen < POINTS) | (away > FAR * np.quantile(away, 0.75))


def place_count(centers, near: float) -> int:
    """How many of the centers are farther than `near` from each other.  [n, 3]"""
    count, left = 0, np.asarray(centers)
    while len(left):
        left = left[np.linalg.norm(left - left[0], axis=1) > near]
        count += 1
    return count


def span(poses, near: float) -> float:
    """Degrees of the object that nine in ten cameras see.

    Args:
        poses: [n, 4, 4]
        near: How far it is, if the cameras' axes are parallel.
    """
    center = nearest_to_axes(poses)
    if center is None:
        center = poses[:, :3, 3].mean(axis=0) - near * poses[:, :3, 2].mean(axis=0)
    ways = poses[:, :3, 3] - center
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
    mean = ways.mean(axis=0)
    cosines = ways @ mean / max(np.linalg.norm(mean), 1e-12)
    return float(2.0 * np.degrees(np.quantile(np.arccos(np.clip(cosines, -1.0, 1.0)), 0.9)))


def chosen(mapped: Mapped, which) -> Mapped:
    """Some of the cameras.  [n] bool"""
    names = ("numbers", "poses", "lenses", "seen", "nearest")
    return replace(mapped, **{name: getattr(mapped, name)[which] for name in names})
