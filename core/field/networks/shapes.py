"""Check whether the layers of the two networks have the shapes that the fused kernels need.

core/definition/networks.py defines what the networks compute.
"""

import numpy as np

from ...definition.networks import GEOMETRY_FEATURES as GEOMETRY_FEATURES
from .basis import BASIS_COUNT

# The shape that the fused kernels (mma.py, triton.py) are written for.
WIDTH = 64  # of the hidden layers: one for density, two for color
MAX_FEATURES = 32  # 4 L

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]


def has_usual_shape(shapes) -> bool:
    """Whether the layers' shapes (in, out), density's first, are those of the fused kernels."""
    shapes = [tuple(shape) for shape in shapes]
    color = [(GEOMETRY_FEATURES + BASIS_COUNT, WIDTH), (WIDTH, WIDTH), (WIDTH, 3)]
    return has_usual_density(shapes[:2]) and shapes[2:] == color


def fits_usual_shape(shapes) -> bool:
    """Whether layers of these shapes have it, or could if zeros filled them up (triton.py)."""
    shapes = [tuple(shape) for shape in shapes]
    if has_usual_shape(shapes):
        return True
    if len(shapes) != 4:
        return False
    (features, a), (_, h), (c, b), (_, rgb) = shapes
    narrow = features <= MAX_FEATURES and max(a, b) <= WIDTH
    return narrow and (h, c, rgb) == (GEOMETRY_FEATURES, GEOMETRY_FEATURES + BASIS_COUNT, 3)


def has_usual_density(shapes) -> bool:
    """Whether the density layers' shapes (in, out) are those of the fused kernels."""
    (feature_count, width), *others = [tuple(shape) for shape in shapes]
    usual = feature_count <= MAX_FEATURES and width == WIDTH
    return usual and others == [(WIDTH, GEOMETRY_FEATURES)]
