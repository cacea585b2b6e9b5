"""The surroundings of the object: a hashed grid in contracted space.

Let m be the center of the object's box and b its half extents.  A point p becomes
y = (p - m) / b, which is contracted (mip-NeRF 360, Barron et al. 2022, Eq. 10, here in the
maximum norm, which fits a box) to

    y                        if |y| <= 1
    (2 - 1 / |y|) y / |y|    otherwise

So all of space fits in the cube from -2 to 2.  Each level divides the
cube into finer cells than the one before.  At each level, a hash of integer coordinates gives the
table entries of the eight corners of the point's cell; their features are interpolated trilinearly
(Instant-NGP, Müller et al. 2022).

Shapes: N points, G levels, E entries per level, F = 4 features.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from .layout import hash_entry
from .networks.basis import BASIS_COUNT
from .networks.shapes import GEOMETRY_FEATURES, Layers

RESOLUTIONS = (16, 28, 49, 84, 147, 256, 446, 776)  # cells across the contracted cube
GRID_LEVELS = len(RESOLUTIONS)
GRID_ENTRIES = 2**16  # per level
HIDDEN = 32  # width of both networks' hidden layer

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@dataclass(frozen=True)
class Surroundings:
    """The learned surroundings, as arrays."""

    box: np.ndarray  # [2, 3] the object's box inside the grid, model space
    table: np.ndarray  # [G·E, F] float32
    density_layers: Layers
    color_layers: Layers
    sky: np.ndarray  # [3] color at infinity, 0..1


def surroundings_widths() -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Input, hidden and output widths of the density and the color network."""
    density = (4 * GRID_LEVELS, HIDDEN, GEOMETRY_FEATURES)
    return density, (GEOMETRY_FEATURES + BASIS_COUNT, HIDDEN, 3)


@wp.func
def contracted(p: wp.vec3, center: wp.vec3, half: wp.vec3):
    """The point of the cube from -2 to 2 that stands for p."""
    y = wp.cw_div(p - center, half)
    norm = wp.max(wp.max(wp.abs(y[0]), wp.abs(y[1])), wp.abs(y[2]))
    if norm > 1.0:
        y = (2.0 - 1.0 / norm) / norm * y
    return y


@wp.func
def corner_entry(level: int, cell: wp.vec3i, corner: int):
    offset = wp.vec3i(corner & 1, (corner >> 1) & 1, corner >> 2)
    entry = hash_entry(cell + offset, wp.static(GRID_ENTRIES - 1))
    return level * wp.static(GRID_ENTRIES) + entry


@wp.func
def corner_weight(fraction: wp.vec3, corner: int):
    weight = float(1.0)
    axis = int(0)
    while axis < 3:
        if (corner >> axis) & 1 == 1:
            weight *= fraction[axis]
        else:
            weight *= 1.0 - fraction[axis]
        axis += 1
    return weight


@wp.func
def cell_of(point: wp.vec3, resolution: int):
    """The cell of a contracted point, and the point's fractions in it."""
    x = (point + wp.vec3(2.0, 2.0, 2.0)) * (0.25 * float(resolution))
    cell = wp.vec3i(
        wp.clamp(int(wp.floor(x[0])), 0, resolution - 1),
        wp.clamp(int(wp.floor(x[1])), 0, resolution - 1),
        wp.clamp(int(wp.floor(x[2])), 0, resolution - 1),
    )
    return cell, x - wp.vec3(float(cell[0]), float(cell[1]), float(cell[2]))


@wp.kernel
def grid_encode_kernel(
    points: wp.array(dtype=wp.vec3),  # [N] contracted
    resolutions: wp.array(dtype=int),  # [G]
    table: wp.array(dtype=wp.vec4),  # [G·E]
    features: wp.array2d(dtype=wp.vec4),  # [N, G] out
):
    n, level = wp.tid()
    cell, fraction = cell_of(points[n], resolutions[level])
    total = wp.vec4()
    corner = int(0)
    while corner < 8:
        total += corner_weight(fraction, corner) * table[corner_entry(level, cell, corner)]
        corner += 1
    features[n, level] = total


@wp.kernel
def grid_encode_backward_kernel(
    points: wp.array(dtype=wp.vec3),  # [N]
    resolutions: wp.array(dtype=int),  # [G]
    features_grad: wp.array2d(dtype=wp.vec4),  # [N, G]
    table_grad: wp.array(dtype=wp.vec4),  # [G·E] added to
):
    n, level = wp.tid()
    cell, fraction = cell_of(points[n], resolutions[level])
    corner = int(0)
    while corner < 8:
        gradient = corner_weight(fraction, corner) * features_grad[n, level]
        wp.atomic_add(table_grad, corner_entry(level, cell, corner), gradient)
        corner += 1
