"""Beams and balls from a lattice: their sections, their ends, and nothing dangling."""

import numpy as np
import pytest
from beams import ball, beam

from deformrf.core.deform import lumped_masses
from deformrf.core.geometry import (
    A15,
    BCC,
    KUHN,
    components,
    face_components,
    signed_volumes,
    tet_neighbours,
)

lattices = pytest.mark.parametrize("lattice", [A15, BCC, KUHN], ids=["a15", "bcc", "kuhn"])


@lattices
def test_a_beam_is_one_piece_in_its_box(lattice):
    body = beam(lattice, 1 / 32)
    mesh = body.mesh
    assert signed_volumes(mesh.rest_vertices, mesh.tets).min() > 0
    assert components(mesh.vertex_count, mesh.tets).max() == 0
    assert (face_components(tet_neighbours(mesh.tets)) == 0).all()
    assert (tet_neighbours(mesh.tets) >= 0).sum(axis=1).min() >= 2
    assert np.abs(mesh.rest_vertices[:, 1:]).max() <= 0.125 + 1e-9
    assert mesh.rest_vertices[:, 0].max() == pytest.approx(1.0)
    np.testing.assert_array_equal(body.clamped, mesh.rest_vertices[:, 0] <= 1e-9)
    assert body.clamped.any()


def test_the_section_of_a_beam_of_cubes_is_a_square():
    body = beam(KUHN, 1 / 16)
    assert body.area == pytest.approx(0.25**2)
    assert body.second_moment == pytest.approx(0.25**4 / 12)


@pytest.mark.parametrize("lattice", [A15, BCC], ids=["a15", "bcc"])
def test_a_finer_ragged_section_is_more_of_a_square(lattice):
    missing = [
        (1 - body.area / 0.25**2, 1 - body.second_moment / (0.25**4 / 12))
        for body in (beam(lattice, spacing) for spacing in (1 / 32, 1 / 64))
    ]
    assert (np.array(missing) > 0).all()
    np.testing.assert_allclose(np.divide(*missing), 2.0, atol=0.3)  # a layer at the surface


def test_the_sag_is_that_of_beam_theory():
    body = beam(KUHN, 1 / 32)
    modulus, density, ratio = 2e5, 900.0, 0.3
    masses = lumped_masses(body.mesh.rest_vertices, body.mesh.tets, density)
    load = density * 0.25**2 * 9.81
    bending = load / (8 * modulus * 0.25**4 / 12)
    assert body.bending_sag(masses, modulus) == pytest.approx(bending, rel=2e-3)
    shear_modulus = modulus / (2 * (1 + ratio))
    shear = load / (2 * 5 / 6 * shear_modulus * 0.25**2)
    assert body.shear_sag(masses, shear_modulus) == pytest.approx(shear, rel=2e-3)


def test_the_tip_is_where_the_end_is():
    body = beam(BCC, 1 / 32)
    random = np.random.default_rng()
    shift, slope = random.normal(size=(2, 3))
    moved = body.mesh.rest_vertices * [1, 0, 0] + shift + body.mesh.rest_vertices[:, :1] * slope
    np.testing.assert_allclose(body.tip(moved), shift + slope + [1, 0, 0], atol=1e-9)


@lattices
def test_a_ball_is_round(lattice):
    mesh = ball(lattice, 1 / 24, radius=0.5)
    volume = signed_volumes(mesh.rest_vertices, mesh.tets).sum()
    assert volume == pytest.approx(4 / 3 * np.pi * 0.5**3, rel=0.05)
    assert np.linalg.norm(mesh.rest_vertices, axis=1).max() < 0.5 + 2.5 / 24


def test_too_coarse_a_lattice_is_named():
    with pytest.raises(ValueError, match=r"spacing of 0\.125 leaves no tet"):
        beam(A15, 1 / 8)
