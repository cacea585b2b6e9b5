"""What drags do to the camera: they turn it about its target, or move it along."""

from ..camera import camera_of, panned, turned
from .tool import Tool


class CameraMove(Tool):
    """A drag that turns or moves the camera.  `mode` is "orbit" or "pan"."""

    can_cancel = False

    def move(self, before, pixel) -> bool:
        view, pans = self.view, self.mode == "pan"
        orbit, height = view.viewpoint.orbit, view.size[1]
        if pans:
            height *= view.camera.focal / camera_of(orbit, *view.size).focal
        view.viewpoint.orbit = (panned if pans else turned)(orbit, *(pixel - before), height)
        return True

    def release(self, pixel, clicked, modifiers) -> None:
        orbit = self.view.viewpoint.orbit
        self.told.log(self.mode, yaw=orbit.yaw, pitch=orbit.pitch, target=orbit.target)
