"""What can be seen of a model, and which vertices are by it."""

import numpy as np

from deformrf.core.render import Renderer
from deformrf.viewer.document.scene import surface


def test_the_points_are_on_the_object_all_around(ball):
    renderer = Renderer(ball)
    rest = ball.mesh.rest_vertices
    renderer.set_vertices(rest)
    points, _ = surface.visible_points(renderer, rest)
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

    points, _ = surface.visible_points(Nothing(), ball.mesh.rest_vertices)
    assert np.array_equal(points, ball.mesh.rest_vertices)


def test_pixels_between_two_depths_are_not_steady(ball, monkeypatch):
    """A wall before another one: the outline's pixels have a depth in the air between them."""
    depth = np.full((64, 64), 3.0, np.float32)
    depth[:, :32] = 1.0
    depth[:, 32] = 2.0  # a mixture
    depth[:8] = np.inf

    class Walls:
        def render(self, camera):
            return self

        def depth_array(self):
            return depth

    monkeypatch.setattr(surface, "MAX_POINTS", 10**6)
    _, steady = surface.visible_points(Walls(), ball.mesh.rest_vertices)
    rows = steady[: 56 * 64].reshape(56, 64)  # of the first view
    assert not rows[:, 31:34].any() and rows[:, :31].all() and rows[:, 34:].all()


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
