"""What can be seen of a model, and which vertices are by it."""

import numpy as np

from deformrf.core.render import Renderer
from deformrf.viewer import surface


def test_the_points_are_on_the_object_all_around(ball):
    renderer = Renderer(ball)
    rest = ball.mesh.rest_vertices
    renderer.set_vertices(rest)
    points = surface.visible_points(renderer, rest)
    low, high = rest.min(axis=0), rest.max(axis=0)
    assert 100 < len(points) <= surface.MAX_POINTS
    assert (points > low - 0.02).all()
    assert (points < high + 0.02).all()
    assert np.ptp(points, axis=0).min() > 0.8 * (high - low).min()


def test_where_nothing_is_opaque_the_mesh_is_the_object(ball):
    class Nothing:
        def render(self, camera):
            return self

        def depth_array(self):
            return np.full((64, 64), np.inf, np.float32)

    points = surface.visible_points(Nothing(), ball.mesh.rest_vertices)
    assert np.array_equal(points, ball.mesh.rest_vertices)


def test_the_bounds_leave_specks_out():
    points = np.random.default_rng(0).uniform(size=(2000, 3))
    points[:3] = 50.0
    low, high = surface.bounds(points)
    assert abs(low).max() < 0.02
    assert abs(high - 1).max() < 0.02


def test_nearest_vertices_are_each_points_nearest():
    rng = np.random.default_rng(1)
    points, vertices = rng.uniform(size=(300, 3)), rng.uniform(size=(40, 3))
    distances = np.linalg.norm(points[:, None] - vertices, axis=-1)
    assert np.array_equal(surface.nearest_vertices(points, vertices), distances.argmin(1))
