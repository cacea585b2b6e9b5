"""Shares of the bulk modulus: a partition of the volume, the same solid, and bending within 3 %."""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from beams import beam
from finite_elements import Solid, quadratic

from deformrf.core.definition.solver import volume_gradients
from deformrf.core.deform import Material, constraints
from deformrf.core.deform.locking import volume_shares
from deformrf.core.geometry import (
    A15,
    BCC,
    KUHN,
    a15_grid,
    extract,
    signed_volumes,
)
from deformrf.core.geometry.lattice import grid
from deformrf.wings.lab.dynamics.energy import material_energy
from deformrf.wings.lab.dynamics.references import factorize, free_dofs

SPACING = 0.05
MU, DENSITY = 2.0, 1000.0
GRAVITY = (0.0, 0.0, -0.1)  # m/s²; strains stay small


def shares_of(mesh):
    volumes = signed_volumes(mesh.rest_vertices, mesh.tets)
    return volume_shares(mesh.rest_vertices, mesh.tets, volumes), volumes


@pytest.mark.parametrize("kept", [1.0, 0.5, 0.1])
def test_shares_are_a_partition_of_the_volume(kept):
    mesh = a15_grid(0.08)
    mesh, _ = extract(mesh, np.random.default_rng().random(mesh.tet_count) < kept)
    shares, volumes = shares_of(mesh)
    assert (shares * volumes).sum() == pytest.approx(volumes.sum())
    assert 0.0 < (shares > 1).mean() < 0.2
    assert (shares[shares <= 1] % 1 == 0).all()


def in_one_cell(mesh, corners):
    """Which of the simplices have their middle in one cell of the lattice.  [N] bool"""
    low = mesh.rest_vertices.mean(axis=0) + 0.0123 * SPACING  # no middle lies on its boundary
    places = (mesh.rest_vertices[corners].mean(axis=1) - low) / (A15.cell_edge * SPACING)
    return ((places > -0.5) & (places < 0.5)).all(axis=1)


def test_within_the_lattice_eight_tets_of_a_cell_hold_it():
    mesh = a15_grid(SPACING)
    shares, _ = shares_of(mesh)
    values, counts = np.unique(
        np.round(shares[in_one_cell(mesh, mesh.tets)], 9), return_counts=True
    )
    assert values == pytest.approx([0.0, 16 / 3])
    assert counts.tolist() == [38, 8]


@pytest.mark.parametrize("lattice", [BCC, KUHN], ids=["bcc", "kuhn"])
def test_other_lattices_share_nothing(lattice):
    np.testing.assert_array_equal(shares_of(grid(lattice, 0.15))[0], 1.0)


def test_moved_and_scaled_meshes_are_recognized_and_turned_ones_share_nothing():
    mesh, random = a15_grid(0.1), np.random.default_rng()
    shares, volumes = shares_of(mesh)
    moved = random.uniform(0.1, 10.0) * mesh.rest_vertices + random.normal(size=3)
    moved = moved.astype(np.float32).astype(np.float64)
    np.testing.assert_array_equal(volume_shares(moved, mesh.tets, volumes), shares)
    turned = mesh.rest_vertices @ np.linalg.qr(random.normal(size=(3, 3)))[0]
    np.testing.assert_array_equal(volume_shares(turned, mesh.tets, volumes), 1.0)


def test_the_tets_that_hold_have_the_whole_modulus_or_what_the_others_leave():
    mesh = a15_grid(0.1)
    volumes = constraints.volume_constraints(mesh.rest_vertices, mesh.tets)
    bulk = 5.0 * MU
    alone = volumes.compliances(bulk)
    np.testing.assert_array_equal(np.isinf(alone), volumes.shares == 0.0)
    for of_each in (0.0, 2.0 * MU, bulk, 2.0 * bulk):
        moduli = 6.0 * volumes.rest_values / volumes.compliances(bulk, of_each)
        assert moduli.min() == pytest.approx(min(of_each, bulk))
        held = (moduli * volumes.rest_values).sum()
        assert held == pytest.approx(bulk * volumes.rest_values.sum())


def test_the_infinite_lattice_stays_the_same_solid():
    """Under each strain its vertices are in balance, and a cell stores what λ and μ say."""
    bulk = 20.0 * MU
    mesh = a15_grid(SPACING)
    rest = mesh.rest_vertices
    edges = constraints.edge_constraints(rest, mesh.tets)
    tets = constraints.volume_constraints(rest, mesh.tets)
    of_edges, of_tets = 1.0 / edges.compliances(MU), 1.0 / tets.compliances(bulk)
    along = rest[edges.vertices[:, 0]] - rest[edges.vertices[:, 1]]
    along /= edges.rest_values[:, None]
    gradients = volume_gradients(rest, tets.vertices)
    within = (np.abs(rest - 0.5) < 0.12).all(axis=1)
    assert within.any()
    cell_edges, cell_tets = (in_one_cell(mesh, part.vertices) for part in (edges, tets))
    for i, j in combinations_with_replacement(range(3), 2):
        strain = np.zeros((3, 3))
        strain[i, j] = strain[j, i] = 1.0
        u = rest @ strain
        stretch = ((u[edges.vertices[:, 0]] - u[edges.vertices[:, 1]]) * along).sum(axis=1)
        growth = (gradients * u[tets.vertices]).sum(axis=(1, 2))
        forces = np.zeros_like(u)
        pulls = (of_edges * stretch)[:, None] * along
        np.add.at(forces, edges.vertices[:, 0], pulls)
        np.add.at(forces, edges.vertices[:, 1], -pulls)
        np.add.at(forces, tets.vertices, (of_tets * growth)[:, None, None] * gradients)
        np.testing.assert_allclose(forces[within], 0.0, atol=1e-9 * np.abs(forces).max())
        stored = 0.5 * (of_edges * stretch**2)[cell_edges].sum()
        stored += 0.5 * (of_tets * growth**2)[cell_tets].sum()
        density = 0.5 * (MU + bulk) * np.trace(strain) ** 2 + MU * (strain**2).sum()
        assert stored == pytest.approx(density * (A15.cell_edge * SPACING) ** 3)


def lame_constants(modulus, ratio):
    """λ and μ [Pa]."""
    mu = modulus / (2 * (1 + ratio))
    return modulus * ratio / ((1 + ratio) * (1 - 2 * ratio)), mu


def test_finite_elements_sag_and_swing_as_timoshenko_says():
    """The reference of the test below."""
    side, modulus, ratio = 1 / 16, 2e5, 0.3
    lame, mu = lame_constants(modulus, ratio)
    body = beam(KUHN, side, width=side, length=1.0)
    solid = Solid(
        quadratic(body.mesh.rest_vertices, body.mesh.tets, body.clamped), lame, mu, DENSITY
    )
    u = solid.sag(GRAVITY)
    load = DENSITY * 0.1 * side**2
    bending, shear = load / (8 * modulus * side**4 / 12), load / (2 * 5 / 6 * mu * side**2)
    # The clamp keeps the section from becoming narrower, which stiffens about one width of it.
    assert -body.tip(u[: body.mesh.vertex_count])[2] == pytest.approx(bending + shear, rel=0.02)
    slender = 1.8751041**2 / (2 * np.pi) * np.sqrt(modulus * side**2 / 12 / DENSITY)
    assert solid.lowest_mode(u)[0] == pytest.approx(slender, rel=0.02)


def sag_and_frequency(body, energy):
    """Of the tip [m], and of the lowest mode [Hz], for small strains of edges and volumes."""
    rest = body.mesh.rest_vertices
    dofs = free_dofs(body.clamped)
    stiffness = energy.hessian(rest)[dofs][:, dofs]
    factors, masses = factorize(stiffness), np.repeat(energy.masses, 3)
    u = np.zeros(rest.size)
    u[dofs] = factors.solve((masses * np.tile(GRAVITY, len(rest)))[dofs])
    mode = u[dofs]
    for _ in range(4):
        mode = factors.solve(masses[dofs] * mode)
        mode /= np.sqrt(mode @ (masses[dofs] * mode))
    frequency = np.sqrt(mode @ (stiffness @ mode)) / (2.0 * np.pi)
    return -body.tip(u.reshape(-1, 3))[2], frequency


@pytest.mark.parametrize("ratio", [0.35, 0.45, 0.49])
def test_a_cantilever_bends_like_finite_elements(ratio):
    body = beam(A15, 1 / 48)  # 4,852 tets
    modulus = 2e5
    lame, mu = lame_constants(modulus, ratio)
    mesh = quadratic(body.mesh.rest_vertices, body.mesh.tets, body.clamped)
    solid = Solid(mesh, lame, mu, DENSITY)
    sag = solid.sag(GRAVITY)
    rest = body.mesh.rest_vertices
    energy = material_energy(rest, body.mesh.tets, Material(modulus, ratio, DENSITY))
    ours = sag_and_frequency(body, energy)
    assert ours[0] == pytest.approx(-body.tip(sag[: len(rest)])[2], rel=0.03)
    assert ours[1] == pytest.approx(solid.lowest_mode(sag)[0], rel=0.015)


@pytest.mark.parametrize("ratio", [0.45, 0.49])
def test_a_squeezed_column_keeps_its_volume(ratio):
    """As finite elements do: without friction it would lose 1 − 2 ν of the strain."""
    body = beam(A15, 1 / 32)
    rest, tets = body.mesh.rest_vertices, body.mesh.tets
    held = body.clamped | (rest[:, 0] > body.length - 1 / 32 - 1e-9)
    squeezed = np.maximum(rest[:, :1], 0.0) * [-1.0, 0.0, 0.0]
    energy = material_energy(rest, tets, Material(2e5, ratio, DENSITY))
    stiffness = energy.hessian(rest)
    u, dofs = np.where(held[:, None], squeezed, 0.0).ravel(), free_dofs(held)
    u[dofs] = factorize(stiffness[dofs][:, dofs]).solve(-(stiffness @ u)[dofs])
    between = ~held[tets].all(axis=1)
    growth = (volume_gradients(rest, tets) * u.reshape(-1, 3)[tets]).sum(axis=(1, 2))
    lost = -growth[between].sum() / 6 / signed_volumes(rest, tets[between]).sum()
    assert lost == pytest.approx(1.0 - 2.0 * ratio, abs=0.04)
