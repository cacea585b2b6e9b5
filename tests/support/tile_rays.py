"""The rays of a tile of an image on a CPU, begun as the renderer begins them."""

from deformrf.core.render import device_camera
from deformrf.core.render.cpu_tiles import TileMemory
from deformrf.core.render.rays.raster import FaceRectangles


def begun(camera, pose, first=0, count=None, rays=None):
    """Rays with their entries, of the pixels from `first` on, and the numbers of those alive.

    Args:
        rays: Origins and directions, if they are not the camera's.
    """
    count = count or camera.width * camera.height
    memory, faces = TileMemory(count, deferred=False), FaceRectangles(camera, pose)
    begin = device_camera(camera), first, count, pose.geometry, faces.rectangles, rays
    left = memory.begin(*begin)
    return memory.rays, memory.trace.alive.numpy()[:left]
