"""Tools that delete: which sub-tets are under the brush, in a box or in a lasso.

A stroke of the brush goes by the view in which it began: it takes what was in front then, down
to a depth below the surface, so that each stroke takes one layer.  Pixels are the image's, x to
the right, y down.

Shapes: N sub-tets that are left.
"""

import numpy as np

from ...core.field import subtet_middles, unpack_mask
from ..camera import away_from_lines, depth_at, project, within
from ..document import masks_of
from ..settings import DELETING

BRUSH = DELETING[0]
LAYER = 0.5  # edges of a tet, that a stroke takes below the surface


class Seen:
    """The occupied sub-tets of a field, as a camera sees them."""

    def __init__(self, field, positions, camera, depth_image):
        """Take where its vertices are [V, 3], and the depths of the picture or None."""
        self._count = field.mesh.tet_count
        occupied = unpack_mask(field.occupancy)
        self.tets, self.subtets = np.nonzero(occupied)
        middles = subtet_middles(field.mesh, positions)[occupied]
        self.pixels, self._away = project(camera, middles)
        corners = positions[field.mesh.tets]
        edge = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).mean())
        surface = np.full(len(middles), np.inf)
        if depth_image is not None:
            surface = depth_at(depth_image, camera, np.nan_to_num(self.pixels, nan=-1.0))
        self.in_front = self._away <= surface + LAYER * edge
        self.in_front &= self._away > 0.0

    def near(self, start, end, radius: float):
        """Which are within a radius [pixels] of the way from one pixel to another.  ids"""
        start, end = np.asarray(start, float), np.asarray(end, float)
        low, high = np.minimum(start, end) - radius, np.maximum(start, end) + radius
        x, y = self.pixels.T
        ids = np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
        return ids[away_from_lines(self.pixels[ids], start, end) <= radius]

    def inside(self, outline):
        """Which are inside a closed outline of pixels [K, 2], in the view.  [N] bool"""
        return within(np.nan_to_num(self.pixels, nan=-1e9), outline) & (self._away > 0.0)

    def masks(self, chosen):
        """These, ids or [N] bool, as masks.  [T] uint64"""
        return masks_of(self.tets[chosen], self.subtets[chosen], self._count)


def said(cuts, delete) -> str:
    """Call a function that deletes, and say what came of it."""
    pins = cuts.state()["pins"]
    try:
        if not delete():
            return "nothing to delete there"
    except ValueError as error:  # nothing would be left
        return str(error)
    line = f"{int(cuts.kept.sum()):,} of {len(cuts.kept):,} tets are left"
    if cuts.state()["pins"] is not pins:
        line += "; its pins were deleted: now its lowest part is pinned"
    return line


def found_box(field):
    """The box that training found around a field's object, at rest; None without one.  [2, 3]"""
    box = field.meta.get("object_box")
    return None if box is None else np.array(box, float)
