"""Skinning: what it keeps, and kernels against the reference."""

import numpy as np
import pytest

from deformrf.wings.rig import METHODS, Skinner, rotations, skinned


def rigid(rng, count):
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = rotations.matrix_of(rotations.unit(rng.normal(size=(count, 4))))
    matrices[:, :3, 3] = rng.normal(size=(count, 3))
    return matrices


def random_weights(rng, vertex_count, bone_count):
    weights = rng.uniform(size=(vertex_count, bone_count)) * (
        rng.uniform(size=(vertex_count, bone_count)) < 0.5
    )
    weights[:, 0] += 0.1
    return (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)


def random_offsets(rng, weights):
    """0 where weights are; sums over bones are 0."""
    offsets = np.where(weights[:, :, None] > 0.0, rng.normal(size=(*weights.shape, 3)), 0.0)
    return offsets - weights[:, :, None] * offsets.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("with_offsets", [False, True])
def test_the_same_motion_of_all_bones_moves_rigidly(method, with_offsets):
    rng = np.random.default_rng()
    x, motion = rng.normal(size=(40, 3)), rigid(rng, 1)
    weights = random_weights(rng, 40, 6)
    offsets = random_offsets(rng, weights) if with_offsets else None
    moved = skinned(x, weights, np.tile(motion, (6, 1, 1)), method, offsets)
    np.testing.assert_allclose(moved, x @ motion[0, :3, :3].T + motion[0, :3, 3], atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_vertex_of_one_bone_follows_its_matrix(method):
    """Stretches and mirrors included."""
    rng = np.random.default_rng()
    matrices = rigid(rng, 3)
    matrices[:, :3, :3] = rng.normal(size=(3, 3, 3))
    x, bone = rng.normal(size=(30, 3)), rng.integers(0, 3, 30)
    wanted = np.einsum("vij,vj->vi", matrices[bone, :3, :3], x) + matrices[bone, :3, 3]
    np.testing.assert_allclose(skinned(x, np.eye(3)[bone], matrices, method), wanted, atol=1e-9)


def test_with_offsets_the_inside_of_a_triangle_follows_chords():
    """However large the triangle and however far the bones turn."""
    rng = np.random.default_rng()
    corners, shares = rng.normal(size=(3, 3)), rng.dirichlet(np.ones(3), 20)
    matrices, weights = rigid(rng, 4), random_weights(rng, 3, 4)
    inside, blended = shares @ corners, shares @ weights
    offsets = np.einsum("kc,cb,ci->kbi", shares, weights, corners)
    offsets -= blended[:, :, None] * inside[:, None]
    np.testing.assert_allclose(offsets.sum(axis=1), 0.0, atol=1e-6)
    chords = shares @ skinned(corners, weights, matrices)
    moved = skinned(inside, blended, matrices, offsets=offsets)
    np.testing.assert_allclose(moved, chords, atol=1e-6)
    assert np.abs(skinned(inside, blended, matrices) - chords).max() > 0.1


def test_offsets_add_the_same_to_both_methods():
    rng = np.random.default_rng()
    x, weights, matrices = rng.normal(size=(30, 3)), random_weights(rng, 30, 5), rigid(rng, 5)
    offsets = random_offsets(rng, weights)
    added = np.einsum("bij,vbj->vi", matrices[:, :3, :3], offsets)
    for method in METHODS:
        moved = skinned(x, weights, matrices, method, offsets)
        plain = skinned(x, weights, matrices, method)
        np.testing.assert_allclose(moved - plain, added, atol=1e-9)


def test_dual_quaternions_keep_the_distance_to_the_axis():
    """Halfway between rest and half a turn about z, a linear blend falls into the axis."""
    turn = np.eye(4)
    turn[:3, :3] = rotations.matrix_of(rotations.of_vector([0.0, 0.0, 3.0]))
    matrices, weights = np.array([np.eye(4), turn]), np.array([[0.5, 0.5]])
    lengths = [np.linalg.norm(skinned([[1.0, 0.0, 0.0]], weights, matrices, m)) for m in METHODS]
    assert lengths[0] == pytest.approx(np.cos(1.5)) and lengths[1] == pytest.approx(1.0)


def test_the_sign_of_a_quaternion_means_nothing():
    """Turns of 179° to both sides are 2° apart; a blend lies between them."""
    matrices = np.tile(np.eye(4), (2, 1, 1))
    angles = np.radians([179.0, -179.0])
    for matrix, angle in zip(matrices, angles, strict=True):
        matrix[:3, :3] = rotations.matrix_of(rotations.of_vector([0.0, 0.0, angle]))
    moved = skinned([[1.0, 0.0, 0.0]], np.array([[0.5, 0.5]]), matrices, "dual quaternion")
    np.testing.assert_allclose(moved, [[-1.0, 0.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("with_offsets", [False, True])
def test_kernels_equal_the_reference(method, with_offsets, device):
    rng = np.random.default_rng()
    x, weights = rng.uniform(size=(500, 3)), random_weights(rng, 500, 9)
    offsets = random_offsets(rng, weights) if with_offsets else None
    skinner = Skinner(x, weights, device, offsets)
    for scale in (0.0, 0.3):
        matrices = rigid(rng, 9)
        matrices[:, :3, :3] *= 1.0 + scale * rng.uniform(-1.0, 1.0, (9, 1, 3))
        vertices = skinner.pose(matrices, method)
        np.testing.assert_allclose(
            vertices.numpy(), skinned(x, weights, matrices, method, offsets), atol=2e-5
        )


def test_other_methods_are_refused():
    with pytest.raises(ValueError, match="can be linear or dual quaternion"):
        skinned(np.zeros((1, 3)), np.ones((1, 1)), np.eye(4)[None], "spline")
