"""Strain and volume ratio: closed forms, and singular values."""

import numpy as np
import pytest

from deformrf.core.deform import at_vertices, deformation_gradients, rest_tets, strains
from deformrf.core.deform import volume_ratios as ratios
from deformrf.core.geometry import a15_grid


@pytest.fixture
def mesh():
    return a15_grid(0.25)


def of(mesh, matrix, shift=(0.0, 0.0, 0.0)):
    """Strain and volume ratio of every tet after x -> matrix x + shift.  [T], [T]"""
    vertices = mesh.rest_vertices @ np.transpose(matrix) + shift
    gradients = deformation_gradients(vertices, rest_tets(mesh.rest_vertices, mesh.tets))
    np.testing.assert_allclose(gradients - matrix, 0.0, atol=1e-12)
    return strains(gradients), ratios(gradients)


def rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def test_a_rigid_motion_is_no_strain(mesh):
    strain, ratio = of(mesh, rotation(np.random.default_rng()), (3.0, -2.0, 1.0))
    assert strain == pytest.approx(0.0, abs=1e-7)  # √ of roundings
    assert ratio == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.0, 1.3])
def test_uniform_scaling_is_the_same_strain_everywhere(mesh, factor):
    strain, ratio = of(mesh, factor * np.eye(3))
    assert strain == pytest.approx(abs(factor - 1.0), abs=1e-7)
    assert ratio == pytest.approx(factor**3)


def test_a_stretch_along_one_axis_counts_wherever_it_points(mesh):
    rng = np.random.default_rng()
    turn, other = rotation(rng), rotation(rng)
    strain, ratio = of(mesh, other @ turn @ np.diag([1.4, 1.0, 0.9]) @ turn.T)
    assert strain == pytest.approx(0.4)
    assert ratio == pytest.approx(1.4 * 0.9)


@pytest.mark.parametrize("shear", [0.1, 1.0])
def test_shear_keeps_the_volume(mesh, shear):
    """x + γ y: the principal stretches are √(1 + γ²/4) ± γ/2, and 1."""
    strain, ratio = of(mesh, np.array([[1.0, shear, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    assert strain == pytest.approx(np.sqrt(1.0 + shear**2 / 4.0) + shear / 2.0 - 1.0)
    assert ratio == pytest.approx(1.0)


def test_a_mirrored_tet_is_strained_and_has_negative_volume(mesh):
    strain, ratio = of(mesh, np.diag([1.0, 1.0, -1.0]))
    assert strain == pytest.approx(2.0)
    assert ratio == pytest.approx(-1.0)


def test_strains_are_those_of_singular_values():
    gradients = np.eye(3) + 0.3 * np.random.default_rng().normal(size=(500, 3, 3))
    values = np.linalg.svd(gradients, compute_uv=False)
    values[np.linalg.det(gradients) < 0.0, 2] *= -1.0
    assert strains(gradients) == pytest.approx(abs(values - 1.0).max(axis=1), abs=1e-7)


def test_values_at_vertices_are_means_by_volume(mesh):
    rest = rest_tets(mesh.rest_vertices, mesh.tets)
    values = np.random.default_rng().normal(size=mesh.tet_count)
    means = at_vertices(values, rest, mesh.vertex_count + 1)
    around = (mesh.tets == 7).any(axis=1)
    assert means[7] == pytest.approx(np.average(values[around], weights=rest.volumes[around]))
    assert means[-1] == 0.0
    assert at_vertices(np.ones(mesh.tet_count), rest, mesh.vertex_count) == pytest.approx(1.0)
