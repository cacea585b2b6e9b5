"""Temporal upsampling: coarse rays are some of the image's, and motion is exact."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import warp as wp
from places import places_of

from deformrf.core.render import (
    Image,
    PastView,
    Renderer,
    RenderOptions,
    camera_rays,
    from_field_of_view,
    look_at,
)
from deformrf.core.render.temporal import NOWHERE, phases, strided, surfaces

STRIDES = [(1, 1), (2, 2), (3, 2), (3, 3), (4, 4), (6, 4)]


def view(parallel=False, eye=(0.8, -1.4, 1.0), width=61, height=43):
    camera = from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.6, width, height)
    if not parallel:
        return camera
    lens = replace(camera.lens, focal=(40.0, 40.0))
    return replace(camera, lens=lens, parallel=True)


@pytest.mark.parametrize("stride", STRIDES)
def test_the_phases_are_all_pixels_of_a_block(stride):
    assert sorted(phases(stride)) == sorted(product(range(stride[0]), range(stride[1])))
    if stride == (2, 2):
        assert phases(stride)[:2] == ((0, 0), (1, 1))


@pytest.mark.parametrize("stride", STRIDES[1:])
@pytest.mark.parametrize("parallel", [False, True])
def test_coarse_rays_are_rays_of_the_image(stride, parallel):
    camera = view(parallel)
    origins, directions = (rays.reshape(43, 61, 3) for rays in camera_rays(camera))
    for phase in phases(stride):
        coarse = strided(camera, stride, phase)
        some = [rays.reshape(coarse.height, coarse.width, 3) for rays in camera_rays(coarse)]
        for all_rays, few in zip((origins, directions), some, strict=True):
            wanted = all_rays[phase[1] :: stride[1], phase[0] :: stride[0]]
            np.testing.assert_allclose(few[: len(wanted), : wanted.shape[1]], wanted, atol=1e-12)


def reference(image, camera, tets, vertices, before, sight):
    """`place_before` in float64, pixel by pixel; `before` are the vertices of then."""
    color, depth, tet = image.color.numpy(), image.depth.numpy().astype(float), image.tet.numpy()
    origins, directions = (rays.reshape(*depth.shape, 3) for rays in camera_rays(camera))
    world_to_camera, lens = np.linalg.inv(sight.camera_to_world), sight.lens
    places = np.full((*depth.shape, 4), float(NOWHERE))
    for row, column in np.ndindex(depth.shape):
        t, inside = depth[row, column], tet[row, column]
        if np.isinf(t) and color[row, column, 3] > 0:
            around = [
                (depth[i, j], tet[i, j])
                for i in range(max(row - 1, 0), min(row + 2, depth.shape[0]))
                for j in range(max(column - 1, 0), min(column + 2, depth.shape[1]))
                if tet[i, j] >= 0 and np.isfinite(depth[i, j])
            ]
            t, inside = min(around, default=(t, inside))
        place, then = places[row, column, :2], t
        if np.isinf(t):
            start = origins[row, column] if sight.parallel else sight.position
            ahead = 0.0 if sight.parallel else 1.0
            point = start + ahead * directions[row, column]
        elif inside >= 0:
            corners = np.concatenate([vertices[tets[inside]].T, np.ones((1, 4))])
            point = origins[row, column] + t * directions[row, column]
            point = np.linalg.solve(corners, [*point, 1.0]) @ before[tets[inside]]
        local = world_to_camera[:3] @ [*point, 1.0]
        if np.isfinite(t):
            then = -local[2] if sight.parallel else np.linalg.norm(local)
        away = 1.0 if sight.parallel else -local[2]
        if away > 0.0:
            place[:] = lens.center + np.array(lens.focal) * (local[0], -local[1]) / away
        places[row, column, 2:] = then, t
    return places


@pytest.fixture
def bent(ball):
    """A renderer of a bent ball, and the vertices before."""
    rng, rest = np.random.default_rng(), ball.mesh.rest_vertices
    matrices = np.eye(3) + 0.2 * rng.normal(size=(2, 3, 3))
    poses = [(rest - 0.5) @ m + 0.5 + 0.05 * np.sin(5.0 * rest[:, [1, 2, 0]]) for m in matrices]
    renderer = Renderer(ball)
    renderer.set_vertices(poses[1])
    return renderer, poses[0].astype(np.float32)


@pytest.mark.parametrize("parallel", [False, True])
def test_places_are_those_of_the_reference(bent, parallel):
    renderer, vertices = bent
    camera, then = view(parallel), view(parallel, eye=(1.0, -1.3, 0.9))
    coarse = strided(camera, (3, 2), (1, 1))
    image = renderer.render(coarse, RenderOptions(details=True))
    before = PastView(then, wp.array(vertices, dtype=wp.vec3, device="cpu"))
    places = places_of(surfaces(image, coarse, renderer, before))
    now = renderer.pose.vertices.numpy().astype(float)
    tets = renderer.field.mesh.tets
    wanted = reference(image, coarse, tets, now, vertices.astype(float), then)
    near = np.isfinite(wanted[..., 3])
    assert 0.1 < near.mean() < 0.9
    assert np.array_equal(np.isfinite(places), np.isfinite(wanted))
    np.testing.assert_allclose(places[..., :2], wanted[..., :2], atol=5e-3)
    np.testing.assert_allclose(places[near], wanted[near], atol=5e-3)


@pytest.mark.parametrize("parallel", [False, True])
def test_what_has_not_moved_is_where_it_is(bent, parallel):
    renderer, _ = bent
    camera, stride, phase = view(parallel), (3, 2), (2, 1)
    coarse = strided(camera, stride, phase)
    image = renderer.render(coarse, RenderOptions(details=True))
    before = PastView(camera, renderer.pose.vertices)
    places = places_of(surfaces(image, coarse, renderer, before))
    row, column = np.indices(places.shape[:2])
    np.testing.assert_allclose(places[..., 0], column * 3 + 2 + 0.5, atol=2e-3)
    np.testing.assert_allclose(places[..., 1], row * 2 + 1 + 0.5, atol=2e-3)
    near = np.isfinite(places[..., 3])
    np.testing.assert_allclose(places[near, 2], places[near, 3], rtol=1e-5)


def test_the_place_of_what_is_in_a_flat_tet_is_not_known(bent):
    renderer, vertices = bent
    camera = view()
    image = renderer.render(camera, RenderOptions(details=True))
    renderer.set_vertices(renderer.pose.vertices.numpy() * [1.0, 1.0, 0.0])
    before = PastView(camera, wp.array(vertices, dtype=wp.vec3, device="cpu"))
    places = places_of(surfaces(image, camera, renderer, before))
    near = np.isfinite(image.depth_array())
    assert near.any() and (places[near, :2] == float(NOWHERE)).all()


def test_a_soft_edge_moves_with_the_nearest_surface_beside_it(bent):
    renderer, vertices = bent
    camera = view(width=4, height=3)
    color = np.zeros((3, 4, 4), np.uint8)
    color[1, 1:3, 3] = 90, 255  # a soft edge beside a surface
    color[1, 0, 3] = 40  # a soft edge beside nothing
    depth = np.full((3, 4), np.inf, np.float32)
    tet = np.full((3, 4), -1, np.int32)
    depth[1, 2], tet[1, 2] = 2.5, 7
    image = Image(
        wp.array(color, dtype=wp.vec4ub, device="cpu"),
        wp.array(depth, device="cpu"),
        0,
        wp.array(tet, device="cpu"),
    )
    before = PastView(camera, wp.array(vertices, dtype=wp.vec3, device="cpu"))
    places = places_of(surfaces(image, camera, renderer, before))
    assert places[1, 1, 3] == places[1, 2, 3] == 2.5
    assert np.isinf(places[1, 0, 3]) and np.isinf(places[0, 1, 3])
