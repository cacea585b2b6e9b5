"""Edges of the nested levels, and which are finer than a pixel."""

import numpy as np
import pytest
from shown_levels import levels_reference

from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.field import below_pixel, level_edges, modelfile
from deformrf.core.geometry import EDGES, a15_grid, path_corners
from deformrf.viewer.layers.resolution import Rung


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


def test_levels_with_shorter_edges_than_a_pixel_are_below_it(mesh):
    edges = level_edges(mesh, 6)
    assert np.flatnonzero(below_pixel(edges, 1.001 * edges[4])).tolist() == [4, 5]
    assert not below_pixel(edges, 0.5 * edges[5]).any()
    assert below_pixel(edges, 10.0).all()


def test_viewer_and_view_mode_agree_which_levels_are_finer_than_a_pixel():
    """On the bundled model, for pixels around the edge lengths that they once disagreed about."""
    field = modelfile.load(DEFAULT_MODEL)
    count = field.layout.level_count
    edges = level_edges(field.mesh, count)
    for level in range(count):
        for pixel in (0.93 * edges[level], 0.999 * edges[level], 1.001 * edges[level]):
            finer = count - max(level + (pixel <= edges[level]), 1)
            assert min(below_pixel(edges, pixel).sum(), count - 1) == finer
            shown = Rung(1.0, spared_levels=count).savings(edges, pixel).get("level_count", count)
            assert shown == count - finer
            assert levels_reference(pixel * 500.0, edges, 500.0) == count - finer - 1
