"""The rays of a tile of an image on a CPU, begun as the renderer begins them."""

import warp as wp

from deformrf.core.render import device_camera
from deformrf.core.render.cpu_tiles import TileMemory
from deformrf.core.render.rays.raster import bounding_rectangles


def begun(camera, pose, first=0, count=None, rays=None):
    """Rays with their entries, of the pixels from `first` on, and the numbers of those alive.

    Args:
        rays: Origins and directions, if they are not the camera's.
    """
    count = count or camera.width * camera.height
    memory, vertices = TileMemory(count, deferred=False), pose.vertices.numpy().astype(float)
    faces = bounding_rectangles(camera, vertices, pose.boundary_faces)
    rectangles = wp.array(faces, dtype=wp.vec4i, device="cpu")
    left = memory.begin(device_camera(camera), first, count, pose.geometry, rectangles, rays)
    return memory.rays, memory.trace.alive.numpy()[:left]
