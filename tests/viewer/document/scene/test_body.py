"""Real sizes: the solver's units, materials, surroundings and rest shapes of the viewer's body."""

import math
from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import TIME_STEP, XpbdOptions, XpbdSolver, lowest_pins
from deformrf.core.field import STIFFNESS_RANGE
from deformrf.viewer.document import EARTH, Body
from deformrf.viewer.document.scene.body import FLOATING_DRAG, stored_size


def make_body(field, meters=None):
    """A body whose visible part is the whole mesh, 1 unit wide."""
    mesh = field.mesh
    pins = lowest_pins(mesh.rest_vertices, mesh.tets)
    return Body(mesh.rest_vertices, mesh.tets, pins, 1.0, meters, "cpu")


def positions(solver):
    return solver.vertices.numpy().astype(np.float64)


def test_a_body_moves_as_a_mesh_of_its_real_size_does(ball):
    """Under its weight and in wind: the same as the mesh in meters, to rounding."""
    meters = 0.4
    body = make_body(ball, meters)
    body.set_material(young_modulus=2e5)
    body.set_gravity(EARTH)
    body.set_air_drag(2.0)
    body.set_wind(3.0)
    options = XpbdOptions(gravity=(0.0, 0.0, -EARTH), air_drag=2.0, wind=(3.0, 0.0, 0.0))
    rest, pinned = meters * ball.mesh.rest_vertices, body.solver.pinned
    real = XpbdSolver(rest, ball.mesh.tets, body.material, pinned, options)
    for _ in range(30):
        body.solver.step(TIME_STEP)
        real.step(TIME_STEP)
    moved = positions(body.solver) - ball.mesh.rest_vertices
    assert np.abs(moved).max() > 0.01
    np.testing.assert_allclose(positions(real) - rest, meters * moved, atol=1e-5 * meters)
    assert body.held_young_modulus == pytest.approx(real.held_young_modulus(), rel=1e-5)
    assert body.substeps_that_hold == real.substeps_that_hold()


def test_a_size_that_is_set_counts_from_then_on(ball):
    body, other = make_body(ball), make_body(ball, 0.3)
    assert body.meters == 1.0
    body.set_gravity(EARTH)
    other.set_gravity(EARTH)
    body.set_meters(0.3)
    assert body.meters == pytest.approx(0.3)
    body.adapt_substeps()
    assert body.solver.options == other.solver.options
    assert body.solver.material == other.solver.material
    assert body.material == other.material  # the real one


def test_air_brakes_what_floats_but_not_what_falls_unless_it_is_set(ball):
    body = make_body(ball)
    assert body.air_drag == body.solver.options.air_drag == FLOATING_DRAG
    body.set_gravity(EARTH)
    assert body.air_drag == body.solver.options.air_drag == 0.0
    body.set_air_drag(0.5)
    body.set_gravity(0.0)
    assert body.air_drag == body.solver.options.air_drag == 0.5


def test_a_rest_shape_can_be_undone(ball):
    body, rest = make_body(ball), ball.mesh.rest_vertices
    assert not body.rests_elsewhere
    for scale in (1.1, 1.2):
        body.solver.set_state(rest * scale)
        assert body.rest_here()
    for tangled in (rest * [1.0, 1.0, -1.0], rest * 0.0):
        body.solver.set_state(tangled)
        assert not body.rest_here()
    np.testing.assert_allclose(body.solver.rest_shape, 1.2 * rest, atol=1e-6)
    body.undo_rest_here()
    np.testing.assert_allclose(body.solver.rest_shape, 1.1 * rest, atol=1e-6)
    body.undo_rest_here()
    np.testing.assert_allclose(body.solver.rest_shape, rest, atol=1e-6)
    assert not body.rests_elsewhere
    body.undo_rest_here()  # nothing is left to undo


def test_a_material_that_yields_is_kept_by_other_changes(ball):
    body = make_body(ball, 0.5)
    body.set_material(yield_strain=0.05)
    body.set_material(young_modulus=3e5)
    assert body.material.yield_strain == body.solver.material.yield_strain == 0.05
    assert body.solver.material == replace(body.material, young_modulus=3e5 / 0.25)


@pytest.mark.parametrize(
    "wrong", ["0.3", 0, -1.0, math.inf, math.nan, True, None, [0.3], 1e-200, 1e9]
)
def test_a_model_that_states_no_size_is_a_meter_a_unit(wrong):
    assert stored_size({"size": wrong}) is None
    assert stored_size({}) is None


def test_a_model_may_state_its_size():
    assert stored_size({"size": 0.3}) == 0.3
    assert stored_size({"size": 2}) == 2.0


def test_paint_is_bounded_and_can_be_cleared(ball):
    body = make_body(ball, 0.5)
    ids = np.arange(10)
    for _ in range(100):
        body.paint(ids, np.ones(10), 2.0)
        body.paint(ids + 10, np.ones(10), 0.5)
    assert body.factors[:10].max() == STIFFNESS_RANGE[1]
    assert body.factors[10:20].min() == STIFFNESS_RANGE[0]
    assert (body.factors[20:] == 1.0).all()
    body.set_material(young_modulus=2e5)  # keeps the paint
    edges = body.solver.edges
    expected = edges.compliances(body.solver.material.shear_modulus)
    expected = edges.softened(expected, body.factors)
    np.testing.assert_allclose(body.solver._compliances[0], expected)
    body.clear_paint()
    assert body.factors is None
    expected = edges.compliances(body.solver.material.shear_modulus)
    np.testing.assert_allclose(body.solver._compliances[0], expected)
