"""The grid around the object in NumPy, which core/field/grid.py has for devices."""

import numpy as np

from deformrf.core.definition.encoding import hash_address
from deformrf.core.field import GRID_ENTRIES, RESOLUTIONS


def contract(points, box):
    """Points to the cube from -2 to 2.  [..., 3], box [2, 3] -> [..., 3]"""
    low, high = np.asarray(box, float)
    y = (points - 0.5 * (low + high)) / (0.5 * (high - low))
    norm = np.abs(y).max(axis=-1, keepdims=True)
    return np.where(norm <= 1.0, y, (2.0 - 1.0 / np.maximum(norm, 1.0)) * y / np.maximum(norm, 1.0))


def grid_encode_reference(points, table):
    """Features of contracted points.  [N, 3], table [G·E, F] -> [N, G·F]"""
    features = []
    for level, resolution in enumerate(RESOLUTIONS):
        x = (points + 2.0) / 4.0 * resolution
        cell = np.clip(np.floor(x), 0, resolution - 1).astype(np.int64)
        fraction = x - cell
        total = 0.0
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(corner, fraction, 1.0 - fraction).prod(axis=1)
            entry = level * GRID_ENTRIES + hash_address(cell + corner, GRID_ENTRIES)
            total = total + weight[:, None] * table[entry]
        features.append(total)
    return np.concatenate(features, axis=1)
