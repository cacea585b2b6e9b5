"""Weights: a partition of one, smooth, bounded, and no torn tets."""

import numpy as np
import pytest

from deformrf.core.base.paths import ASSETS
from deformrf.core.field import load
from deformrf.core.geometry import (
    TetMesh,
    a15_grid,
    boundary_faces,
    edges,
    extract,
    signed_volumes,
    tet_neighbours,
)
from deformrf.wings.rig import (
    automatic_weights,
    fitted_weights,
    make_skeleton,
    nearest_point_weights,
    rigid_weights,
    rotations,
    skinned,
    surface_samples,
    turned,
)
from deformrf.wings.rig.fitting import located
from deformrf.wings.rig.laplacian import (
    laplacian,
    pulled_at,
    shares_near,
    solved,
    solved_as_shares,
)
from deformrf.wings.rig.skeleton import skinning_matrices
from deformrf.wings.rig.weights import harmonic_weights, nearest_on_triangles


@pytest.fixture(scope="module")
def bar():
    """A bar along z with two bones: the middle is at z = 0.5."""
    grid = a15_grid(0.05)
    middles = grid.rest_vertices[grid.tets].mean(axis=1)
    mesh, _ = extract(grid, (np.abs(middles[:, :2] - 0.5) < 0.12).all(axis=1))
    heads, tails = [[0.5, 0.5, 0.0], [0.5, 0.5, 0.5]], [[0.5, 0.5, 0.5], [0.5, 0.5, 1.0]]
    return mesh, make_skeleton(("lower", "upper"), (-1, 0), heads, tails)


def surface(mesh):
    return np.unique(boundary_faces(mesh.tets, tet_neighbours(mesh.tets))[0])


def assert_weights(weights, mesh, bone_count=2):
    assert weights.shape == (mesh.vertex_count, bone_count) and weights.dtype == np.float32
    assert (weights >= 0.0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-6)


def assert_offsets(offsets, weights):
    assert offsets.shape == (*weights.shape, 3) and offsets.dtype == np.float32
    np.testing.assert_allclose(offsets.sum(axis=1), 0.0, atol=1e-6)
    assert not offsets[weights == 0.0].any()


def test_the_laplacian_of_a_linear_function_is_zero_inside(bar):
    mesh, _ = bar
    operator = laplacian(mesh)
    u = mesh.rest_vertices @ np.random.default_rng().normal(size=(3, 1))
    residual = operator.degrees[:, None] * u - operator.gathered(u)
    inside = np.setdiff1d(np.arange(mesh.vertex_count), surface(mesh))
    assert len(inside) and np.abs(residual[inside]).max() < 1e-12


def test_conjugate_gradients_solve_the_equations(bar):
    mesh, _ = bar
    rng = np.random.default_rng()
    operator, count = laplacian(mesh), mesh.vertex_count
    pull, sources = rng.uniform(size=count), rng.normal(size=(count, 2))
    matrix = np.diag(operator.degrees + pull)
    first = np.repeat(np.arange(count), np.diff(np.append(operator.starts, len(operator.ends))))
    matrix[first, operator.ends] -= operator.conductances
    found = solved(operator, pull, sources)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, sources), atol=1e-4)


def test_the_nearest_shares_are_found():
    rng = np.random.default_rng()
    values, others = rng.normal(size=(30, 5)), rng.dirichlet(np.full(5, 0.4), 4000)
    near = shares_near(values)
    assert (near >= 0.0).all()
    np.testing.assert_allclose(near.sum(axis=1), 1.0)
    np.testing.assert_allclose(shares_near(near), near, atol=1e-12)
    away = np.linalg.norm(values[:, None] - others, axis=2).min(axis=1)
    assert (np.linalg.norm(values - near, axis=1) <= away + 1e-12).all()


def random_places(mesh, rng, count=300):
    """Corners of their tets [N, 4], barycentric coordinates [N, 4] and strengths [N]."""
    corners = mesh.tets[rng.integers(0, mesh.tet_count, count)]
    return corners, rng.dirichlet(np.ones(4), count), rng.uniform(size=count)


def test_places_pull_at_the_corners_of_their_tets(bar):
    mesh, _ = bar
    rng = np.random.default_rng()
    corners, shares = (
        mesh.tets[rng.integers(0, mesh.tet_count, 300)],
        rng.dirichlet(np.ones(4), 300),
    )
    strength, operator = rng.uniform(size=300), laplacian(mesh)
    both, u = (
        pulled_at(operator, corners, shares, strength),
        rng.normal(size=(mesh.vertex_count, 2)),
    )
    wanted = operator.degrees[:, None] * u - operator.gathered(u)
    there = np.einsum("nc,ncb->nb", shares, u[corners])
    np.add.at(wanted, corners, (strength[:, None] * shares)[:, :, None] * there[:, None])
    np.testing.assert_allclose(both.degrees[:, None] * u - both.gathered(u), wanted, atol=1e-12)


def test_shares_of_least_energy_can_not_be_bettered(bar):
    """Where a share is above 0, no other one of its vertex has a smaller slope."""
    mesh, _ = bar
    rng = np.random.default_rng()
    corners, shares = (
        mesh.tets[rng.integers(0, mesh.tet_count, 300)],
        rng.dirichlet(np.ones(4), 300),
    )
    operator = pulled_at(laplacian(mesh), corners, shares, strength := rng.uniform(size=300))
    wanted, sources = rng.normal(size=(300, 4)), np.zeros((mesh.vertex_count, 4))
    np.add.at(sources, corners, (strength[:, None] * shares)[:, :, None] * wanted[:, None])
    start = solved(operator, 0.0, sources)
    assert start.min() < -0.01  # weights below 0 would fit best
    u = solved_as_shares(operator, sources, start)
    np.testing.assert_allclose(u.sum(axis=1), 1.0)
    assert (u >= 0.0).all() and (u == 0.0).any()
    degrees = operator.degrees[:, None]
    slope = (degrees * u - operator.gathered(u) - sources) / degrees
    above = np.where(u > 0.0, slope, -np.inf).max(axis=1) - slope.min(axis=1)
    assert above.max() < 1e-3


def test_harmonic_weights_keep_the_surface_and_linear_functions(bar):
    mesh, _ = bar
    ids, z = surface(mesh), mesh.rest_vertices[:, 2]
    share = (z - z.min()) / np.ptp(z)
    given = np.stack([1.0 - share, share], axis=1)
    weights = harmonic_weights(mesh, ids, given[ids])
    assert_weights(weights, mesh)
    np.testing.assert_allclose(weights, given, atol=2e-3)


def test_harmonic_weights_have_no_maximum_inside(bar):
    mesh, _ = bar
    ids = surface(mesh)
    given = np.random.default_rng().dirichlet([1.0, 1.0, 1.0], len(ids))
    weights = harmonic_weights(mesh, ids, given)
    assert_weights(weights, mesh, 3)
    assert (weights.max(axis=0) <= given.max(axis=0) + 1e-3).all()


def test_parts_without_given_weights_take_the_nearest():
    grid = a15_grid(0.1)
    x = grid.rest_vertices[grid.tets].mean(axis=1)[:, 0]
    mesh, _ = extract(grid, (x < 0.2) | (x > 0.8))
    left = np.flatnonzero(mesh.rest_vertices[:, 0] < 0.5)
    weights = harmonic_weights(mesh, left[:1], np.array([[0.25, 0.75]]))
    np.testing.assert_allclose(weights, np.tile([0.25, 0.75], (mesh.vertex_count, 1)), atol=1e-5)


def test_bones_divide_a_bar_in_its_middle(bar):
    mesh, skeleton = bar
    z = mesh.rest_vertices[:, 2]
    for weights in (automatic_weights(mesh, skeleton), rigid_weights(mesh, skeleton)):
        assert_weights(weights, mesh)
        assert (weights[z < 0.3].argmax(axis=1) == 0).all()
        assert (weights[z > 0.7].argmax(axis=1) == 1).all()
    pairs = edges(mesh.tets)
    smooth = automatic_weights(mesh, skeleton)
    assert np.abs(smooth[pairs[:, 0]] - smooth[pairs[:, 1]]).max() < 0.5


def test_bones_that_move_nothing_have_no_weight(bar):
    mesh, skeleton = bar
    for make in (automatic_weights, rigid_weights):
        np.testing.assert_array_equal(make(mesh, skeleton, np.array([False, True]))[:, 0], 0.0)


def test_a_bone_has_no_weight_across_a_gap():
    """Two bars that join at the top: at the bottom they are one cell apart."""
    grid = a15_grid(0.05)
    middles = grid.rest_vertices[grid.tets].mean(axis=1)
    x, y, z = middles.T
    keep = (np.abs(y - 0.5) < 0.1) & (x > 0.2) & (x < 0.8) & ((np.abs(x - 0.5) > 0.12) | (z > 0.8))
    mesh, _ = extract(grid, keep)
    heads, tails = [[0.3, 0.5, 0.8], [0.7, 0.5, 0.8]], [[0.3, 0.5, 0.0], [0.7, 0.5, 0.0]]
    weights = automatic_weights(mesh, make_skeleton(("left", "right"), (-1, -1), heads, tails))
    foot = mesh.rest_vertices[:, 2] < 0.4
    left = mesh.rest_vertices[:, 0] < 0.5
    assert weights[foot & left, 1].max() < 0.1 and weights[foot & ~left, 0].max() < 0.1


def test_automatic_weights_bend_the_helmet_without_torn_tets():
    """Two bones, 69 degrees about three axes, as other programs' weights were measured."""
    mesh = load(ASSETS / "helmet.npz").mesh
    x = mesh.rest_vertices
    low, high = x.min(axis=0), x.max(axis=0)
    middle = 0.5 * (low + high)
    bottom, top = middle * [1, 1, 0] + [0, 0, low[2]], middle * [1, 1, 0] + [0, 0, high[2]]
    skeleton = make_skeleton(("a", "b"), (-1, 0), [bottom, middle], [middle, top])
    weights = automatic_weights(mesh, skeleton)
    rest = signed_volumes(x, mesh.tets)
    for axis in ([1, 0, 0], [0, 1, 0], [0.7, 0.7, 0]):
        pose = turned(skeleton, skeleton.rest_pose, 1, np.radians(69.0) * np.array(axis))
        matrices = skinning_matrices(skeleton, pose)
        for method, least in (("linear", 0.1), ("dual quaternion", 0.2)):
            ratio = signed_volumes(skinned(x, weights, matrices, method), mesh.tets) / rest
            assert ratio.min() > least


def ball():
    """Points and triangles of a sphere about the middle, and weights that change over it."""
    rows = np.linspace(0.05, np.pi - 0.05, 12)
    columns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    a, b = np.meshgrid(rows, columns, indexing="ij")
    points = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=-1)
    ids = np.arange(points[..., 0].size).reshape(12, 24)
    corner = ids[:-1], np.roll(ids, -1, 1)[:-1], ids[1:], np.roll(ids, -1, 1)[1:]
    triangles = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in (corner[:3], corner[1:])])
    points = 0.5 + 0.3 * points.reshape(-1, 3)
    share = np.clip(points[:, 2], 0.0, 1.0)
    return points, triangles, np.stack([1.0 - share, share], axis=1)


@pytest.fixture(scope="module")
def around_ball():
    """A mesh whose surface lies farther out than the ball's, and the ball."""
    grid = a15_grid(0.06)
    away = np.linalg.norm(grid.rest_vertices[grid.tets].mean(axis=1) - 0.5, axis=1)
    return extract(grid, away < 0.42)[0], ball()


def test_fitted_weights_move_the_surface_as_its_own_do(around_ball):
    mesh, (points, triangles, weights) = around_ball
    fitted, offsets = fitted_weights(mesh, points, triangles, weights)
    assert_weights(fitted, mesh)
    assert_offsets(offsets, fitted)
    tet, bary = located(mesh, points)
    assert (tet >= 0).all()
    there = np.einsum("nc,ncb->nb", bary, fitted[mesh.tets[tet]])
    assert np.abs(there - weights).mean() < 0.03


def folded(points, weights, offsets=None):
    """Points [N, 3] after the second bone of the ball is turned by 1.5 about x."""
    matrices = np.tile(np.eye(4), (2, 1, 1))
    turn, middle = rotations.matrix_of(rotations.of_vector([1.5, 0.0, 0.0])), np.full(3, 0.5)
    matrices[1, :3, :3], matrices[1, :3, 3] = turn, middle - turn @ middle
    return skinned(points, weights, matrices, offsets=offsets)


@pytest.fixture(scope="module")
def around_triangle():
    """A coarse mesh, and a triangle in it that is as large as it."""
    mesh, _ = extract(grid := a15_grid(0.1), np.ones(grid.tet_count, bool))
    points = np.array([[0.2, 0.4, 0.2], [0.8, 0.5, 0.25], [0.45, 0.6, 0.75]])
    return mesh, points, np.array([[0, 1, 2]]), np.array([[0.8, 0.2], [0.6, 0.4], [0.2, 0.8]])


def test_the_inside_of_a_large_triangle_follows_its_corners(around_triangle):
    """Tets bend as their corners do, the triangle stays flat: offsets make up for both."""
    mesh, points, triangles, point_weights = around_triangle
    weights, offsets = fitted_weights(mesh, points, triangles, point_weights, fit=1e6)
    assert_weights(weights, mesh)
    assert_offsets(offsets, weights)
    shares = np.random.default_rng().dirichlet(np.full(3, 3.0), 100)
    tet, bary = located(mesh, shares @ points)
    chords = shares @ folded(points, point_weights)

    def error(offsets):
        corners = folded(mesh.rest_vertices, weights, offsets)[mesh.tets[tet]]
        return np.abs(np.einsum("nc,nci->ni", bary, corners) - chords).max()

    # With fit=1e6, not infinity, up to 1.6e-4 was seen.
    assert error(offsets) < 5e-4 and error(None) > 0.05


def test_the_nearest_point_of_a_triangle_gives_its_offsets(around_triangle):
    mesh, points, triangles, point_weights = around_triangle
    weights, offsets = nearest_point_weights(mesh, points, triangles, point_weights)
    assert_offsets(offsets, weights)
    shares = np.random.default_rng().dirichlet(np.ones(3), 100)
    on_it = TetMesh(shares @ points, mesh.addresses[:100], mesh.tets[:1])
    weights, offsets = nearest_point_weights(on_it, points, triangles, point_weights)
    found = folded(on_it.rest_vertices, weights, offsets)
    np.testing.assert_allclose(found, shares @ folded(points, point_weights), atol=1e-3)


def test_what_moves_as_one_has_no_offsets(around_triangle):
    mesh, points, triangles, _ = around_triangle
    for make in (fitted_weights, nearest_point_weights):
        _, offsets = make(mesh, points, triangles, np.tile([0.3, 0.7], (3, 1)))
        assert offsets is None


def test_a_surface_elsewhere_is_said_so(around_ball):
    mesh, (points, triangles, weights) = around_ball
    with pytest.raises(ValueError, match="of the rig's surface lies inside the model"):
        fitted_weights(mesh, points + 2.0, triangles, weights)


def test_samples_cover_the_surface(around_ball):
    _, (points, triangles, weights) = around_ball
    places, areas, there = surface_samples(points, triangles, weights, 0.05)
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(areas.sum(), 0.5 * np.linalg.norm(normals, axis=1).sum())
    np.testing.assert_allclose(there[:, 1], places[:, 2], atol=1e-9)


def test_places_are_found_in_their_tets(around_ball):
    mesh, _ = around_ball
    rng = np.random.default_rng()
    tet = rng.integers(0, mesh.tet_count, 200)
    bary = rng.dirichlet(np.ones(4), 200)
    places = np.einsum("nc,nci->ni", bary, mesh.rest_vertices[mesh.tets[tet]])
    found, there = located(mesh, np.concatenate([places, [[5.0, 5.0, 5.0], [0.0, 0.0, 0.0]]]))
    np.testing.assert_array_equal(found, [*tet, -1, -1])
    np.testing.assert_allclose(there[:-2], bary, atol=1e-9)


def test_nearest_points_of_triangles(around_ball):
    rng = np.random.default_rng()
    corners, places = rng.normal(size=(20, 3, 3)), 2.0 * rng.normal(size=(60, 3))
    triangle, bary = nearest_on_triangles(places, corners)
    np.testing.assert_allclose(bary.sum(axis=1), 1.0)
    assert (bary >= -1e-12).all()
    found = np.linalg.norm(np.einsum("nc,nci->ni", bary, corners[triangle]) - places, axis=1)
    many = rng.dirichlet([0.5, 0.5, 0.5], 4000)
    samples = np.einsum("kc,mci->mki", many, corners).reshape(-1, 3)
    brute = np.linalg.norm(places[:, None] - samples, axis=2).min(axis=1)
    assert (found <= brute + 1e-12).all() and (brute - found).max() < 0.1


def test_a_surface_gives_its_weights_to_what_is_near(around_ball):
    mesh, (points, triangles, weights) = around_ball
    ids = np.unique(boundary_faces(mesh.tets, tet_neighbours(mesh.tets))[0])
    found, offsets = nearest_point_weights(mesh, points, triangles, weights)
    toward = mesh.rest_vertices[ids] - 0.5
    on_ball = 0.5 + 0.3 * toward / np.linalg.norm(toward, axis=1, keepdims=True)
    np.testing.assert_allclose(found[ids, 1], on_ball[:, 2], atol=0.03)
    assert_offsets(offsets, found)
