"""Tet frames and walks: a ray's pieces fill its chord, in every pose."""

import numpy as np
import pytest
import warp as wp

from deformrf.core.definition.deformation import deformation
from deformrf.core.definition.image import ray_pieces
from deformrf.core.geometry import TetMesh
from deformrf.core.render import Geometry, Pose, empty_rays, empty_samples
from deformrf.core.render.rays.marching import march_kernel
from deformrf.core.render.rays.traversal import line_in_tet, speed_and_fade

SLOTS = 512


def random_rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def random_rays(count, rng):
    """Rays from outside towards random points of the ball's box."""
    origins = rng.normal(size=(count, 3))
    origins = 0.5 + 1.5 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = rng.uniform(0.25, 0.75, (count, 3)) - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


@wp.kernel
def speeds_kernel(
    geometry: Geometry,
    directions: wp.array(dtype=wp.vec3),
    speeds: wp.array(dtype=float),
    fades: wp.array(dtype=float),
):
    tet = wp.tid()
    _alpha, slope = line_in_tet(geometry, tet, directions[tet], 0.0, directions[tet])
    speed, fade = speed_and_fade(geometry, tet, slope)
    speeds[tet] = speed
    fades[tet] = fade


def rest_speeds(geometry, directions, device):
    """|F^-1 d| and the fade of each tet, one direction for each."""
    speeds, fades = (wp.empty(len(directions), dtype=float, device=device) for _ in range(2))
    directions = wp.array(directions, dtype=wp.vec3, device=device)
    inputs, outputs = [geometry, directions], [speeds, fades]
    wp.launch(speeds_kernel, len(speeds), inputs=inputs, outputs=outputs, device=device)
    return speeds.numpy(), fades.numpy()


def test_frames_kernel_matches_the_reference(make_ball_field, device):
    rng = np.random.default_rng()
    mesh = make_ball_field(1).mesh
    vertices = mesh.rest_vertices + rng.normal(size=mesh.rest_vertices.shape) * 0.003
    pose = Pose(mesh, make_ball_field(1).neighbours, device)
    pose.set_vertices(vertices)
    geometry = pose.geometry
    expected = deformation(mesh.rest_vertices, vertices, mesh.tets)
    rows = geometry.rows.numpy().reshape(-1, 3, 4)
    np.testing.assert_allclose(rows[..., :3], expected[0][:, 1:, :3], rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(rows[..., 3], vertices[mesh.tets[:, 0]], rtol=1e-6)
    directions = rng.normal(size=(mesh.tet_count, 3))
    speeds, fades = rest_speeds(geometry, directions, device)
    expected_speeds = np.linalg.norm(np.einsum("tij,tj->ti", expected[1], directions), axis=1)
    np.testing.assert_allclose(speeds, expected_speeds, rtol=1e-4)
    np.testing.assert_allclose(geometry.rotations.numpy(), expected[2], atol=1e-5)
    np.testing.assert_allclose(fades, expected[3], atol=1e-4)


def test_a_rotated_and_scaled_pose_has_that_rotation(make_ball_field, device):
    rng = np.random.default_rng()
    field = make_ball_field(1)
    rotation = random_rotation(rng)
    pose = Pose(field.mesh, field.neighbours, device)
    pose.set_vertices(1.7 * field.mesh.rest_vertices @ rotation.T + 3.0)
    expected = np.broadcast_to(rotation, (field.mesh.tet_count, 3, 3))
    np.testing.assert_allclose(pose.geometry.rotations.numpy(), expected, atol=1e-4)
    np.testing.assert_allclose(pose.geometry.shapes.numpy()[1::2, 2], 1.0)


def test_a_mirrored_pose_keeps_its_reflection(make_ball_field, device):
    field = make_ball_field(1)
    pose = Pose(field.mesh, field.neighbours, device)
    mirror = np.diag([1.0, -1.0, 1.0])
    pose.set_vertices(field.mesh.rest_vertices @ mirror)
    expected = np.broadcast_to(mirror, (field.mesh.tet_count, 3, 3))
    np.testing.assert_allclose(pose.geometry.rotations.numpy(), expected, atol=1e-4)


def lone_tets(count, rng):
    """A mesh of `count` tets that share nothing, each of its own shape and size."""
    corners = rng.normal(size=(count, 4, 3))
    edges = corners[:, 1:] - corners[:, :1]
    thick = np.linalg.svd(edges, compute_uv=False)[:, 2] > 0.2
    corners[np.linalg.det(edges) < 0] *= [1, 1, -1]
    rest = corners[thick].reshape(-1, 3)
    addresses = np.zeros((len(rest), 3), np.int32)  # poses do without
    return TetMesh(rest, addresses, np.arange(len(rest), dtype=np.int32).reshape(-1, 4))


@pytest.mark.parametrize("longest", [1.0, 117.0, 1e3, 1e6])
def test_polar_factors_of_random_deformations(device, longest):
    """Of any stretches, mirrored or not: DESIGN asks for 0.1 degrees wherever s > 0."""
    rng = np.random.default_rng()
    mesh = lone_tets(6000, rng)
    count = mesh.tet_count
    stretches = longest * 10.0 ** -rng.uniform(0.0, 3.2, (count, 3))
    stretches[: count // 2, 0] = longest  # one long, two short; two long, one short
    stretches[: count // 4, 1] = longest
    stretches[::5] = longest * np.array([1.0, 1.0 / 117, 0.58 / 117])
    left, right = (np.linalg.qr(rng.normal(size=(count, 3, 3)))[0] for _ in range(2))
    deformations = left * stretches[:, None] @ right  # half of them mirror
    vertices = np.einsum("tij,tkj->tki", deformations, mesh.rest_vertices[mesh.tets])
    vertices = vertices.reshape(-1, 3).astype(np.float32)
    pose = Pose(mesh, np.full((count, 4), -1), device)
    pose.set_vertices(vertices)
    _, _, expected, fades = deformation(mesh.rest_vertices, vertices.astype(float), mesh.tets)
    rotations = pose.geometry.rotations.numpy().astype(float)
    np.testing.assert_allclose(pose.geometry.shapes.numpy()[1::2, 2], fades, atol=1e-4)
    np.testing.assert_allclose(rotations @ rotations.swapaxes(1, 2), [np.eye(3)] * count, atol=1e-5)
    turned = (rotations - expected)[fades > 0]  # chord: 2 √2 sin(angle / 2)
    degrees = np.degrees(2 * np.arcsin(np.linalg.norm(turned, axis=(1, 2)) / np.sqrt(8)))
    assert len(degrees) > count // 2
    assert degrees.max() < 0.02  # of a float32 inverse at rest


def test_flat_tets_fade_out(make_ball_field, device):
    field = make_ball_field(1)
    pose = Pose(field.mesh, field.neighbours, device)
    pose.set_vertices(field.mesh.rest_vertices * [1.0, 1.0, 0.0])
    assert (pose.geometry.shapes.numpy()[1::2, 2] == 0.0).all()
    assert np.isfinite(pose.geometry.rows.numpy()).all()


@pytest.mark.parametrize("far", [10.0, 1e3, 1e6, 1e9, 1e12])
def test_tets_that_reach_far_away_fade(make_ball_field, device, far):
    """Their middle stretch would be lost beside the largest one, and they would be solid."""
    rng = np.random.default_rng()
    field = make_ball_field(1)
    vertices = field.mesh.rest_vertices.copy()
    moved = rng.choice(len(vertices), 20, replace=False)
    directions = rng.normal(size=(20, 3))
    vertices[moved] += far * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    vertices = vertices.astype(np.float32)
    pose = Pose(field.mesh, field.neighbours, device)
    pose.set_vertices(vertices)
    fade = pose.geometry.shapes.numpy()[1::2, 2]
    *_, expected = deformation(field.mesh.rest_vertices, vertices.astype(float), field.mesh.tets)
    np.testing.assert_allclose(fade, expected, atol=1e-5)
    assert (expected < 1.0).any() and (expected == 1.0).any()


def march(field, vertices, origins, directions, device, jitter_seed=0):
    """All pieces of all rays in one round: ray, tet, bary, length, t."""
    pose = Pose(field.mesh, field.neighbours, device)
    pose.set_vertices(vertices)
    pose.geometry.occupancy = wp.array(field.occupancy, dtype=wp.uint64, device=device)
    pose.geometry.step = field.options.march_step
    count = len(origins)
    rays = empty_rays(count, device)
    rays.origins.assign(origins.astype(np.float32))
    rays.directions.assign(directions.astype(np.float32))
    slots = empty_samples(count * SLOTS, device)
    counts = wp.zeros(count, dtype=int, device=device)
    wp.launch(
        march_kernel,
        dim=count,
        inputs=[
            pose.geometry,
            rays,
            wp.array(np.arange(count, dtype=np.int32), dtype=int, device=device),
            SLOTS,
            jitter_seed,
        ],
        outputs=[slots, counts],
        device=device,
    )
    counts = counts.numpy()
    assert (rays.tet.numpy() == -2).all()  # every ray came to its end
    filled = np.arange(SLOTS) < counts[:, None]
    ray = np.nonzero(filled)[0]
    return ray, *(
        getattr(slots, name).numpy().reshape(count, SLOTS, *shape)[filled]
        for name, shape in (("tet", ()), ("bary", (4,)), ("length", ()), ("t", ()))
    )


def chords(field, vertices, origins, directions):
    """Rest length within the mesh along each ray, by brute force.  [R]"""
    ray, _, _, t_in, t_out, _, rate = ray_pieces(field.definition, vertices, origins, directions)
    return np.bincount(ray, (t_out - t_in) * rate, minlength=len(origins))


def assert_chords(total, field, vertices, origins, directions, rng):
    """Each ray's length is the chord of the ray or of one that float32 can't tell from it.

    The end of a chord moves without bound as a ray becomes parallel to the boundary, so a
    ray whose length is off must have neighbours, one rounding away, at least as far off.
    """
    expected = chords(field, vertices, origins, directions)
    error = np.abs(total - expected)
    off = np.flatnonzero(error > 1e-5)
    assert len(off) <= 0.03 * len(total)
    for ray in off:
        near = origins[ray] + 2e-7 * np.abs(origins).max() * rng.normal(size=(32, 3))
        moved = chords(field, vertices, near, np.broadcast_to(directions[ray], near.shape))
        assert error[ray] <= np.abs(moved - expected[ray]).max(), ray


def bent(x):
    """A half-turn around an axis beside the ball: no overlap."""
    angle, radius = 2.0 * (x[:, 2] - 0.5), 0.45 + (x[:, 0] - 0.5)
    return np.stack([0.05 + radius * np.cos(angle), x[:, 1], 0.5 + radius * np.sin(angle)], axis=1)


@pytest.mark.parametrize("deform", [lambda x: x, bent, lambda x: (x - 0.5) * [0.7, 0.8, 1.5] + 0.5])
def test_walks_find_the_pieces_of_the_brute_force_reference(make_ball_field, device, deform):
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), occupied_share=1.0)
    vertices = deform(field.mesh.rest_vertices).astype(np.float32).astype(float)
    origins, directions = random_rays(200, rng)
    origins, directions = (a.astype(np.float32).astype(float) for a in (origins, directions))
    ray, _tet, bary, length, t = march(field, vertices, origins, directions, device)
    total = np.bincount(ray, length, minlength=200)  # the whole chord, nothing twice
    assert_chords(total, field, vertices, origins, directions, rng)
    assert (np.diff(t)[np.diff(ray) == 0] > -1e-6).all()  # in order
    assert bary.min() > -1e-3
    np.testing.assert_allclose(bary.sum(axis=1), 1.0, atol=1e-4)


def test_middles_are_where_the_reference_has_them(make_ball_field, device):
    """A ten-thousandth of a piece away, one in some thousand would fall into another sub-tet."""
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), occupied_share=0.5)
    rest = field.mesh.rest_vertices.astype(np.float32).astype(float)
    origins, directions = random_rays(400, rng)
    origins, directions = (a.astype(np.float32).astype(float) for a in (origins, directions))
    ray, _, _, _, t = march(field, rest, origins, directions, device)
    expected_ray, _, _, t_in, t_out, *_ = ray_pieces(field.definition, rest, origins, directions)
    order = np.lexsort((t_in, expected_ray))
    expected_ray, expected = expected_ray[order], 0.5 * (t_in + t_out)[order]
    same = np.bincount(ray, minlength=400) == np.bincount(expected_ray, minlength=400)
    assert same.mean() > 0.98
    off = abs(t[same[ray]] - expected[same[expected_ray]]) / np.spacing(t[same[ray]])
    # Units in the last place of t: 0.45 by its own rounding alone, 1 with points rounded before
    # they are compared with corners.  Warp's CPU code has no fused multiply-add.
    assert np.quantile(off, 0.9) < (0.6 if wp.get_device(device).is_cuda else 0.85)


def test_rays_through_vertices_and_edges_do_not_get_lost(make_ball_field, device):
    rng = np.random.default_rng()
    field = make_ball_field(2, occupied_share=1.0)
    rest = field.mesh.rest_vertices
    pairs = field.mesh.tets[rng.integers(0, field.mesh.tet_count, 300)][:, :2]
    targets = np.concatenate([rest[pairs[:150, 0]], rest[pairs[150:]].mean(axis=1)])
    origins = 0.5 + 2.0 * np.eye(3)[rng.integers(0, 3, 300)] + rng.normal(size=(300, 3)) * 0.01
    directions = targets - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ray, _, _, length, _ = march(field, rest, origins, directions, device)
    total = np.bincount(ray, length, minlength=300)
    expected = chords(field, rest, origins, directions)
    # Only a ray that grazes the boundary within rounding may miss a tet there.
    assert (np.abs(total - expected) > 1e-3).sum() <= 1


def test_rays_that_start_inside_see_what_lies_ahead(make_ball_field, device):
    rng = np.random.default_rng()
    field = make_ball_field(4, occupied_share=1.0)
    rest = field.mesh.rest_vertices
    origins, directions = random_rays(200, rng)
    origins = rng.uniform(0.35, 0.65, (200, 3))
    ray, _, _, length, _ = march(field, rest, origins, directions, device)
    origins, directions = (a.astype(np.float32).astype(float) for a in (origins, directions))
    total = np.bincount(ray, length, minlength=200)
    assert total.min() > 0.01
    assert_chords(total, field, rest, origins, directions, rng)


def test_jitter_moves_samples_inside_their_pieces_only(make_ball_field, device):
    rng = np.random.default_rng()
    field = make_ball_field(3, occupied_share=1.0)
    origins, directions = random_rays(100, rng)
    rest = field.mesh.rest_vertices
    still = march(field, rest, origins, directions, device)
    moved = march(field, rest, origins, directions, device, jitter_seed=7)
    for i in (0, 1):  # ray and tet: the pieces themselves stay
        np.testing.assert_array_equal(still[i], moved[i])
    for i in (3, 4):  # length and t, which compilers may round differently
        np.testing.assert_allclose(still[i], moved[i], rtol=1e-5)
    corners = rest[field.mesh.tets[still[1]]]
    apart = np.einsum("nc,ncx->nx", moved[2] - still[2], corners)
    along = np.einsum("nx,nx->n", apart, directions[still[0]])
    assert (np.abs(along) <= 0.5 * still[3] + 1e-5).all()
    np.testing.assert_allclose(apart, along[:, None] * directions[still[0]], atol=1e-5)
    assert np.abs(along).mean() > 0.2 * still[3].mean()
