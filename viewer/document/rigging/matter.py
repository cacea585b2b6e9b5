"""Where the object is solid: a grid of voxels, filled where a ray that comes from outside ends.

Training drops what no photograph shows, so the inside of an opaque object may be empty, or hold
anything.  A voxel is *solid* unless it can be reached from outside without passing an occupied
sub-tet (core/field/occupancy.py); gaps up to two voxels wide count as closed.  All is at rest.
"""

import numpy as np

from ....core.field import SUBTET_COUNT, subtet_middles, unpack_mask
from ....core.geometry import signed_volumes

VOXELS = 96  # along the longest side, at most
WIDER = 1.5  # times the distance of neighbouring sub-tets, a voxel is at least
BORDER = 3  # empty voxels around the object
CLOSED = 1  # voxels by which occupied ones are widened, so that small gaps close
STEPS = 4  # a voxel, along a ray


class Matter:
    """What is solid of a field at rest."""

    def __init__(self, field):
        middles = subtet_middles(field.mesh)[unpack_mask(field.occupancy)]  # [N, 3]
        if not len(middles):
            middles = field.mesh.rest_vertices.astype(np.float32)
        low, high = middles.min(axis=0), middles.max(axis=0)
        volume = abs(signed_volumes(field.mesh.rest_vertices, field.mesh.tets)).mean()
        apart = float(np.cbrt(volume / SUBTET_COUNT))  # middles of sub-tets
        self.voxel = max(float((high - low).max()) / VOXELS, WIDER * apart)
        self._origin = low - (BORDER + 0.5) * self.voxel
        shape = np.ceil((high - self._origin) / self.voxel).astype(int) + BORDER + 1
        occupied = np.zeros(shape, bool)
        occupied[tuple(self._cells(middles).T)] = True
        closed = occupied
        for _ in range(CLOSED):
            closed = _widened(closed)
        outside = _reached(~closed)
        for _ in range(CLOSED):
            outside = _widened(outside)
        self.solid = ~outside | occupied

    def _cells(self, points):
        return np.floor((points - self._origin) / self.voxel).astype(int)

    def holds(self, points):
        """Whether points [N, 3] are in solid voxels.  [N] bool"""
        cells = self._cells(np.asarray(points, float))
        inside = ((cells >= 0) & (cells < self.solid.shape)).all(axis=1)
        cells = np.where(inside[:, None], cells, 0)
        return inside & self.solid[tuple(cells.T)]

    def middle(self, start, direction, surface: float):
        """The middle of the matter that a ray enters where it meets the surface.

        Args:
            start, direction: Of the ray; a unit vector.  [3]
            surface: How far from the start it meets what is seen.

        Returns:
            A point [3], and how far behind the surface the ray leaves the matter again; None
            if there is no matter within two voxels of the surface.
        """
        start, direction = np.asarray(start, float), np.asarray(direction, float)
        step = self.voxel / STEPS
        longest = float(np.linalg.norm(self.solid.shape)) * self.voxel
        t = surface - 2.0 * self.voxel + step * np.arange(int(longest / step))
        solid = self.holds(start + t[:, None] * direction)
        entered = np.flatnonzero(solid)
        if not len(entered) or t[entered[0]] > surface + 2.0 * self.voxel:
            return None
        left = np.flatnonzero(~solid[entered[0] :])
        end = entered[0] + (left[0] if len(left) else len(t) - 1 - entered[0])
        middle = 0.5 * (t[entered[0]] + t[end])
        return start + middle * direction, float(t[end] - surface)


def _widened(mask):
    """A mask of voxels and of those that share a face with them.

    What goes out at one side of the grid comes in at the other, which is alike: the border is
    all empty, and all outside.
    """
    return mask | np.any([np.roll(mask, by, axis) for axis in range(3) for by in (-1, 1)], axis=0)


def _reached(free):
    """The free voxels that a path of free voxels joins to the corner of the grid."""
    blocked = ~np.pad(free, 1)  # a border that no path leaves
    blocked[1, 1, 1] = True
    reached = np.zeros_like(blocked)
    _, rows, columns = blocked.shape
    sides = np.array([1, -1, columns, -columns, rows * columns, -rows * columns])
    flat, number = blocked.reshape(-1), np.zeros(blocked.size, np.int32)
    front = np.array([rows * columns + columns + 1])  # the corner
    while len(front):
        reached.reshape(-1)[front] = True
        near = (front[:, None] + sides).reshape(-1)
        near = near[~flat[near]]
        flat[near] = True
        number[near] = np.arange(len(near))
        front = near[number[near] == np.arange(len(near))]  # each once
    return reached[1:-1, 1:-1, 1:-1]
