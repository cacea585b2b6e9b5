"""Thin parts: which edges are thin, that thick bodies have none, and how far sheets bend."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from beams import ball, beam
from finite_elements import Solid, quadratic

from deformrf.core.deform import (
    FIRST_INTEGRATOR,
    INTEGRATORS,
    Material,
    XpbdOptions,
    XpbdSolver,
    edge_constraints,
)
from deformrf.core.deform.sheets import sheet_ratios
from deformrf.core.deform.thin import on_surface, thinness
from deformrf.core.geometry import (
    A15,
    BCC,
    EDGES,
    KUHN,
    a15_grid,
    edges,
    extract,
    face_components,
    tet_neighbours,
)
from deformrf.core.geometry.lattice import grid
from deformrf.wings.lab.dynamics.energy import material_energy
from deformrf.wings.lab.dynamics.measure import response

SPACING = 1 / 32  # cells of 1/8
CELL = A15.cell_edge * SPACING
UP = np.array([0.0, 0.0, 1.0])


def direction():
    normal = np.random.default_rng().normal(size=3)
    return normal / np.linalg.norm(normal)


def sheet(normal, cells, height=0.0, inside=lambda centers: True):
    """The tets of a15_grid whose centers are in a layer of so many cells about the middle.

    Those at its edges that only hinge on the others are left out.
    """
    mesh = a15_grid(SPACING)
    centers = mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5
    kept = np.abs(centers @ normal / CELL - height) < cells / 2
    mesh = extract(mesh, kept & inside(centers))[0]
    parts = face_components(tet_neighbours(mesh.tets))
    return extract(mesh, parts == np.bincount(parts).argmax())[0]


def oblong(normal, cells, height=0.0, length=3.0, width=1.5):
    """A sheet of so many cells; half of its length and width in cells, across the normal."""
    along = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    along /= np.linalg.norm(along)
    across = np.cross(normal, along)

    def inside(centers):
        far = np.abs(centers @ np.stack([along, across], axis=1)) / CELL
        return (far < (length, width)).all(axis=1)

    return sheet(normal, cells, height, inside), along


def ratios_of(mesh, rest=None):
    rest = mesh.rest_vertices if rest is None else rest
    ends, edges_of = np.unique(
        np.sort(mesh.tets[:, EDGES].reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    lengths = np.linalg.norm(np.diff(rest[ends], axis=1)[:, 0], axis=1)
    return sheet_ratios(rest, mesh.tets, ends, edges_of.reshape(-1, 6), lengths)[0]


def weights_of(mesh):
    """Of the edges on the surface; 0 inside.  [E]"""
    ends, count = edges(mesh.tets), len(mesh.rest_vertices)
    weights = thinness(mesh.tets, ends, count)[ends].mean(axis=1)
    return np.where(on_surface(mesh.tets, count)[ends].all(axis=1), weights, 0.0)


@pytest.mark.parametrize("body", [beam(A15, 1 / 64).mesh, ball(A15, 1 / 32)], ids=["beam", "ball"])
def test_a_body_of_four_cells_or_more_has_no_thin_edges(body):
    assert (weights_of(body) == 0).all()
    ratios = ratios_of(body)
    np.testing.assert_array_equal(ratios, 1.0)


@pytest.mark.parametrize(("cells", "weight"), [(1.0, 1.0), (1.5, 1.0), (2.0, 0.5), (2.5, 0.5)])
def test_the_thickness_of_a_sheet_decides_and_not_its_direction(cells, weight):
    mesh = sheet(direction(), cells, np.random.default_rng().uniform(-0.5, 0.5))
    middles = mesh.rest_vertices[edges(mesh.tets)].mean(axis=1)
    weights = weights_of(mesh)[(np.abs(middles - 0.5) < 0.5 - CELL).all(axis=1)]
    assert set(weights) == {0.0, weight}


def test_a_brim_is_thin_and_the_ball_that_wears_it_is_not():
    def inside(centers):
        away = np.linalg.norm(centers, axis=1)
        return (away < 0.25) | (np.abs(centers[:, 2]) < CELL / 2)

    mesh = sheet(UP, 8.0, inside=inside)
    away = np.linalg.norm(mesh.rest_vertices[edges(mesh.tets)].mean(axis=1) - 0.5, axis=1)
    weights = weights_of(mesh)
    assert (weights[away < 0.25] == 0).all()
    assert weights.max() == 1.0


def test_a_scaled_sheet_has_the_same_ratios():
    mesh, _ = oblong(direction(), 1.0)
    rest = mesh.rest_vertices.astype(np.float64)
    scaled = (3.7 * rest + 0.3).astype(np.float32).astype(np.float64)
    one, other = (ratios_of(mesh, x) for x in (rest, scaled))
    np.testing.assert_allclose(np.sort(other), np.sort(one), rtol=0.01)
    assert len(set(one)) > 100  # each edge has its own


def test_the_same_sheet_has_the_same_ratios_to_the_bit():
    mesh, _ = oblong(direction(), 1.0)
    one, other = (ratios_of(mesh) for _ in range(2))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("lattice", [BCC, KUHN], ids=["bcc", "kuhn"])
def test_other_lattices_have_no_factors_of_sheets(lattice):
    mesh = grid(lattice, 0.2)
    mesh, _ = extract(mesh, mesh.rest_vertices[mesh.tets].mean(axis=1)[:, 2] < 0.25)
    ratios = ratios_of(mesh)
    np.testing.assert_array_equal(ratios, 1.0)


@pytest.mark.parametrize("later", [False, True], ids=["from the start", "later"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_first_integrator_keeps_the_factors_of_the_endless_lattice(integrator, later):
    (mesh, _), material = oblong(UP, 1.0), Material(poisson_ratio=0.25)
    (other,) = set(INTEGRATORS) - {integrator}
    options = XpbdOptions(integrator=integrator)
    held = np.zeros(len(mesh.rest_vertices), bool)
    start = replace(options, integrator=other) if later else options
    solver = XpbdSolver(mesh.rest_vertices, mesh.tets, material, held, start)
    solver.set_options(options)
    found, _ = solver.compliances
    of_lattice, _ = material.compliances(solver.edges, solver.volumes)
    if integrator != FIRST_INTEGRATOR:
        assert np.abs(found / of_lattice - 1.0).max() > 0.3
        of_lattice = of_lattice / solver.edges.sheet_ratios.at(0.25)
    np.testing.assert_array_equal(found, of_lattice)
    solver.set_compliances(1.0, None)
    edges, volumes = solver.compliances
    assert (edges == 1.0).all() and volumes is None
    solver.set_material(material)
    np.testing.assert_array_equal(solver.compliances[0], found)


def too_far(normal, cells, height, ratio):
    """How much farther a sheet sags than quadratic elements, over that: fitted, as a lattice.

    Returns:
        An end or a long side is held, to three depths.  [6] each
    """
    mesh, along = oblong(normal, cells, height)
    rest, material = mesh.rest_vertices, Material(1.0, ratio, 1.0)
    mu, fitted = material.shear_modulus, material_energy(mesh.rest_vertices, mesh.tets, material)
    edges = edge_constraints(rest, mesh.tets)
    of_lattice = replace(fitted, stiffnesses=fitted.stiffnesses / edges.sheet_ratios.at(ratio))
    errors = []
    for axis, depth in product((along, np.cross(normal, along)), (0.3, 0.75, 1.3)):
        held = rest @ axis < (rest @ axis).min() + depth * CELL
        loads = fitted.masses * ~held
        elements = Solid(quadratic(rest, mesh.tets, held), material.bulk_modulus + mu, mu, 1.0)
        work = loads @ (elements.sag(normal)[: len(rest)] @ normal)
        works = [loads @ (response(x, rest, held, normal) @ normal) for x in (fitted, of_lattice)]
        errors.append(np.array(works) / work - 1.0)
    return np.transpose(errors)


@pytest.mark.parametrize(
    ("cells", "most"),
    [(1.0, 0.09), *(pytest.param(cells, 0.06, marks=pytest.mark.soak) for cells in (1.5, 2.0))],
)
def test_sheets_sag_like_quadratic_elements(cells, most):
    """Whatever the direction and height of their cut; some clamps are off by up to 0.2."""
    random = np.random.default_rng()
    heights = random.uniform(-0.5, 0.5, 2)
    cases = zip((UP, direction()), heights, (0.25, 0.45), strict=True)
    fitted, of_lattice = np.abs([too_far(n, cells, h, ratio) for n, h, ratio in cases]).mean(
        axis=(0, 2)
    )
    assert fitted < min(most, of_lattice)
