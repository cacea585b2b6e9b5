"""Braces: which hinges have them, and that parts that are joined by them don't swing slowly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import eigsh

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver, hinges
from deformrf.core.deform.hinges import hinge_braces
from deformrf.core.geometry import (
    A15,
    KUHN,
    TetMesh,
    a15_grid,
    extract,
    face_components,
    signed_volumes,
    tet_neighbours,
)
from deformrf.core.geometry.lattice import grid
from deformrf.wings.lab.dynamics.energy import material_energy
from deformrf.wings.lab.stability.measure import NamedMaterial, run_case
from deformrf.wings.lab.stability.stress import CASES

SPACINGS = {"a15": (A15, 0.04), "kuhn": (KUHN, 1 / 16)}
MATERIAL = Material(young_modulus=1e6)


def block(lattice, size=0.5):
    """A cube of a lattice: vertices and tets."""
    mesh = grid(*SPACINGS[lattice])
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1)
    mesh, _ = extract(mesh, ((middles > 0.0) & (middles < size)).all(axis=1))
    return mesh.rest_vertices, mesh.tets


def merged(rest, tets, others, other_tets):
    """One mesh of two, whose vertices at the same place are one."""
    both = np.concatenate([rest, others])
    _, first, ids = np.unique(
        np.rint(both * 1e6).astype(int), axis=0, return_index=True, return_inverse=True
    )
    return both[first], ids.ravel()[np.concatenate([tets, other_tets + len(rest)])]


def joined_at_a_vertex(rest, tets):
    """A block and its mirror image behind the outermost vertex of a corner."""
    corner = rest[np.argmax(rest @ [1.0, 1.1, 1.2])]
    return merged(rest, tets, 2.0 * corner - rest, tets[:, [0, 1, 3, 2]])


def joined_at_an_edge(rest, tets):
    """A block and the same after half a turn about its outermost edges."""
    turned = rest.copy()
    outermost = rest[np.argmax(np.round(rest[:, 0] + rest[:, 2], 9))]
    turned[:, [0, 2]] = 2.0 * outermost[[0, 2]] - rest[:, [0, 2]]
    return merged(rest, tets, turned, tets)


JOINTS = {"vertex": joined_at_a_vertex, "edge": joined_at_an_edge}
joints = pytest.mark.parametrize("joint", JOINTS.values(), ids=JOINTS)
lattices = pytest.mark.parametrize("lattice", SPACINGS)


def with_a_neck(width):
    """Two cubes of A15 of 0.5 m with a cube between their corners."""
    mesh = grid(*SPACINGS["a15"])
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1)
    low, high = ((middles > k) & (middles < k + 0.5) for k in (0.0, 0.5))
    neck = np.abs(middles - 0.5) < width / 2
    mesh, _ = extract(mesh, np.any([part.all(axis=1) for part in (low, high, neck)], axis=0))
    return mesh.rest_vertices, mesh.tets


def lowest_frequency(rest, tets):
    """Of the free body [Hz], beside its six rigid motions."""
    energy = material_energy(rest, tets, MATERIAL)
    masses = sparse.diags_array(np.repeat(energy.masses, 3), format="csc")
    squares = eigsh(energy.hessian(rest).tocsc(), 7, masses, sigma=-1.0, return_eigenvectors=False)
    assert np.sort(squares)[5] < 1e-3
    return np.sqrt(squares.max()) / (2.0 * np.pi)


def test_a_grid_needs_no_braces():
    mesh = a15_grid(0.1)
    assert (face_components(tet_neighbours(mesh.tets)) == 0).all()
    assert [len(braces) for braces in hinge_braces(mesh.rest_vertices, mesh.tets, 0.2)] == [0, 0]


@pytest.mark.parametrize(
    ("tets", "expected"),
    [
        ([[0, 1, 2, 3], [1, 2, 3, 4]], []),  # a common face
        ([[0, 1, 2, 3], [4, 5, 6, 7]], []),  # apart
        ([[0, 1, 2, 3], [0, 1, 4, 5]], [[2, 4], [2, 5], [3, 4], [3, 5]]),
        ([[0, 1, 2, 3], [0, 4, 5, 6]], [[a, b] for a in (1, 2, 3) for b in (4, 5, 6)]),
    ],
)
def test_tets_that_share_an_edge_or_a_vertex_alone_get_short_braces(tets, expected):
    rest = np.random.default_rng().normal(size=(8, 3))
    short, far = hinge_braces(rest, np.array(tets), mean_edge=10.0)
    assert short.tolist() == expected
    assert len(far) == 0


@lattices
@joints
def test_long_braces_join_three_places_of_each_part(joint, lattice):
    rest, tets = joint(*block(lattice))
    labels = face_components(tet_neighbours(tets))
    assert labels.max() == 1 and signed_volumes(rest, tets).min() > 0
    _, far = hinge_braces(rest, tets, mean_edge=0.08)
    assert len(far) == 9
    parts = [np.unique(tets[labels == part]) for part in (0, 1)]
    hinge = rest[np.intersect1d(*parts)]
    for part in parts:
        places = np.intersect1d(far, part)
        assert len(places) == 3
        levers = np.linalg.norm(rest[places, None] - hinge, axis=2).min(axis=1)
        assert 0.5 < levers.min() / (hinges.REACH * 0.5) and levers.max() < 1.1 * hinges.REACH * 0.5
        arms = (rest[places] - hinge.mean(axis=0)) / (hinges.REACH * 0.5)
        assert np.abs(np.linalg.det(arms)) > hinges.FLAT / 2


def test_small_parts_get_short_braces_alone():
    rest, tets = block("a15")
    corner = rest[np.argmax(rest @ [1.0, 1.1, 1.2])]
    tet = np.array([corner, *(corner + 0.05 * (1.0 + np.eye(3)))])
    short, far = hinge_braces(*merged(rest, tets, tet, np.arange(4)[None]), mean_edge=0.09)
    assert len(short) > 0 and len(far) == 0


@lattices
@joints
def test_joined_blocks_swing_as_with_a_neck(joint, lattice):
    """A neck of 0.15 m, a third of a block's width."""
    assert lowest_frequency(*joint(*block(lattice))) > lowest_frequency(*with_a_neck(0.15))


def test_without_long_braces_they_swing_far_slower(monkeypatch):
    body = joined_at_a_vertex(*block("kuhn"))
    braced = lowest_frequency(*body)
    monkeypatch.setattr(hinges, "LEAST_REACH", 1e9)
    assert lowest_frequency(*body) < 0.3 * braced


@joints
def test_a_block_that_was_turned_about_its_hinge_returns(joint):
    """Within 4 s; with short braces alone the vertex's hinge needs 7 s."""
    rest, tets = joint(*block("kuhn"))
    part = np.unique(tets[face_components(tet_neighbours(tets)) == 1])
    pinned = np.ones(len(rest), bool)
    pinned[part] = False
    solver = XpbdSolver(rest, tets, MATERIAL, pinned, XpbdOptions(rescue=False))
    held = part[np.argsort(rest[part] @ [1.0, 0.2, 0.1])[-20:]]
    solver.grab(held)
    for frame in range(30):
        solver.move(rest[held] + (frame + 1) / 30 * np.array([0.0, 0.25, 0.0]))
        solver.step(TIME_STEP)
    assert np.abs(solver.vertices.numpy() - rest).max() > 0.2
    solver.release()
    for _ in range(240):
        solver.step(TIME_STEP)
    assert np.abs(solver.vertices.numpy() - rest).max() < 0.005


@pytest.mark.parametrize("case", [case for case in CASES if not case.uneven], ids=lambda c: c.name)
def test_a_joined_body_recovers_from_stress(case):
    rest, tets = joined_at_a_vertex(*block("a15", 0.4))
    mesh = TetMesh(rest, np.rint(rest * 1e6).astype(np.int32), tets.astype(np.int32))
    assert len(hinge_braces(rest, tets, 0.09)[1]) == 9
    assert run_case(
        mesh, NamedMaterial("two blocks", MATERIAL), case, "cpu", 0, without_contact
    ).passed


def without_contact(*arguments):
    """Blocks that land in each other's way may jam, which no brace prevents."""
    *body, options, device = arguments
    return XpbdSolver(*body, replace(options, contact=False), device)
