"""The object in what the panel leaves free of the window.

An orbit says nothing of windows and panels: its films show the target in the middle.  In the
window, the axis of view goes through the middle of what is free, and the picture is scaled so
that what fitted into the whole fits there.
"""

from dataclasses import replace
from typing import NamedTuple

from ...core.render import Camera

SMALLEST_SHARE = 0.3  # of the width or height: less is not used


class Covered(NamedTuple):
    """How much of the window panels cover from each of its edges [points]."""

    left: float = 0.0
    top: float = 0.0
    right: float = 0.0
    bottom: float = 0.0


def free_part(size, covered: Covered, ratio: float = 1.0):
    """Left, top, width and height of what is not covered; of all, if that is too little [pixels].

    Args:
        size: Of the image [pixels].
    """
    left, top, right, bottom = (ratio * side for side in covered)
    width, height = size[0] - left - right, size[1] - top - bottom
    if width < SMALLEST_SHARE * size[0] or height < SMALLEST_SHARE * size[1]:
        return 0.0, 0.0, float(size[0]), float(size[1])
    return left, top, width, height


def in_free_part(camera: Camera, covered: Covered, ratio: float = 1.0) -> Camera:
    """The camera of an image, for what is not covered of it.

    Args:
        ratio: Pixels of the image per point.
    """
    left, top, width, height = free_part((camera.width, camera.height), covered, ratio)
    if (width, height) == (camera.width, camera.height):
        return camera
    scale = min(width, height) / camera.height  # what is framed fills the height
    (fx, fy), (cx, cy) = camera.lens.focal, camera.lens.center
    center = cx + left + 0.5 * (width - camera.width), cy + top + 0.5 * (height - camera.height)
    return replace(camera, lens=replace(camera.lens, focal=(scale * fx, scale * fy), center=center))


def film_frame(size, covered: Covered, aspect: float):
    """What a film of the view shows: left, top, width and height in the window [points].

    It is as high as what is framed.  A wide one may go on under the panels.

    Args:
        size: Of the window [points].
        aspect: Of the film, width over height.
    """
    left, top, width, height = free_part(size, covered)
    high = height if (width, height) == tuple(size) else min(width, height)
    wide = aspect * high
    return left + 0.5 * (width - wide), top + 0.5 * (height - high), wide, high
