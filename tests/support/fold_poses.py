"""Folded objects, and a camera inside the fold."""

from dataclasses import replace

import numpy as np

from deformrf.core.render import from_field_of_view, look_at


def folded(field):
    """The vertices, folded three times along x, one sheet a little behind the other."""
    vertices = field.mesh.rest_vertices.copy()
    low, high = vertices[:, 0].min(), vertices[:, 0].max()
    thirds = 3.0 * (vertices[:, 0] - low) / (high - low)
    vertices[:, 0] = low + (np.abs((thirds + 1) % 2 - 1) + 0.02 * thirds) * (high - low) / 3
    return vertices.astype(np.float32)


def denser(field, factor):
    """The field with log densities that are so much higher."""
    weights, bias = field.density_layers[-1]
    bias = bias + np.float32([factor] + [0.0] * (len(bias) - 1))
    return replace(field, density_layers=(*field.density_layers[:-1], (weights, bias)))


def from_inside(vertices, size=12):
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    return from_field_of_view(look_at(middle, middle + np.array([0.1, 0.5, 0.2])), 0.9, size, size)


def crowd(field):
    """The vertices, every other one on the opposite side: hundreds of tets share the middle.

    Returns:
        The vertices [V, 3], and a small camera that looks there.
    """
    middle = field.mesh.rest_vertices.mean(axis=0)
    vertices = field.mesh.rest_vertices.astype(np.float32)
    vertices[::2] = (2.0 * middle - vertices[::2]).astype(np.float32)
    camera = from_field_of_view(look_at(middle + np.array([0.1, -0.8, 0.2]), middle), 0.3, 8, 8)
    return vertices, camera
