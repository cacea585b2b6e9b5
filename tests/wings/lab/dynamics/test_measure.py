"""The push on a model's own mesh: linear response, and the scenes that are made of it."""

from dataclasses import replace

import numpy as np
import pytest
from beams import ball, beam

from deformrf.core.deform import lowest_pins
from deformrf.core.geometry import A15, BCC, components
from deformrf.wings.lab.dynamics import measure as dynamics
from deformrf.wings.lab.dynamics.measure import (
    LoadCase,
    load_cases,
    measure,
    response,
    standing,
)


@pytest.fixture(scope="module")
def column():
    """A stout beam that stands on its clamp, so that the push bends it."""
    body = beam(A15, 1 / 8, width=0.5)
    upright = replace(body.mesh, rest_vertices=body.mesh.rest_vertices[:, [1, 2, 0]])
    return standing(upright)._replace(held=body.clamped)


def largest(way):
    return np.linalg.norm(way, axis=-1).max()


def size_of(body):
    return np.ptp(body.rest, axis=0).max()


def test_a_body_stands_on_its_foot_where_float32_has_it():
    mesh = ball(BCC, 1 / 4)
    mesh = replace(mesh, rest_vertices=mesh.rest_vertices / 3.0)
    body = standing(mesh)
    rest = body.rest
    np.testing.assert_array_equal(rest, rest.astype(np.float32))
    np.testing.assert_allclose(rest, mesh.rest_vertices, rtol=1e-7)
    np.testing.assert_array_equal(body.held, lowest_pins(rest, mesh.tets))
    assert rest[body.held, 2].max() < rest[~body.held, 2].min()


def test_the_response_balances_the_load(column):
    """K u = M e on the free vertices; the held ones stay."""
    case = LoadCase(column, "static", (0.0, 0.0, 0.0))
    rest, held = column.rest, column.held
    direction = np.random.default_rng().normal(size=3)
    moved = response(case.energy, rest, held, direction)
    assert np.all(moved[held] == 0.0) and np.all(moved[~held] != 0.0)
    forces = (case.energy.hessian(rest) @ moved.ravel()).reshape(-1, 3)
    load = case.energy.masses[:, None] * direction
    np.testing.assert_allclose(forces[~held], load[~held], atol=1e-9 * np.abs(load).max())


def test_the_response_is_linear(column):
    energy = LoadCase(column, "static", (0.0, 0.0, 0.0)).energy
    a, b = np.random.default_rng().normal(size=(2, 3))

    def moved(direction):
        return response(energy, column.rest, column.held, direction)

    both = moved(2.0 * a - b)
    np.testing.assert_allclose(2.0 * moved(a) - moved(b), both, atol=1e-9 * largest(both))


@pytest.mark.parametrize("scale", [0.1, 1.0])
def test_a_linear_body_moves_by_the_push(column, scale):
    """However large it is; both scenes have the same push, sideways."""
    body = column._replace(rest=scale * column.rest)
    still, falling = load_cases(body)
    assert (still.scene, falling.scene) == ("static", "dynamic")
    assert still.gravity == falling.gravity and still.gravity[0] > 0.0 == still.gravity[2]
    moved = response(still.energy, body.rest, body.held, still.gravity)
    assert largest(moved) == pytest.approx(dynamics.PUSH * size_of(body))


def test_a_stout_body_moves_nearly_as_far(column):
    case = load_cases(column)[0]
    moved = case.reference[0][0] - column.rest
    assert case.reference[1] < 1e-9
    assert largest(moved) == pytest.approx(dynamics.PUSH * size_of(column), rel=0.1)
    assert moved[:, 0].min() > -0.2 * largest(moved)  # to where it is pushed


def test_more_substeps_are_closer(column, device):
    for case in load_cases(column):
        counts = (5, 10, 20)
        errors = [measure(case, n, device, 600).of_motion for n in counts]
        assert errors[0] > 1.5 * errors[1] > 1.5**2 * errors[2] > 0.0
        assert errors[2] < 2.0


def test_every_part_is_held():
    """Two balls, one above the other: the upper one doesn't float."""
    mesh = ball(BCC, 1 / 4)
    upper = mesh.rest_vertices + np.array([0.0, 0.0, 2.0])
    both = replace(
        mesh,
        rest_vertices=np.concatenate([mesh.rest_vertices, upper]),
        addresses=np.concatenate([mesh.addresses, mesh.addresses + 100]),
        tets=np.concatenate([mesh.tets, mesh.tets + mesh.vertex_count]),
    )
    assert components(both.vertex_count, both.tets).max() == 1
    body = standing(both)
    case = load_cases(body)[0]
    one = standing(mesh)
    moved = response(case.energy, both.rest_vertices, body.held, dynamics.ASIDE)
    energy = LoadCase(one, "static", (0.0, 0.0, 0.0)).energy
    expected = response(energy, mesh.rest_vertices, one.held, dynamics.ASIDE)
    np.testing.assert_allclose(moved[mesh.vertex_count :], expected, atol=1e-5 * largest(expected))


def test_what_nothing_holds_is_an_error():
    mesh = ball(BCC, 1 / 4)
    loose = replace(
        mesh,
        rest_vertices=np.concatenate([mesh.rest_vertices, [[0.0, 0.0, 0.9]]]),
        addresses=np.concatenate([mesh.addresses, [[99, 99, 99]]]),
    )
    with pytest.raises(RuntimeError):
        load_cases(standing(loose))
