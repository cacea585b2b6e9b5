"""Where a scene is looked at from: the orbit, the first view, the object in the frame."""

from dataclasses import replace

import numpy as np

from . import orbit as orbits
from .surface import bounds

MARGIN = 0.62  # of a framed object's size: the radius of the ball that fills the image
DEPTH_PART = 0.75  # of its size, that the object may reach from its center towards the eye
FIRST_VIEW = orbits.Orbit(yaw=np.radians(30.0), pitch=np.radians(14.0))


class Viewpoint:
    """The camera of one scene; `orbit` is what it is now."""

    def __init__(self, scene):
        self._scene = scene
        self.home()

    def home(self) -> None:
        """The first view: the whole object at rest."""
        scene = self._scene
        self.orbit = orbits.framing(FIRST_VIEW, scene.center, MARGIN * scene.size)

    def focus(self) -> None:
        """Frame the object as it is now, or turn about the vertex under the mouse."""
        scene = self._scene
        if scene.handles.hover is not None:
            (target,) = scene.handles.at([scene.handles.hover])
            self.orbit = replace(self.orbit, target=target)
            return
        low, high = bounds(scene.seen_points)
        radius = MARGIN * float((high - low).max())
        self.orbit = orbits.framing(self.orbit, 0.5 * (low + high), radius)

    @property
    def depth_range(self) -> tuple[float, float]:
        """Distances from the eye between which the object lies at rest, whatever its shape."""
        scene = self._scene
        away = float(np.linalg.norm(orbits.pose(self.orbit)[:3, 3] - scene.center))
        return max(away - DEPTH_PART * scene.size, 0.0), away + DEPTH_PART * scene.size
