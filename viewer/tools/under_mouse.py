"""What the picture's depths [h, w] say about a pixel; None: there are none yet."""

import numpy as np

from ..camera import depth_at, onto_view_plane, point_at

NEAREST = 0.05  # object sizes between eye and surface, where zooming in stops


def surface_at(camera, depth, pixel, beside=None):
    """The object's point under a pixel.  [3]

    Beside the object it is as far away as the point `beside` [3], if one is given; else None.
    """
    if depth is not None:
        t = depth_at(depth, camera, pixel[None])[0]
        if np.isfinite(t):
            return point_at(camera, pixel, t)
    return None if beside is None else onto_view_plane(camera, pixel, beside)


def nearest_zoom(camera, depth, anchor, size: float) -> float:
    """The factor of a zoom to a point that ends before the surface: inside, all is white.

    Args:
        size: Of the object.
    """
    if depth is None or camera.parallel:
        return 0.0
    gap = max(float(depth.min()) - NEAREST * size, 0.0)
    return min(max(1.0 - gap / np.linalg.norm(anchor - camera.position), 0.0), 1.0)
