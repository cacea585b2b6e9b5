"""Constraints: energies of a solid, momentum, limits.  Kernels are in test_frame.py."""

import numpy as np
import pytest

from deformrf.core.definition import solver
from deformrf.core.deform import constraints
from deformrf.core.geometry import a15_grid, signed_volumes

UNIT_TET = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
MESH = a15_grid(0.1)  # no hinges, so no braces


def random_edges(count):
    """Edges that share no vertex, some pinned at one end or both, the first of no length.

    The others are 0.1 or longer: float32 has no exact direction for a much shorter one.
    """
    random = np.random.default_rng()
    first = random.uniform(size=(count, 3))
    along = random.normal(size=(count, 3))
    along *= random.uniform(0.1, 1.0, (count, 1)) / np.linalg.norm(along, axis=1, keepdims=True)
    along[0] = 0.0
    w = random.uniform(0.1, 2.0, 2 * count) * (random.uniform(size=2 * count) > 0.2)
    w[[0, count]] = 1.0
    ends = np.arange(2 * count).reshape(2, -1).T
    rest_lengths, regularization = random.uniform(0.1, 1, count), random.uniform(0, 1, count)
    return np.concatenate([first, first + along]), w, ends, rest_lengths, regularization


def random_tets(count):
    """Tets that share no vertex, far from their rest volumes; half of them inverted."""
    random = np.random.default_rng()
    vertices = random.uniform(size=(4 * count, 3))
    w = random.uniform(0.1, 2.0, 4 * count) * (random.uniform(size=4 * count) > 0.2)
    tets = random.permutation(4 * count).reshape(-1, 4)
    rest = random.uniform(0.01, 0.5, count)
    return vertices, w, tets, rest, random.uniform(1e-3, 1e-2, count)


def of_one_color(vertices, rest_values, regularization):
    return solver.Constraints(vertices, rest_values, regularization, np.array([0, len(vertices)]))


def test_volumes_and_masses_add_up():
    total = np.abs(signed_volumes(MESH.rest_vertices, MESH.tets)).sum()
    edges = constraints.edge_constraints(MESH.rest_vertices, MESH.tets)
    tets = constraints.volume_constraints(MESH.rest_vertices, MESH.tets)
    masses = constraints.lumped_masses(MESH.rest_vertices, MESH.tets, 800.0)
    assert edges.volumes.sum() == pytest.approx(total)
    assert tets.rest_values.sum() / 6 == pytest.approx(total)
    assert masses.sum() == pytest.approx(800.0 * total)


def test_a_dilation_stores_the_energy_of_a_solid():
    """Edges are a solid of λ = μ, volumes add K to its bulk modulus.

    Volumes do on any mesh, edges but for the factors' mean, which a boundary changes a little.
    """
    mu, bulk, strain = 3.0, 5.0, 1e-4
    total = np.abs(signed_volumes(MESH.rest_vertices, MESH.tets)).sum()
    edges = constraints.edge_constraints(MESH.rest_vertices, MESH.tets)
    stretch = strain * edges.rest_values
    energy = (0.5 * stretch**2 / edges.compliances(mu)).sum()
    mean_factor = (edges.factors * edges.volumes).sum() / edges.volumes.sum()
    assert mean_factor == pytest.approx(1.0, abs=0.03)
    assert energy == pytest.approx(0.5 * (5 / 3 * mu) * (3 * strain) ** 2 * total * mean_factor)
    tets = constraints.volume_constraints(MESH.rest_vertices, MESH.tets)
    growth = 3 * strain * tets.rest_values
    energy = (0.5 * growth**2 / tets.compliances(bulk)).sum()
    assert energy == pytest.approx(0.5 * bulk * (3 * strain) ** 2 * total)


def test_inverted_tets_are_reoriented_and_flat_ones_left_out():
    vertices = np.concatenate([UNIT_TET, [[1, 1, 0.0]]])
    tets = np.array([[0, 2, 1, 3], [0, 1, 4, 2]])  # inverted; flat
    volumes = constraints.volume_constraints(vertices, tets)
    assert volumes.vertices.tolist() == [[0, 2, 3, 1]]
    assert volumes.rest_values.tolist() == [1.0]
    edges = constraints.edge_constraints(vertices, tets)
    assert np.isfinite(edges.compliances(1.0)).all()


def test_volume_gradients_are_differences_of_volume():
    vertices = np.random.default_rng().uniform(size=(4, 3))
    tet = np.array([[0, 1, 2, 3]])
    gradients = solver.volume_gradients(vertices, tet)[0]
    for corner in range(4):
        for axis in range(3):
            step = np.zeros((4, 3))
            step[corner, axis] = 0.5
            change = signed_volumes(vertices + step, tet) - signed_volumes(vertices - step, tet)
            assert gradients[corner, axis] == pytest.approx(6 * change[0], abs=1e-12)


def test_fallback_directions_are_uniform_unit_vectors():
    directions = solver.fixed_directions(np.arange(20_000))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    np.testing.assert_allclose(directions.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(directions.T @ directions / 20_000, np.eye(3) / 3, atol=0.02)


def test_projections_keep_momentum():
    vertices, w, ends, lengths, regularization = random_edges(100)
    moved = solver.project_edges(vertices, w, of_one_color(ends, lengths, regularization))
    others = np.setdiff1d(np.arange(len(w)), ends[(w[ends] > 0).all(axis=1)])
    check_momentum(vertices, moved, w, others)

    vertices, w, tets, volumes, regularization = random_tets(100)
    moved = solver.project_volumes(vertices, w, of_one_color(tets, volumes, regularization))
    others = np.setdiff1d(np.arange(len(w)), tets[(w[tets] > 0).all(axis=1)])
    check_momentum(vertices, moved, w, others)


def check_momentum(vertices, moved, w, others):
    """No net impulse and no net torque, but for constraints with a pinned vertex."""
    mass = np.where(w > 0, 1 / np.where(w > 0, w, 1.0), 0.0)[:, None]
    mass[others] = 0.0
    impulse = mass * (moved - vertices)
    assert np.abs(impulse).max() > 1e-3
    np.testing.assert_allclose(impulse.sum(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.cross(vertices, impulse).sum(axis=0), 0.0, atol=1e-9)


def test_without_compliance_one_projection_restores_an_edge():
    vertices, w, ends, lengths, _ = random_edges(50)
    free = (w[ends] > 0).any(axis=1)
    moved = solver.project_edges(vertices, w, of_one_color(ends, lengths, 0.0 * lengths))
    length = np.linalg.norm(moved[ends[:, 0]] - moved[ends[:, 1]], axis=1)
    np.testing.assert_allclose(length[free], lengths[free])


def test_a_volume_projection_moves_no_vertex_too_far():
    vertices, w, tets, volumes, regularization = random_tets(200)
    moved = solver.project_volumes(vertices, w, of_one_color(tets, volumes, regularization))
    longest = np.linalg.norm((moved - vertices)[tets], axis=-1).max(axis=1)
    limit = solver.STEP_LIMIT * np.cbrt(volumes)
    assert (longest <= limit * (1 + 1e-9)).all()
    assert (longest >= limit * (1 - 1e-9)).any()


def test_regularization_has_a_floor():
    edges = constraints.edge_constraints(UNIT_TET, np.array([[0, 1, 2, 3]]))
    w = np.array([1.0, 2.0, 3.0, 0.0])
    w_of_edge = w[edges.vertices].sum(axis=1)
    compliances = edges.compliances(1.0)
    floor = 0.05
    np.testing.assert_allclose(edges.regularization(0.0, w, 1e-3, floor), floor * w_of_edge)
    np.testing.assert_allclose(
        edges.regularization(compliances, w, 1e-3, floor),
        compliances * 1e6 - 0.5 * w_of_edge - 0.07 * w_of_edge**2 / (compliances * 1e6),
    )
    below = 0.66  # r at the floor: 0.05 = r − 0.5 − 0.07 / r
    for share, expected in ((below - 0.01, 0.05), (below + 0.04, 0.1), (2.0, 1.465)):
        a = edges.regularization(share * w_of_edge * 1e-6, w, 1e-3, floor)
        np.testing.assert_allclose(a, expected * w_of_edge)
    tets = constraints.volume_constraints(UNIT_TET, np.array([[0, 1, 2, 3]]))
    np.testing.assert_allclose(tets.regularization(0.0, w, 1e-3, floor), floor * (3 * 1 + 2 + 3))


def test_stiffness_factors_divide_compliances_by_their_mean_at_the_vertices():
    edges = constraints.edge_constraints(MESH.rest_vertices, MESH.tets)
    volumes = constraints.volume_constraints(MESH.rest_vertices, MESH.tets)
    random = np.random.default_rng()
    for part in (edges, volumes):
        alphas = random.uniform(1, 2, len(part.vertices))
        np.testing.assert_allclose(
            part.softened(alphas, np.full(MESH.vertex_count, 4.0)), alphas / 4
        )
        factors = random.uniform(0.5, 2.0, MESH.vertex_count)
        k = int(random.integers(len(part.vertices)))
        mean = np.mean([factors[i] for i in part.vertices[k]])
        assert part.softened(alphas, factors)[k] == pytest.approx(alphas[k] / mean)
