"""Subdivision: the eight children tile their parent, and the kernels agree with NumPy."""

import numpy as np
import pytest
import warp as wp

from deformrf.core.definition.subdivision import (
    CHILD_FROM_PARENT,
    PARENT_FROM_CHILD,
    child_path,
    descend,
)
from deformrf.core.geometry import (
    along,
    child_of,
    into_child,
    lattice_axes,
    lattice_cell,
    lattice_point,
    lattice_weights,
    path_corners,
    path_nodes,
)

# C of DeformRF's supplement: coordinates in child k from those in its parent.
PUBLISHED = np.array(
    [
        [[1, -1, -1, -1], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 2]],
        [[-1, 1, -1, -1], [0, 0, 2, 0], [2, 0, 0, 0], [0, 0, 0, 2]],
        [[-1, -1, 1, -1], [2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 0, 2]],
        [[-1, -1, -1, 1], [2, 0, 0, 0], [0, 0, 2, 0], [0, 2, 0, 0]],
        [[1, 1, -1, -1], [0, 0, 2, 0], [1, -1, -1, 1], [-1, 1, 1, 1]],
        [[1, 1, -1, -1], [1, -1, 1, 1], [0, 0, 0, 2], [-1, 1, 1, -1]],
        [[-1, -1, 1, 1], [1, 1, 1, -1], [0, 2, 0, 0], [1, -1, -1, 1]],
        [[-1, -1, 1, 1], [2, 0, 0, 0], [-1, 1, 1, -1], [1, 1, -1, 1]],
    ]
)


def random_alpha(count):
    """Points spread evenly over a tetrahedron.  [count, 4]"""
    return np.random.default_rng().dirichlet(np.ones(4), size=count)


def test_children_have_an_eighth_of_the_volume():
    np.testing.assert_allclose(np.abs(np.linalg.det(PARENT_FROM_CHILD)), 1 / 8)


def test_every_point_lies_in_exactly_one_child():
    alpha = random_alpha(10_000)
    inside = (np.einsum("kij,nj->nki", CHILD_FROM_PARENT, alpha) > 0).all(axis=-1)
    assert (inside.sum(axis=1) == 1).all()
    np.testing.assert_array_equal(inside.argmax(axis=1), descend(alpha)[0])


@pytest.mark.parametrize("levels", [1, 6, 12])
def test_a_point_keeps_its_place(levels):
    alpha = child_alpha = random_alpha(1000)
    vertices = np.broadcast_to(np.eye(4), (1000, 4, 4))  # columns, in the root's coordinates
    for _ in range(levels):
        k, child_alpha = descend(child_alpha)
        vertices = vertices @ PARENT_FROM_CHILD[k]
    np.testing.assert_allclose(np.einsum("nij,nj->ni", vertices, child_alpha), alpha, atol=1e-12)


def test_the_supplement_has_the_same_children_with_other_orders_of_corners():
    for ours, published in zip(PARENT_FROM_CHILD, np.linalg.inv(PUBLISHED), strict=True):
        assert {*map(tuple, ours.T)} == {*map(tuple, published.T.round(12))}


def test_descendants_fall_into_three_shapes_at_most():
    """Bey's theorem; shapes told apart by their sorted edge lengths over the longest."""
    corners = np.random.default_rng().normal(size=(4, 3))
    for level in (1, 2, 3, 4):
        tets = path_corners(level) @ corners  # [8^level, 4, 3]
        pairs = np.triu_indices(4, 1)
        lengths = np.linalg.norm(tets[:, pairs[0]] - tets[:, pairs[1]], axis=-1)
        lengths = np.sort(lengths / lengths.max(axis=1, keepdims=True), axis=1)
        assert len(np.unique(lengths.round(6), axis=0)) <= 3


@pytest.mark.parametrize("levels", [0, 1, 2, 3])
def test_paths_lead_to_the_corners_they_name(levels):
    alpha = random_alpha(500)
    path = child_path(alpha, levels)
    corners = path_corners(levels)[path] / 2**levels  # [N, corner, 4]
    local = np.linalg.solve(np.swapaxes(corners, 1, 2), alpha[..., None])[..., 0]
    assert local.min() > -1e-9  # each point lies in the descendant with its path
    nodes, ids = path_nodes(levels)
    np.testing.assert_array_equal(nodes[ids], path_corners(levels))
    size = 2**levels
    assert len(nodes) == (size + 1) * (size + 2) * (size + 3) // 6


@wp.kernel
def descend_kernel(
    alpha: wp.array(dtype=wp.vec4),
    child: wp.array(dtype=int),
    child_alpha: wp.array(dtype=wp.vec4),
):
    n = wp.tid()
    k = child_of(alpha[n])
    child[n] = k
    child_alpha[n] = into_child(k, alpha[n])


def test_kernel_functions_match_numpy(device):
    count = 4096
    alpha = random_alpha(count).astype(np.float32)
    child = wp.empty(count, dtype=int, device=device)
    child_alpha = wp.empty(count, dtype=wp.vec4, device=device)
    wp.launch(
        descend_kernel,
        dim=count,
        inputs=[wp.array(alpha, dtype=wp.vec4, device=device)],
        outputs=[child, child_alpha],
        device=device,
    )
    k, expected = descend(alpha)
    np.testing.assert_array_equal(child.numpy(), k)
    np.testing.assert_allclose(child_alpha.numpy(), expected, atol=1e-6)


@wp.kernel
def lattice_kernel(
    alpha: wp.array(dtype=wp.vec4),
    level: int,
    corners: wp.array2d(dtype=wp.vec3i),
    weights: wp.array(dtype=wp.vec4),
):
    n = wp.tid()
    cell, fraction = lattice_cell(lattice_point(alpha[n]), level)
    first, last = lattice_axes(fraction)
    x, y, z = wp.vec3i(1, 0, 0), wp.vec3i(0, 1, 0), wp.vec3i(0, 0, 1)
    corners[n, 0] = cell
    corners[n, 1] = cell + along(first, x, y, z)
    corners[n, 2] = cell + x + y + z - along(last, x, y, z)
    corners[n, 3] = cell + x + y + z
    weights[n] = lattice_weights(fraction)


def lattice_corners(alpha, level, device):
    """Corners as integer coordinates, [N, corner, 3], and the weights."""
    corners = wp.empty((len(alpha), 4), dtype=wp.vec3i, device=device)
    weights = wp.empty(len(alpha), dtype=wp.vec4, device=device)
    inputs = [wp.array(alpha, dtype=wp.vec4, device=device), level]
    outputs = [corners, weights]
    wp.launch(lattice_kernel, dim=len(alpha), inputs=inputs, outputs=outputs, device=device)
    return corners.numpy(), weights.numpy()


@pytest.mark.parametrize("level", [1, 4])
def test_the_lattice_knows_the_descendants_corners(level, device):
    """Descending level by level leads to the same corners with the same weights."""
    points = np.sort(np.random.default_rng().integers(0, 2**20 + 1, (4000, 3)))[:, ::-1]
    alpha = -np.diff(points, prepend=2**20, append=0) / 2**20  # exact in float32
    path, local = child_path(alpha, level), alpha
    for _ in range(level):
        _, local = descend(local)
    inside = local.min(axis=1) > 0  # on a face it may be either neighbour
    assert inside.mean() > 0.9
    expected = path_corners(level)[path][..., ::-1].cumsum(axis=-1)[..., 2::-1]  # [N, corner, 3]
    corners, weights = lattice_corners(alpha.astype(np.float32), level, device)
    for points_, weights_ in ((expected, local), (corners, weights)):
        order = points_.sum(axis=-1).argsort(axis=1)
        points_[:] = np.take_along_axis(points_, order[..., None], axis=1)
        weights_[:] = np.take_along_axis(weights_, order, axis=1)
    np.testing.assert_array_equal(corners[inside], expected[inside])
    np.testing.assert_array_equal(weights[inside], local[inside])


def test_lattice_corners_are_in_the_tet_even_for_points_that_are_not_quite(device):
    """Whatever rounding did to them; then every corner has an entry."""
    rng = np.random.default_rng()
    alpha = rng.integers(0, 3, (4000, 4)).astype(float)
    alpha /= np.maximum(alpha.sum(axis=1, keepdims=True), 1)
    alpha += rng.choice([-1e-6, 0.0, 1e-6], alpha.shape)
    for level in range(7):
        corners, weights = lattice_corners(alpha.astype(np.float32), level, device)
        assert corners.max() <= 2**level
        assert corners.min() >= 0
        assert (np.diff(corners, axis=-1) <= 0).all()
        assert weights.min() >= 0.0
