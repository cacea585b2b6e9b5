"""Subdivision: the eight children tile their parent, and the kernels agree with NumPy."""

import numpy as np
import pytest
import warp as wp

from deformrf.core.geometry.subdivision import (
    CHILD_FROM_PARENT,
    CHILD_VERTICES,
    PARENT_FROM_CHILD,
    child_corners,
    child_of,
    child_path,
    descend,
    into_child,
    path_corners,
    path_nodes,
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
    corners: wp.array2d(dtype=wp.vec3i),
    child: wp.array(dtype=int),
    child_alpha: wp.array(dtype=wp.vec4),
    new_corners: wp.array2d(dtype=wp.vec3i),
):
    n = wp.tid()
    k = child_of(alpha[n])
    child[n] = k
    child_alpha[n] = into_child(k, alpha[n])
    a, b, c, d = child_corners(k, corners[n, 0], corners[n, 1], corners[n, 2], corners[n, 3])
    new_corners[n, 0] = a
    new_corners[n, 1] = b
    new_corners[n, 2] = c
    new_corners[n, 3] = d


def test_kernel_functions_match_numpy(device):
    count = 4096
    alpha = random_alpha(count).astype(np.float32)
    corners = np.random.default_rng().integers(0, 2**20, (count, 4, 3)).astype(np.int32)
    child = wp.empty(count, dtype=int, device=device)
    child_alpha = wp.empty(count, dtype=wp.vec4, device=device)
    new_corners = wp.empty((count, 4), dtype=wp.vec3i, device=device)
    wp.launch(
        descend_kernel,
        dim=count,
        inputs=[
            wp.array(alpha, dtype=wp.vec4, device=device),
            wp.array(corners, dtype=wp.vec3i, device=device),
        ],
        outputs=[child, child_alpha, new_corners],
        device=device,
    )
    k, expected = descend(alpha)
    np.testing.assert_array_equal(child.numpy(), k)
    np.testing.assert_allclose(child_alpha.numpy(), expected, atol=1e-6)
    rows = np.arange(count)[:, None]
    a, b = CHILD_VERTICES[k, :, 0], CHILD_VERTICES[k, :, 1]
    np.testing.assert_array_equal(new_corners.numpy(), corners[rows, a] + corners[rows, b])
