"""Entries by rasterized faces: those that rays find by searching, in any pose and view."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from tile_rays import begun

from deformrf.core.geometry import a15_grid, extract, tet_neighbours
from deformrf.core.render import (
    Geometry,
    Pose,
    camera_rays,
    empty_entries,
    empty_rays,
    find_entries,
    from_field_of_view,
    look_at,
)
from deformrf.core.render.rays.entries import MOST_ENTRIES, UNKNOWN, Entries
from deformrf.core.render.rays.raster import bounding_rectangles, row_work

SIZE = 80


def view(rng, parallel=False, distance=1.6):
    direction = rng.normal(size=3) * [1, 1, 0.5]
    eye = 0.5 + distance * direction / np.linalg.norm(direction)
    camera = from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.6, SIZE, SIZE + 7)
    if not parallel:
        return camera
    lens = replace(camera.lens, focal=(100.0, 90.0), center=(33.0, 51.0))
    return replace(camera, lens=lens, parallel=True)


def pose_of(field, rng):
    pose = Pose(field.mesh, field.neighbours, "cpu")
    vertices = field.mesh.rest_vertices
    pose.set_vertices(vertices + 0.004 * rng.normal(size=vertices.shape))
    return pose


def crossings(pose, rays):
    """All crossings of each ray with the boundary, in float64: t and whether it enters.  Lists"""
    corners = pose.vertices.numpy().astype(float)[pose.boundary_faces]
    found = []
    for o, d in zip(rays.origins.numpy(), rays.directions.numpy(), strict=True):
        a, b, c = (corners[:, k] - o for k in range(3))
        volumes = np.stack([np.cross(c, b) @ d, np.cross(a, c) @ d, np.cross(b, a) @ d])
        normals = np.cross(b - a, c - a)
        with np.errstate(all="ignore"):
            t = (normals * a).sum(axis=1) / (normals @ d)
        hit = ((volumes >= 0).all(axis=0) | (volumes <= 0).all(axis=0)) & (t >= 0)
        entering = normals[hit] @ d < 0
        order = np.argsort(t[hit])
        found.append(list(zip(t[hit][order], entering[order], strict=True)))
    return found


@pytest.mark.parametrize("parallel", [False, True])
def test_rays_enter_where_they_cross_the_boundary(make_ball_field, parallel):
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), gap=float(rng.choice([0.0, 0.1])))
    pose, camera = pose_of(field, rng), view(rng, parallel)
    rays, alive = begun(camera, pose)
    entries = rays.entries
    counts, t = entries.count.numpy(), entries.t.numpy()
    expected = crossings(pose, rays)
    assert (counts > 0).mean() > 0.05 and (counts == UNKNOWN).mean() < 0.03
    np.testing.assert_array_equal(alive, np.flatnonzero(counts))
    for ray in np.flatnonzero(counts != UNKNOWN):
        enters = [t for t, entering in expected[ray] if entering]
        np.testing.assert_allclose(t[: counts[ray], ray], enters, rtol=1e-5)


def test_a_tile_has_the_entries_of_its_pixels(make_ball_field):
    rng = np.random.default_rng()
    pose, camera = pose_of(make_ball_field(3), rng), view(rng)
    whole = begun(camera, pose)[0].entries.count.numpy()
    first, count = 17 * SIZE + 5, 23 * SIZE + 11
    part = begun(camera, pose, first, count)[0].entries.count.numpy()
    np.testing.assert_array_equal(part, whole[first : first + count])
    assert part.any()


def test_a_ray_that_starts_inside_has_to_search(make_ball_field):
    rng = np.random.default_rng()
    pose = pose_of(make_ball_field(3), rng)
    inside = from_field_of_view(look_at((0.5, 0.5, 0.5), (1.0, 0.6, 0.55)), 0.6, 20, 20)
    vertices = pose.vertices.numpy().astype(float)
    assert not len(bounding_rectangles(inside, vertices, pose.boundary_faces))
    rays, alive = begun(inside, pose)
    assert (rays.entries.count.numpy() == UNKNOWN).all() and len(alive) == 400


def test_rectangles_hold_their_faces(make_ball_field):
    """Also faces that reach beyond the image; and nothing is known behind the camera."""
    rng = np.random.default_rng()
    field, camera = make_ball_field(3), view(rng, distance=0.9)
    pose = pose_of(field, rng)
    vertices = pose.vertices.numpy().astype(float)
    left, top, right, bottom = bounding_rectangles(camera, vertices, pose.boundary_faces).T
    assert (0 <= left).all() and (right <= camera.width).all() and (left <= right).all()
    assert (0 <= top).all() and (bottom <= camera.height).all() and (top <= bottom).all()
    local = (vertices - camera.position) @ camera.camera_to_world[:3, :3]
    u = camera.lens.center[0] - camera.lens.focal[0] * local[:, 0] / local[:, 2]
    v = camera.lens.center[1] + camera.lens.focal[1] * local[:, 1] / local[:, 2]
    u, v = u[pose.boundary_faces], v[pose.boundary_faces]
    seen = (u > 0) & (u < camera.width) & (v > 0) & (v < camera.height)
    for values, low, high in ((u, left, right), (v, top, bottom)):
        assert (values[seen] > np.broadcast_to(low[:, None], u.shape)[seen]).all()
        assert (values[seen] < np.broadcast_to(high[:, None], u.shape)[seen]).all()
    behind = replace(camera, camera_to_world=camera.camera_to_world @ np.diag([1, 1, -1, 1]))
    assert not len(bounding_rectangles(behind, vertices, pose.boundary_faces))
    bent = replace(camera, lens=replace(camera.lens, radial=(0.1, 0.0, 0.0, 0.0)))
    assert not len(bounding_rectangles(bent, vertices, pose.boundary_faces))


def test_rows_with_faces_have_more_work(make_ball_field):
    rng = np.random.default_rng()
    camera, pose = view(rng), pose_of(make_ball_field(3), rng)
    vertices = pose.vertices.numpy().astype(float)
    work = row_work(camera, bounding_rectangles(camera, vertices, pose.boundary_faces))
    assert work.shape == (camera.height,) and (work >= camera.width).all()
    assert work[0] == camera.width < 10 * work[camera.height // 2]


def test_rays_near_an_edge_have_to_search(make_ball_field):
    """Those at vertices and at the middles of edges, which a walk may see on either side."""
    rng = np.random.default_rng()
    pose, camera = pose_of(make_ball_field(3), rng), view(rng)
    corners = pose.vertices.numpy()[pose.boundary_faces]
    aims = np.concatenate([corners[:, 0], 0.5 * (corners[:, 0] + corners[:, 1])])
    for aim in rng.choice(aims, 20, replace=False):
        turned = replace(camera, camera_to_world=look_at(camera.position, aim))
        lens = replace(turned.lens, width=1, height=1, center=(0.5, 0.5))
        turned = replace(turned, lens=lens)
        counts = begun(turned, pose)[0].entries.count.numpy()
        assert counts[0] in (UNKNOWN, 0)  # 0: an outline that the ray misses by a rounding


def test_a_vertex_that_is_nowhere_leaves_rays_to_search(make_ball_field):
    rng = np.random.default_rng()
    for number in (np.nan, np.inf):
        for parallel in (False, True):
            pose, camera = pose_of(make_ball_field(3), rng), view(rng, parallel)
            vertices = pose.vertices.numpy().copy()
            vertices[pose.boundary_faces[0, 0]] = number
            assert not len(bounding_rectangles(camera, vertices, pose.boundary_faces))


@wp.kernel(enable_backward=False)
def entries_kernel(
    geometry: Geometry,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    entries: Entries,
):
    ray = wp.tid()
    find_entries(geometry, origins[ray], directions[ray], ray, entries, True)


def test_rays_through_many_sheets_keep_as_many_entries_as_a_list_holds(device):
    """Both ways to find entries; rays with more search, as those that meet an edge do."""
    rng = np.random.default_rng()
    grid = a15_grid(0.05)
    x = grid.rest_vertices[grid.tets].mean(axis=1)[:, 0]
    for count in (3, 7, 12):
        mesh, _ = extract(grid, (np.floor(x / 0.04) % 2 == 0) & (x < 0.08 * count))
        pose = Pose(mesh, tet_neighbours(mesh.tets), device)
        eye = np.array([-1.5, *rng.uniform(0.3, 0.7, 2)])
        camera = from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.3, 40, 40)
        rays = empty_rays(1600, pose.device)
        rays.entries = empty_entries(1600, pose.device)
        for array, values in zip((rays.origins, rays.directions), camera_rays(camera), strict=True):
            array.assign(values)
        pose.refresh_face_boxes()
        inputs = [pose.geometry, rays.origins, rays.directions, rays.entries]
        wp.launch(entries_kernel, 1600, inputs, device=device)
        expected, ways = crossings(pose, rays), [rays]
        if pose.device.is_cpu:
            ways.append(begun(camera, pose)[0])
        for way in ways:
            counts, t = way.entries.count.numpy(), way.entries.t.numpy()
            known = counts != UNKNOWN
            enters = [[t for t, entering in ray if entering] for ray in expected]
            many = np.array([len(ts) > MOST_ENTRIES for ts in enters])
            assert not known[many].any() and known[~many].mean() > 0.9
            assert many.mean() > 0.5 if count == 12 else counts.max() >= count
            for ray in np.flatnonzero(known):
                np.testing.assert_allclose(t[: counts[ray], ray], enters[ray], rtol=1e-5)
