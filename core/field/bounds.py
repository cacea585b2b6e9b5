"""Limits for models that can be rendered; docs/model-format.md states them.

Each check needs little work, and runs before the work that it limits.
"""

from itertools import pairwise
from math import comb

import numpy as np

from ..base.memory import free_bytes
from ..base.schema import check, integer, listing, vector
from ..geometry import EDGES, TetMesh, signed_volumes
from .field import TetField
from .layout import MAX_DENSE_LEVELS

SMALLEST_MARCH_STEP = 1e-4  # model units
FARTHEST = 16.0  # of a coordinate from 0: float32 keeps positions to 1e-6 there
SHORTEST = 1e-3  # of the mesh's longest side
MOST_PIECES = 20_000  # along the box's diagonal: the unit cube at the smallest march step
FLATTEST = 1e-7  # volume of a tet over its longest edge³: flat in float32
MOST_WEIGHTS = 2**18  # of a network; the usual ones have 3,000 and 75,000
MOST_HIDDEN_LAYERS = 8
LARGEST_WEIGHT = 65504.0  # float16's largest: CUDA's networks compute with such weights
LARGEST_SUM = 1e30  # of a layer's output, far from float32's largest
LARGEST_SCALE_TO_DATA = 1e9
SLACK = 64  # how many times fewer entries than nodes vertices of equal address may leave


def check_levels(entry_counts, dense_count, options) -> None:
    """Whether the declared levels can be those of some mesh."""
    levels, size = options.level_count, options.table_size
    fits = (
        vector(levels, integer(1, size))(entry_counts)
        and integer(0, min(levels, MAX_DENSE_LEVELS))(dense_count)
        and all(n == size for n in entry_counts[dense_count:])
    )
    check(
        fits,
        f"it declares levels of {entry_counts} entries, {dense_count} of them dense; "
        f"{levels} levels have 1 to {size} entries each, and exactly {size} where not dense",
    )


def check_work(tet_count, entry_counts, dense_count, options) -> None:
    """Whether the tables belong to that many tets, and the field fits into memory."""
    for level in range(1, dense_count):
        check(
            tet_count * 8**level <= SLACK * entry_counts[level],
            f"its level {level} has {entry_counts[level]} entries, too few for {tet_count} tets",
        )
    ranked = range(min(options.level_count, MAX_DENSE_LEVELS) if options.dense_levels else 0)
    nodes = [comb(2**k + 3, 3) for k in ranked if tet_count * 8**k <= 8 * options.table_size]
    needed = 660 * tet_count + 80 * tet_count * max(nodes, default=0) + 16 * sum(entry_counts)
    free = free_bytes()
    check(
        free is None or needed <= free,
        f"it takes about {needed / 2**30:.1f} GiB of memory; "
        f"{(free or 0) / 2**30:.1f} GiB are free",
    )


def check_geometry(mesh: TetMesh, neighbours: np.ndarray, march_step: float) -> None:
    """Whether rays can meet the mesh, and cross it in a bounded number of pieces."""
    check(
        (neighbours < 0).any(),
        "its mesh has no boundary, so no ray can enter it: every face joins two tets",
    )
    low, high = (corner(mesh.rest_vertices, axis=0) for corner in (np.min, np.max))
    reach, size = max(-low.min(), high.max()), (high - low).max()
    check(
        reach <= FARTHEST and size >= SHORTEST,
        f"its mesh reaches {reach:g} from the origin and is {size:g} long; scale and move it into "
        f"the unit cube (this program draws from {SHORTEST:g} long to {FARTHEST:g} away)",
    )
    pieces = np.linalg.norm(high - low) / march_step
    check(
        pieces <= MOST_PIECES,
        f"its march step {march_step:g} cuts a ray into {pieces:.0f} pieces, more than "
        f"{MOST_PIECES}",
    )
    vertices = mesh.rest_vertices.astype(np.float32).astype(float)  # as the renderer has them
    for first in range(0, mesh.tet_count, 2**16):
        tets = mesh.tets[first : first + 2**16]
        corners = vertices[tets]
        longest = np.linalg.norm(corners[:, EDGES[:, 0]] - corners[:, EDGES[:, 1]], axis=2)
        flat = signed_volumes(vertices, tets) <= FLATTEST * longest.max(axis=1) ** 3
        check(
            not flat.any(),
            f"{flat.sum()} tets have no rest volume, the first of them tet {first + flat.argmax()}",
        )


def check_widths(name, widths) -> None:
    """Whether a network is small enough to be evaluated for each sample or ray."""
    check(
        listing(integer(1), MOST_HIDDEN_LAYERS + 2)(widths),
        f"its {name} network has the hidden layers {list(widths[1:-1])}, not up to "
        f"{MOST_HIDDEN_LAYERS} whole numbers from 1",
    )
    count = sum(a * b for a, b in pairwise(widths))
    check(
        count <= MOST_WEIGHTS,
        f"its {name} network has {count} weights, more than {MOST_WEIGHTS}",
    )


def check_weights(name, layers, largest) -> float:
    """Whether no input up to `largest` in magnitude overflows; the largest possible output."""
    for i, (weights, bias) in enumerate(layers):
        greatest = max(np.abs(weights).max(), np.abs(bias).max())
        check(
            greatest <= LARGEST_WEIGHT,
            f"'{name}_weights_{i}' or its bias reaches {greatest:g}, beyond {LARGEST_WEIGHT:g}",
        )
        sums = largest * np.abs(weights.astype(float)).sum(axis=0) + np.abs(bias)
        largest = float(sums.max())
        check(
            largest <= LARGEST_SUM,
            f"layer {i} of its {name} network can reach {largest:g}, beyond {LARGEST_SUM:g}",
        )
    return largest


def check_world(matrix) -> None:
    """Whether `world_to_model` [4, 4] is finite, affine and invertible."""
    limit = LARGEST_SCALE_TO_DATA
    check(
        matrix.shape == (4, 4) and np.isfinite(matrix).all(),
        "its 'world_to_model' is no 4x4 matrix",
    )
    scale = abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3) if np.abs(matrix).max() <= limit else 0.0
    check(
        scale >= 1.0 / limit and (matrix[3] == [0, 0, 0, 1]).all(),
        "its 'world_to_model' is no uniform scale and translation",
    )


def check_finite(field: TetField) -> None:
    """A ValueError if a TetField that no file was read to holds NaN or infinite numbers.

    On a CPU a maximum passes over NaN, and pixels would show numbers that mean nothing.
    """
    arrays = {"the table": [field.table], "the mesh": [field.mesh.rest_vertices]}
    for name in ("density", "color"):
        layers = getattr(field, f"{name}_layers")
        arrays[f"the {name} network"] = [array for layer in layers for array in layer]
    for name, values in arrays.items():
        if not all(np.isfinite(array).all() for array in values):
            raise ValueError(f"{name} of the field holds NaN or infinite numbers")
