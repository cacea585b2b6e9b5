"""Edges of the nested levels, and which are finer than any training pixel."""

import numpy as np
import pytest

from deformrf.core.field import level_edges, levels_below_pixel, narrowest_pixel
from deformrf.core.geometry import EDGES, a15_grid, path_corners


@pytest.fixture(scope="module")
def mesh():
    return a15_grid(0.2)


def test_edges_are_those_of_all_descendants(mesh):
    corners = mesh.rest_vertices[mesh.tets]
    expected = []
    for level in range(5):
        points = np.einsum("pcb,tbx->tpcx", path_corners(level) / 2**level, corners[:40])
        ends = points[:, :, EDGES]
        expected.append(np.linalg.norm(ends[..., 0, :] - ends[..., 1, :], axis=-1).max())
    np.testing.assert_allclose(level_edges(mesh, 5), expected)


def test_a_pixel_is_narrowest_where_a_camera_comes_closest():
    vertices = np.random.default_rng().uniform(size=(50, 3))
    near, far = vertices[7] + (0.0, 0.0, 3.0), np.array([0.5, 0.5, -40.0])
    near[2] = vertices[:, 2].max() + 2.0
    distance = np.linalg.norm(vertices - near, axis=1).min()
    pixel = narrowest_pixel([far, near], 500.0, vertices)
    assert pixel == pytest.approx(distance / 500.0)
    longer_lens = narrowest_pixel([far, near], [500.0 * 1e3, 500.0], vertices)
    assert longer_lens < pixel


def test_levels_with_shorter_edges_than_a_pixel_are_named(mesh):
    edges = level_edges(mesh, 6)
    assert levels_below_pixel(mesh, 6, 1.001 * edges[4]) == [4, 5]
    assert levels_below_pixel(mesh, 6, 0.5 * edges[5]) == []
    assert levels_below_pixel(mesh, 6, 10.0) == list(range(6))
