"""A body that keeps a pose: rest shapes taken from it, and edges that yield."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver, lowest_pins, rest_shape
from deformrf.core.geometry import a15_grid, extract, signed_volumes

DT = 1.0 / 60.0
GRID = a15_grid(0.1)
MIDDLE = GRID.rest_vertices[GRID.tets].mean(axis=1)
MESH = extract(GRID, (np.abs(MIDDLE[:, :2] - 0.5) < 0.16).all(axis=1))[0]  # a pillar
REST = MESH.rest_vertices
FOOT = lowest_pins(REST, MESH.tets)


def make_solver(device, material=None, **options):
    return XpbdSolver(REST, MESH.tets, material or Material(), FOOT, XpbdOptions(**options), device)


def bent(angle=0.8):
    """The pillar along an arc, its foot where it was.  [V, 3]"""
    low = REST[FOOT, 2].max()
    height = np.maximum(REST[:, 2] - low, 0.0)
    turn = angle * height / height.max()
    radius = height.max() / angle
    out = REST[:, 0] - 0.5
    x = 0.5 + radius * (1.0 - np.cos(turn)) + out * np.cos(turn)
    z = np.minimum(REST[:, 2], low) + radius * np.sin(turn) - out * np.sin(turn)
    return np.stack([x, REST[:, 1], z], axis=1)


def away(solver, shape):
    """The largest distance of a vertex to its place in the shape."""
    return np.linalg.norm(solver.vertices.numpy() - shape, axis=1).max()


def run(solver, seconds):
    for _ in range(round(seconds / DT)):
        solver.step(DT)


def test_a_pose_that_became_the_rest_shape_stays(device):
    solver = make_solver(device)
    solver.set_state(bent())
    solver.set_rest_shape(bent())
    run(solver, 5.0)
    assert away(solver, bent()) < 1e-4 and solver.settled
    solver.set_rest_shape()
    run(solver, 8.0)
    assert away(solver, REST) < 1e-3


def test_a_body_returns_to_the_shape_that_was_taken(device):
    """After a drag, and after a reset."""
    solver = make_solver(device)
    solver.set_rest_shape(bent())
    run(solver, 8.0)
    assert away(solver, bent()) < 1e-3
    head = np.flatnonzero(REST[:, 2] > 0.9)
    solver.grab(head)
    solver.move(REST[head] + [0.0, 0.4, 0.0])
    run(solver, 1.0)
    solver.release()
    run(solver, 8.0)
    assert away(solver, bent()) < 1e-3
    solver.set_state(REST)
    solver.reset()
    assert away(solver, bent()) < 1e-6


def test_a_tangled_body_is_taken_back_to_the_shape_that_was_taken(device):
    solver = make_solver(device)
    solver.set_rest_shape(bent())
    spoiled = np.random.default_rng().uniform(0.2, 0.8, REST.shape)
    spoiled[FOOT] = REST[FOOT]
    solver.set_state(spoiled)
    run(solver, 10.0)
    assert away(solver, bent()) < 0.01


def test_collapsed_and_inverted_parts_of_a_pose_keep_some_of_their_size(device):
    solver = make_solver(device)
    solver.set_rest_shape(np.where(FOOT[:, None], REST, 0.5))  # a point, but for the foot
    edges, volumes = (part.rest_values for part in solver._lists)
    assert (edges >= 0.099 * solver.edges.rest_values).all()
    assert (volumes >= 0.099 * solver.volumes.rest_values).all()
    run(solver, 1.0)
    assert np.isfinite(solver.vertices.numpy()).all()


def test_rest_values_survive_a_change_of_what_is_in_use(device):
    """Pins leave constraints out; when these come back they have their values again."""
    solver = make_solver(device)
    solver.set_rest_shape(bent())
    expected = [part.rest_values.copy() for part in solver._lists]
    solver.set_pinned(np.ones(len(REST), bool))
    solver.step(DT)
    assert len(solver._lists[0].in_use) == 0
    solver.set_pinned(FOOT)
    solver.step(DT)
    for part, values in zip(solver._lists, expected, strict=True):
        np.testing.assert_allclose(part.rest_values, values, rtol=1e-6)


def flowed(lengths, rest_lengths, first_rest_lengths, yield_strain):
    """Rest lengths after a frame that ends with these lengths.  [C]"""
    strain = lengths / rest_lengths - 1.0
    kept = lengths / (1.0 + np.clip(strain, -yield_strain, yield_strain))
    kept = np.where(np.abs(strain) > yield_strain, kept, rest_lengths)
    return np.clip(
        kept, first_rest_lengths / rest_shape.FLOW_LIMIT, first_rest_lengths * rest_shape.FLOW_LIMIT
    )


@pytest.mark.parametrize("yield_strain", [0.02, 0.3])
def test_the_kernel_agrees_with_the_reference(device, yield_strain):
    solver = make_solver(device, Material(yield_strain=yield_strain))
    start = REST + np.random.default_rng().normal(scale=0.03, size=REST.shape)
    solver.set_state(start)
    solver._prepare()
    own = solver.edges.rest_values
    for _ in range(2):  # the second time from what the first has left
        before = solver._lists[0].rest_values.copy()
        solver._rest_shape.flow()
        ends = solver.vertices.numpy().astype(np.float64)[solver.edges.vertices]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        expected = flowed(lengths, before, own, yield_strain)
        in_use = solver._lists[0].in_use
        np.testing.assert_allclose(
            solver._lists[0].rest_values[in_use], expected[in_use], rtol=1e-5
        )
        assert (expected != before)[in_use].any()
        solver.vertices.assign((start * [1.0, 1.0, 1.1]).astype(np.float32))


def drag_and_let_go(solver, way):
    """Drag the head within a second, hold it for one, and let it come to rest."""
    head = np.flatnonzero(REST[:, 2] > 0.9)
    solver.grab(head)
    for frame in range(120):
        solver.move(REST[head] + np.array(way) * min(1.0, (frame + 1) / 60))
        solver.step(DT)
    solver.release()
    run(solver, 8.0)


def test_what_yields_stays_bent_and_keeps_its_volume(device):
    solver = make_solver(device, Material(yield_strain=0.02))
    drag_and_let_go(solver, (0.4, 0.0, 0.0))
    assert away(solver, REST) > 0.1 and not solver.rescue.running
    volumes = [signed_volumes(x, MESH.tets).sum() for x in (REST, solver.vertices.numpy())]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.04)
    solver.reset()
    run(solver, 1.0)
    assert away(solver, REST) < 1e-6


def test_below_its_yield_strain_a_body_is_elastic(device):
    """The same to the bit as one that never yields."""
    ends = []
    for yield_strain in (np.inf, 0.9):
        solver = make_solver(device, Material(yield_strain=yield_strain))
        drag_and_let_go(solver, (0.2, 0.0, 0.0))
        ends.append(solver.vertices.numpy().copy())
    np.testing.assert_array_equal(*ends)
    assert np.abs(ends[0] - REST).max() < 1e-3


def test_a_yield_strain_is_positive():
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="yield strain"):
            replace(Material(), yield_strain=wrong)
