"""The grid around the object: contraction and encoding, forward and backward."""

import numpy as np
import warp as wp
from contracted_grid import contract, grid_encode_reference

from deformrf.core.field import (
    GRID_ENTRIES,
    GRID_LEVELS,
    RESOLUTIONS,
    grid_encode_backward_kernel,
    grid_encode_kernel,
)

BOX = np.array([[0.1, 0.2, 0.3], [0.9, 0.7, 0.6]])


def test_the_box_becomes_a_cube_and_all_space_fits_around_it():
    rng = np.random.default_rng()
    inside = rng.uniform(*BOX, (100, 3))
    expected = 2.0 * (inside - BOX[0]) / (BOX[1] - BOX[0]) - 1.0
    np.testing.assert_allclose(contract(inside, BOX), expected, atol=1e-12)
    far = contract(rng.normal(size=(1000, 3)) * 10.0 ** rng.uniform(-1, 6, (1000, 1)), BOX)
    assert np.abs(far).max() < 2.0
    assert np.abs(contract(np.array([[1e9, 0.0, 0.0]]), BOX)).max() > 1.999


def test_contraction_is_continuous_and_keeps_directions():
    rng = np.random.default_rng()
    center, half = BOX.mean(axis=0), 0.5 * (BOX[1] - BOX[0])
    y = rng.normal(size=(500, 3))
    border = y / np.abs(y).max(axis=1, keepdims=True)
    for scale in (1 - 1e-9, 1 + 1e-9):
        np.testing.assert_allclose(contract(center + scale * border * half, BOX), border, atol=1e-8)
    for scale in (2.0, 5.0):
        expected = (2.0 - 1.0 / scale) * border
        np.testing.assert_allclose(contract(center + scale * border * half, BOX), expected)


def random_points(rng, count=400):
    return rng.uniform(-2, 2, (count, 3)).astype(np.float32)


def test_the_kernel_matches_the_reference(device):
    rng = np.random.default_rng()
    points = random_points(rng)
    table = rng.normal(size=(GRID_LEVELS * GRID_ENTRIES, 4)).astype(np.float32)
    features = wp.empty((len(points), GRID_LEVELS), dtype=wp.vec4, device=device)
    wp.launch(
        grid_encode_kernel,
        dim=(len(points), GRID_LEVELS),
        inputs=[
            wp.array(points, dtype=wp.vec3, device=device),
            wp.array(RESOLUTIONS, dtype=int, device=device),
            wp.array(table, dtype=wp.vec4, device=device),
        ],
        outputs=[features],
        device=device,
    )
    expected = grid_encode_reference(points.astype(float), table.astype(float))
    # A cell of the finest level is 5e-3 wide, a rounding of a coordinate 2e-7.
    np.testing.assert_allclose(features.numpy().reshape(len(points), -1), expected, atol=2e-3)


def test_encoding_is_continuous_across_cells():
    rng = np.random.default_rng()
    points = random_points(rng).astype(float)
    resolution = RESOLUTIONS[2]
    points[:, 0] = -2.0 + 4.0 / resolution * rng.integers(1, resolution, len(points))
    table = rng.normal(size=(GRID_LEVELS * GRID_ENTRIES, 4))
    step = np.array([1e-9, 0, 0])
    before, after = (grid_encode_reference(points + s * step, table) for s in (-1, 1))
    np.testing.assert_allclose(before, after, atol=1e-4)


def test_the_backward_pass_is_the_transpose(device):
    """<g, encode(table)> = <transpose(g), table> for all g and tables."""
    rng = np.random.default_rng()
    points = random_points(rng, 100)
    table = rng.normal(size=(GRID_LEVELS * GRID_ENTRIES, 4))
    gradient = rng.normal(size=(len(points), GRID_LEVELS, 4)).astype(np.float32)
    table_grad = wp.zeros(len(table), dtype=wp.vec4, device=device)
    wp.launch(
        grid_encode_backward_kernel,
        dim=(len(points), GRID_LEVELS),
        inputs=[
            wp.array(points, dtype=wp.vec3, device=device),
            wp.array(RESOLUTIONS, dtype=int, device=device),
            wp.array(gradient, dtype=wp.vec4, device=device),
        ],
        outputs=[table_grad],
        device=device,
    )
    features = grid_encode_reference(points.astype(float), table)
    left = (features * gradient.reshape(len(points), -1)).sum()
    right = (table_grad.numpy() * table).sum()
    scale = np.sqrt((features**2).sum() * (gradient**2).sum())
    assert abs(left - right) < 1e-5 * scale
