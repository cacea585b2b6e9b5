"""The preview of a field: a closed surface in its colors, carried by its tets."""

import numpy as np
import pytest

from deformrf.core.render import Renderer, preview


def test_the_preview_is_a_closed_surface_around_the_matter(ball):
    surface = preview(ball, Renderer(ball))
    points = surface.points(ball.mesh.rest_vertices)
    sides = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(sides, axis=0, return_counts=True)
    assert (counts % 2 == 0).all()
    assert set(np.unique(surface.faces)) == set(range(len(points)))
    a, b, c = points.astype(float)[surface.faces].transpose(1, 0, 2)
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0.0  # outward
    np.testing.assert_allclose(surface.weights.sum(axis=1), 1.0, atol=1e-5)
    low, high = ball.mesh.rest_vertices.min(axis=0), ball.mesh.rest_vertices.max(axis=0)
    assert (points > low - 0.02).all() and (points < high + 0.02).all()


def test_an_empty_field_has_none(ball):
    from dataclasses import replace

    empty = replace(ball, occupancy=np.zeros_like(ball.occupancy))
    with pytest.raises(ValueError, match="empty"):
        preview(empty, Renderer(ball))
