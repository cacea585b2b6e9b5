"""The picture in the window, as tools see it: its camera, its pixels, and what lies under them.

Positions in the window are points, y up.  Pixels are the image's: x to the right, y down.
"""

from collections.abc import Callable

import numpy as np

from ..camera import Covered, camera_of, depth_at, in_free_part, onto_view_plane, point_at

CLICK_SLACK = 3.0  # points that the mouse may move during a click
NEAREST = 0.05  # object sizes between eye and surface, where the camera stops


class Viewport:
    """Where the picture is seen, and the mouse on it."""

    def __init__(self, viewpoint, depth_image: Callable):
        """Take what has the `orbit`, and a function that returns the depths or None."""
        self.size = (1, 1)  # of the image
        self.ratio = 1.0  # image pixels per point of the panels, which the user can make larger
        self.per_point = 1.0  # image pixels per point of the window
        self.covered = self.panels = Covered()  # of the window: in all, and by panels
        self.pointer = np.zeros(2)  # where the mouse is
        self.press_at = np.zeros(2)  # where the button went down
        self.depth_image = depth_image
        self.viewpoint = viewpoint
        self._camera = None, None, None  # its orbit, what else it follows from, and itself

    @property
    def camera(self):
        orbit, view = self.viewpoint.orbit, (self.size, self.covered, self.ratio)
        if orbit is not self._camera[0] or view != self._camera[1]:
            camera = in_free_part(camera_of(orbit, *self.size), self.covered, self.ratio)
            self._camera = orbit, view, camera
        return self._camera[2]

    def pixel(self, x, y):
        """From a position in the window to the middle of the image's pixel.  [2]"""
        return np.array([(x + 0.5) * self.per_point, self.size[1] - (y + 0.5) * self.per_point])

    def clicks(self, pixel) -> bool:
        """Whether a pixel is so near to the press that the mouse clicks, and doesn't drag."""
        return bool(np.linalg.norm(pixel - self.press_at) <= CLICK_SLACK * self.ratio)

    def surface_at(self, pixel, beside=True):
        """The object's point under a pixel; beside it, one as far away as its target, or None."""
        camera, depth = self.camera, self.depth_image()
        t = np.inf if depth is None else depth_at(depth, camera, pixel[None])[0]
        if np.isfinite(t):
            return point_at(camera, pixel, t)
        return onto_view_plane(camera, pixel, self.viewpoint.orbit.target) if beside else None

    def gap(self, size: float) -> float:
        """How far the eye can go without being in an object of that size; inf: any way."""
        depth = self.depth_image()
        if depth is None or self.camera.parallel:
            return np.inf
        return max(float(depth.min()) - NEAREST * size, 0.0)
