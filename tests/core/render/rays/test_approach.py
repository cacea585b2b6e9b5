"""A camera may be any distance away: the image, and what float32 keeps of it, stay the same."""

import numpy as np
import pytest
from tile_rays import begun

from deformrf.core.definition.image import render_rays
from deformrf.core.render import (
    Camera,
    Renderer,
    RenderOptions,
    camera_rays,
    look_at,
    pinhole,
)
from deformrf.core.render.rays.approach import ASIDE, ball_around, begin_at_ball
from deformrf.core.render.rays.entries import UNKNOWN

SIZE = 24


@pytest.fixture(scope="module")
def renderer(make_ball_field):
    return Renderer(make_ball_field(4), "cpu")


def view(distance, size=SIZE):
    """The object fills the image, at every distance."""
    eye = 0.5 + distance * np.array([0.48, -0.6, 0.64])
    return Camera(look_at(eye, (0.5, 0.5, 0.5)), pinhole(1.2 * size * distance, size, size))


def exact(renderer, origins, directions):
    field = renderer.field
    vertices = field.mesh.rest_vertices.astype(np.float32)
    return render_rays(field.definition, vertices, origins, directions, (1.0, 1.0, 1.0))


@pytest.mark.parametrize("distance", [12.0, 1e3, 1e6])
def test_the_image_is_that_of_the_definition(renderer, distance):
    origins, directions = camera_rays(view(distance))
    color, opacity, depth = exact(renderer, origins, directions)
    options = RenderOptions(conformance=True)
    found = renderer.render_rays(origins, directions, options)
    wrong = np.abs(found[0] - color).max(axis=1) > 2 / 255
    assert wrong.mean() <= 0.01 and np.abs(found[0] - color).mean() < 0.1 / 255
    seen = (opacity > 0.5) & ~wrong
    np.testing.assert_allclose(found[2][seen], depth[seen], rtol=1e-6, atol=2e-3)
    image = renderer.render(view(distance), options)
    off = np.abs(image.color_array()[..., :3].reshape(-1, 3) - 255.0 * color).max(axis=1)
    assert (off > 2.6).mean() <= 0.01
    np.testing.assert_allclose(image.depth_array().ravel()[seen], depth[seen], rtol=1e-6, atol=2e-3)


def test_rays_from_afar_find_their_entries_without_a_search(renderer):
    camera = view(1e3, 80)
    ball = ball_around(renderer.pose.vertices.numpy())
    *rays, _ = begin_at_ball(*camera_rays(camera), ball)
    count = begun(camera, renderer.pose, rays=rays)[0].entries.count.numpy()
    assert (count == UNKNOWN).sum() <= 0.01 * (count != 0).sum()


def test_rays_from_nearby_and_from_nowhere_stay_what_they_are(renderer):
    origins, directions = (
        np.array([[0.5, 0.5, 3.0], [1e9, 0, 0]]),
        np.array([[0.48, 0.6, -0.64], [0.8, 0.36, 0.48]]),
    )
    ball = ball_around(renderer.pose.vertices.numpy())
    begun_at, _, skipped = begin_at_ball(origins, directions, ball)
    assert (skipped == 0.0).all()  # the second looks away
    np.testing.assert_array_equal(begun_at, origins.astype(np.float32))
    assert ball_around(np.array([[0.0, 0.0, np.inf]])) is None


def lattice_rays(field, count):
    """Rays along the axes through vertices, edges and faces of a mesh whose spacing is 0.06."""
    rng = np.random.default_rng()
    points = field.mesh.rest_vertices[rng.integers(field.mesh.vertex_count, size=count)].copy()
    points = np.where(rng.random((count, 1)) < 0.5, points, np.round(points / 0.015) * 0.015)
    axis, sign = rng.integers(3, size=count), rng.choice([-1.0, 1.0], count)
    directions = np.zeros((count, 3))
    directions[np.arange(count), axis] = sign
    points[np.arange(count), axis] = 0.5 - 2.0 * sign
    rays = np.unique(np.concatenate([points, directions], axis=1), axis=0)
    return rays[:, :3].astype(np.float32).astype(float), rays[:, 3:]


def test_rays_along_edges_and_faces_see_one_side(make_ball_field):
    """The definition counts a face's piece once, and the walk doesn't leave through an edge."""
    field = make_ball_field(1, spacing=0.06, occupied_share=1.0)
    renderer = Renderer(field, "cpu")
    origins, directions = lattice_rays(field, 600)
    beside, _, _ = exact(renderer, origins + ASIDE, directions)
    color, _, _ = exact(renderer, origins, directions)
    found, _, _ = renderer.render_rays(origins, directions, RenderOptions(conformance=True))
    assert (np.abs(color - beside).max(axis=1) > 0.02).mean() <= 0.02
    assert (np.abs(found - beside).max(axis=1) > 0.02).mean() <= 0.005
