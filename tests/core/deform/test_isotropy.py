"""Edge factors: the infinite lattice is isotropic, and a mesh's lattice is recognized."""

from itertools import combinations_with_replacement

import numpy as np
import pytest

from deformrf.core.deform import edge_constraints
from deformrf.core.deform.isotropy import FACTORS, edge_factors
from deformrf.core.geometry import (
    A15,
    BCC,
    EDGES,
    KUHN,
    TetMesh,
    cell_tets,
    extract,
    signed_volumes,
)
from deformrf.core.geometry import edges as mesh_edges
from deformrf.core.geometry.lattice import grid

STRAINS = list(combinations_with_replacement(range(3), 2))  # xx xy xz yy yz zz


def cell_edges(lattice):
    """The edges of one cell of the infinite lattice, each once.

    Returns:
        Ids of the cell's vertices at their ends [P, 2], vectors from one end to the other
        [P, 3], V_e [P], and indices into squared_lengths [P].
    """
    corners = cell_tets(lattice)
    shares = signed_volumes(corners.reshape(-1, 3), np.arange(corners[..., 0].size).reshape(-1, 4))
    vertex_ids = {place: i for i, place in enumerate(lattice.cell_vertices)}
    volumes = {}
    for tet, share in zip(corners, shares / 6.0, strict=True):
        for ends in tet[EDGES].tolist():
            low, high = (np.array(end) for end in sorted(ends))
            first, second = (vertex_ids[tuple(end % lattice.cell_edge)] for end in (low, high))
            key = (first, second, *(high - low).tolist())
            volumes[key] = volumes.get(key, 0.0) + share
    table = np.array(list(volumes))
    squared = (table[:, 2:] ** 2).sum(axis=1)
    classes = np.searchsorted(lattice.squared_lengths, squared)
    return table[:, :2], table[:, 2:].astype(float), np.array(list(volumes.values())), classes


def homogenized(lattice, factors):
    """Energy density ½ εᵀ C ε of the infinite lattice at μ = 1, its vertices in balance.  [6, 6]

    A strain's unit is ε_ij = ε_ji = 1.  For each, the cell's vertices move to where the
    energy is least.
    """
    ends, steps, volumes, classes = cell_edges(lattice)
    lengths = np.linalg.norm(steps, axis=1)
    n = steps / lengths[:, None]
    root = np.sqrt(15.0 * factors[classes] * volumes) / lengths  # √k_e
    stretches = np.zeros((len(STRAINS), len(steps)))
    for row, (i, j) in zip(stretches, STRAINS, strict=True):
        strain = np.zeros((3, 3))
        strain[i, j] = strain[j, i] = 1.0
        row += np.einsum("pi,ij,pj->p", n, strain, steps)
    moves = np.zeros((len(steps), len(lattice.cell_vertices), 3))
    np.add.at(moves, (np.arange(len(steps)), ends[:, 1]), n)
    np.add.at(moves, (np.arange(len(steps)), ends[:, 0]), -n)
    moves = root[:, None] * moves.reshape(len(steps), -1)
    loads = root[:, None] * stretches.T
    relaxed = loads - moves @ np.linalg.lstsq(moves, loads, rcond=None)[0]
    return relaxed.T @ relaxed / lattice.cell_edge**3


def solid(lam, mu):
    """The same of an isotropic solid."""
    tensors = []
    for i, j in STRAINS:
        strain = np.zeros((3, 3))
        strain[i, j] = strain[j, i] = 1.0
        tensors.append(strain)
    tensors = np.array(tensors)
    traces = np.trace(tensors, axis1=1, axis2=2)
    return lam * np.outer(traces, traces) + 2 * mu * np.einsum("aij,bij->ab", tensors, tensors)


def zener(stiffness):
    """2 C44 / (C11 − C12)."""
    xx, xy, yy = (STRAINS.index(ij) for ij in ((0, 0), (0, 1), (1, 1)))
    return stiffness[xy, xy] / 2 / (stiffness[xx, xx] - stiffness[xx, yy])


@pytest.mark.parametrize(
    ("lattice", "ratio"), [(A15, 0.777), (BCC, 4 / 3), (KUHN, 0.476)], ids=["a15", "bcc", "kuhn"]
)
def test_without_factors_a_lattice_is_anisotropic(lattice, ratio):
    plain = homogenized(lattice, np.ones(len(lattice.squared_lengths)))
    assert zener(plain) == pytest.approx(ratio, abs=5e-4)


@pytest.mark.parametrize("lattice", [A15, BCC], ids=["a15", "bcc"])
def test_with_factors_it_is_an_isotropic_solid(lattice):
    stiffness = homogenized(lattice, np.array(FACTORS[lattice]))
    np.testing.assert_allclose(stiffness, solid(1.0, 1.0), atol=1e-9)


@pytest.mark.parametrize("lattice", [A15, BCC], ids=["a15", "bcc"])
def test_with_factors_no_strain_moves_a_vertex_from_its_place(lattice):
    ends, steps, volumes, classes = cell_edges(lattice)
    n = steps / np.linalg.norm(steps, axis=1)[:, None]
    stiffness = 15.0 * np.array(FACTORS[lattice])[classes] * volumes / (steps**2).sum(axis=1)
    forces = np.einsum("p,pi,pj,pk->pijk", stiffness, steps, n, n)
    sums = np.zeros((len(lattice.cell_vertices), 3, 3, 3))
    np.add.at(sums, ends[:, 0], forces)
    np.add.at(sums, ends[:, 1], -forces)
    np.testing.assert_allclose(sums, 0.0, atol=1e-12 * np.abs(forces).max())


def test_kuhns_lattice_has_no_factors():
    """Its one body diagonal couples stretch to shear, whatever the positive factors."""
    np.testing.assert_array_equal(FACTORS[KUHN], 1.0)
    xx, xy = STRAINS.index((0, 0)), STRAINS.index((0, 1))
    for _ in range(20):
        factors = np.random.default_rng().uniform(0.01, 3.0, 3)
        assert homogenized(KUHN, factors)[xx, xy] > 0


@pytest.mark.parametrize("lattice", [A15, BCC, KUHN])
def test_a_trimmed_turned_and_braced_mesh_is_recognized(lattice):
    random = np.random.default_rng()
    mesh = grid(lattice, random.uniform(0.06, 0.12))
    part, _ = extract(mesh, random.random(mesh.tet_count) < 0.6)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0] * random.uniform(0.1, 10.0)
    vertices = (part.rest_vertices @ turn + 0.3).astype(np.float32).astype(np.float64)
    edges = edge_constraints(vertices, part.tets)
    squared = (np.diff(part.addresses[edges.vertices], axis=1)[:, 0] ** 2).sum(axis=1)
    table = dict(zip(lattice.squared_lengths, FACTORS[lattice], strict=True))
    of_tets = {tuple(pair) for pair in mesh_edges(part.tets).tolist()}
    expected = [
        table[length] if tuple(sorted(pair)) in of_tets else 1.0
        for length, pair in zip(squared.tolist(), edges.vertices.tolist(), strict=True)
    ]
    assert len(edges.vertices) > len(of_tets)
    np.testing.assert_array_equal(edges.factors, expected)


def test_edges_of_no_lattice_have_no_factors():
    random = np.random.default_rng()
    np.testing.assert_array_equal(edge_factors(random.uniform(0.5, 2.0, 500)), 1.0)
    np.testing.assert_array_equal(edge_factors(np.ones(6)), 1.0)  # a regular tet
    np.testing.assert_array_equal(edge_factors(np.zeros(3)), 1.0)
    assert len(edge_factors(np.empty(0))) == 0


def test_an_irregular_tet_gets_no_factors():
    tet = TetMesh(
        np.random.default_rng().normal(size=(4, 3)), np.zeros((4, 3), int), np.arange(4)[None]
    )
    np.testing.assert_array_equal(edge_constraints(tet.rest_vertices, tet.tets).factors, 1.0)
