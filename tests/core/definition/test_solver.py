"""The solver: as the reference stepped that defined it before, and its own constraints."""

from pathlib import Path

import numpy as np
import pytest

from deformrf.core.definition import contact, solver
from deformrf.core.deform import Material, edge_constraints, lumped_masses, volume_constraints
from deformrf.core.geometry import a15_grid, extract

# 300 substeps of a pillar that a twist takes by its head, from a tangle with an edge of length 0:
# stepped by the reference that was there before core/definition.  From frame 10 on it has contacts.
GOLDEN = np.load(Path(__file__).parents[2] / "golden/definition_solver.npz")
SUBSTEPS, H = 20, 1.0 / 1200.0
FIRST_WITH_CONTACTS = 10


def test_300_substeps_are_those_of_before():
    g = GOLDEN
    system = solver.System(
        inverse_masses=g["inverse_masses"],
        edges=solver.Constraints(g["edges"], g["lengths"], g["edge_a"], g["edge_offsets"]),
        volumes=solver.Constraints(g["tets"], g["volumes"], g["volume_a"], g["volume_offsets"]),
        substep=H,
        decay=np.exp(-3.0 * H),
        gravity=np.array([0.0, 0.0, -9.81]),
        speed_limit=5.0,
        friction=0.4,
    )
    touching = contact.Contacts(
        g["contact_vertices"], g["contact_shares"], g["bevels"], soft_depth=0.01, speed=1.0
    )
    x, v = g["start"], g["velocities"]
    for frame, targets in enumerate(g["targets"]):
        begin, contacts = x, touching if frame >= FIRST_WITH_CONTACTS else None
        for step in range(1, SUBSTEPS + 1):
            path = begin + step / SUBSTEPS * (targets - begin)
            x, v = solver.substep(system, x, v, path, contacts)
        np.testing.assert_allclose(x, g["expected_x"][frame], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(v, g["expected_v"][frame], rtol=0.0, atol=1e-12 / H)


@pytest.fixture(scope="module")
def block():
    grid = a15_grid(0.12)
    middles = grid.rest_vertices[grid.tets].mean(axis=1)
    return extract(grid, (np.abs(middles - 0.5) < 0.25).all(axis=1))[0]


def in_order(constraints, values):
    """Values by the constraints' vertices."""
    rows = zip(np.sort(constraints.vertices, axis=1).tolist(), values, strict=True)
    return [value for _, value in sorted((tuple(row), value) for row, value in rows)]


def test_constraints_are_the_programs_without_its_refinements(block):
    """The program has factors for edges and shares of tets, and no braces on a block."""
    rest, tets, of_a = block.rest_vertices, block.tets, (1e-3, 0.1)  # θh and f
    material = Material(young_modulus=1e5, poisson_ratio=0.4)
    held = rest[:, 2] < 0.4
    w = solver.inverse_masses(rest, tets, 1000.0, held)
    np.testing.assert_allclose(w[~held], 1.0 / lumped_masses(rest, tets, 1000.0)[~held])
    assert not w[held].any() and held.any()
    theirs = edge_constraints(rest, tets)
    alpha = theirs.compliances(material.shear_modulus) * theirs.factors
    ours = solver.edge_constraints(rest, tets, material.shear_modulus, w, *of_a)
    compare(ours, theirs, theirs.regularization(alpha, w, *of_a))
    theirs = volume_constraints(rest, tets)
    alpha = 6.0 * theirs.rest_values / material.bulk_modulus
    ours = solver.volume_constraints(rest, tets, material.bulk_modulus, w, *of_a)
    compare(ours, theirs, theirs.regularization(alpha, w, *of_a))


def compare(ours, theirs, regularization):
    for mine, expected in (
        (ours.rest_values, theirs.rest_values),
        (ours.regularization, regularization),
    ):
        np.testing.assert_allclose(in_order(ours, mine), in_order(theirs, expected))


def test_no_two_constraints_of_a_color_share_a_vertex(block):
    w = np.ones(block.vertex_count)
    edges = solver.edge_constraints(block.rest_vertices, block.tets, 1.0, w, 1e-3, 0.1)
    for first, last in zip(edges.offsets[:-1], edges.offsets[1:], strict=True):
        vertices = edges.vertices[first:last].ravel()
        assert len(np.unique(vertices)) == len(vertices) > 0
    assert edges.offsets[-1] == len(edges.vertices)
