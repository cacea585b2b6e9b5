"""Time, the grab, and the user's choices, without OpenGL."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from displaced import displacements

from deformrf.core.deform import TIME_STEP
from deformrf.core.field import load, save
from deformrf.viewer.document import MAX_STEPS, Scene


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


@pytest.fixture
def steps(scene, monkeypatch):
    """The lengths of the solver's steps."""
    taken = []
    monkeypatch.setattr(scene.solver, "step", taken.append)
    return taken


def grab_free(scene):
    vertex = int(scene.handles.control_ids[0])
    scene.handles.grab(vertex)
    return vertex


def test_at_rest_the_solver_takes_no_step_and_the_pose_stays(scene, steps):
    revision = scene.revision
    scene.clock.advance(1.0)
    assert steps == []
    assert scene.revision == revision
    assert not scene.clock.moving


@pytest.mark.parametrize("rate", [24, 30, 60, 144])
def test_time_in_the_object_runs_as_outside(scene, steps, rate):
    grab_free(scene)
    for _ in range(2 * rate):
        scene.clock.advance(1.0 / rate)
    assert sum(steps) == pytest.approx(2.0, abs=TIME_STEP)
    assert set(steps) == {TIME_STEP}


def test_a_frame_of_several_seconds_is_not_followed_by_one_as_long(scene, steps):
    grab_free(scene)
    scene.clock.advance(5.0)
    assert len(steps) == MAX_STEPS
    scene.clock.advance(TIME_STEP)
    assert len(steps) <= MAX_STEPS + 2


def test_a_paused_scene_takes_only_single_steps(scene, steps):
    grab_free(scene)
    scene.clock.paused = True
    scene.clock.advance(1.0)
    assert steps == []
    scene.clock.single_step()
    assert steps == [TIME_STEP]


def test_the_grabbed_vertex_is_at_its_target_after_a_frame(scene):
    vertex = grab_free(scene)
    target = scene.handles.at([vertex])[0] + np.array([0.05, 0.02, 0.0])
    scene.handles.drag_to(target)
    scene.clock.advance(4 * TIME_STEP)
    assert scene.handles.at([vertex])[0] == pytest.approx(target, abs=1e-5)


def test_a_held_object_at_rest_does_not_count_as_changed(scene):
    vertex = grab_free(scene)
    scene.handles.drag_to(scene.handles.at([vertex])[0] + np.float32(0.05))
    for _ in range(600):
        scene.clock.advance(TIME_STEP)
    revision = scene.revision
    for _ in range(30):
        scene.clock.advance(TIME_STEP)
    assert scene.clock.moving
    assert scene.revision == revision


def test_reset_is_the_rest_pose(scene):
    vertex = grab_free(scene)
    scene.handles.drag_to(scene.handles.at([vertex])[0] + 0.1)
    scene.clock.advance(TIME_STEP)
    scene.reset()
    assert displacements(scene).max() == 0.0
    assert not scene.clock.moving


def test_another_number_of_substeps_keeps_the_pose(scene):
    vertex = grab_free(scene)
    scene.handles.drag_to(scene.handles.at([vertex])[0] + 0.1)
    scene.clock.advance(TIME_STEP)
    before = scene.positions.copy()
    scene.body.set_options(substep_count=7)
    assert scene.solver.options.substep_count == 7
    assert scene.positions == pytest.approx(before, abs=1e-6)


def test_another_number_of_substeps_does_not_end_a_drag(scene):
    vertex = grab_free(scene)
    scene.body.set_options(substep_count=7)
    target = scene.handles.at([vertex])[0] + np.array([0.05, 0.02, 0.0])
    scene.handles.drag_to(target)
    scene.clock.advance(4 * TIME_STEP)
    assert scene.handles.at([vertex])[0] == pytest.approx(target, abs=1e-5)


def test_pins_can_be_let_go_and_set_again(scene):
    assert scene.held
    scene.hold(False)
    assert not scene.held
    scene.hold(True)
    assert (scene.solver.pinned == scene.pins).all()


def test_one_pin_can_be_freed_and_one_vertex_pinned_where_it_is(scene):
    pin, vertex = int(scene.handles.pin_ids[0]), grab_free(scene)
    scene.handles.drag_to(scene.handles.at([vertex])[0] + np.float32(0.05))
    scene.clock.advance(TIME_STEP)
    bent = scene.handles.at([vertex])[0].copy()
    scene.handles.release()
    scene.handles.set_pin(vertex, True)
    scene.handles.set_pin(pin, False)
    assert set(scene.handles.corners(vertex)) <= set(np.flatnonzero(scene.solver.pinned))
    assert vertex not in scene.handles.control_ids
    assert pin not in scene.handles.pin_ids
    for _ in range(30):
        scene.clock.advance(TIME_STEP)
    assert (scene.handles.at([vertex])[0] == bent).all()
    scene.hold(True)
    kept = [pin, *scene.handles.corners(vertex)]
    assert scene.solver.pinned[kept].all()  # what the user pinned stays
    scene.hold(False)
    assert not scene.held


def test_gravity_and_ground_come_and_go(scene):
    scene.hold(False)
    scene.set_gravity(10.0)
    scene.set_ground(True)
    assert scene.body.gravity == 10.0 and scene.on_ground
    for _ in range(60):
        scene.clock.advance(TIME_STEP)
    lowest = scene.field.mesh.rest_vertices[:, 2].min()
    assert scene.positions[:, 2].min() == pytest.approx(lowest, abs=1e-3)
    scene.set_ground(False)
    for _ in range(60):
        scene.clock.advance(TIME_STEP)
    assert scene.positions[:, 2].max() < lowest
    scene.set_gravity(0.0)
    scene.reset()
    assert not scene.clock.moving


def test_no_control_vertex_is_a_pin(scene):
    pinned = [scene.pins[scene.handles.corners(one)].all() for one in scene.handles.control_ids]
    assert not any(pinned)
    assert len(scene.handles.control_ids) > 20


def test_a_poisson_ratio_below_the_limit_raises_no_warning(scene):
    """The panel says it, and a slider would say it a hundred times."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.body.set_material(poisson_ratio=0.1)
    assert scene.body.material.held_poisson_ratio == 0.25


def test_the_held_stiffness_follows_material_and_substeps(scene):
    held = scene.body.held_young_modulus
    assert held == scene.solver.held_young_modulus()
    scene.body.set_options(substep_count=2 * scene.solver.options.substep_count)
    assert held < scene.body.held_young_modulus < scene.body.material.young_modulus
    scene.body.set_material(young_modulus=1e9)
    assert scene.body.held_young_modulus < 0.5e9


def test_the_held_stiffness_follows_the_pins(scene):
    """An edge of two pins can't move and has no stiffness ratio: other pins, another median."""
    body = scene.body
    before = body.held_young_modulus, body.substeps_that_hold
    rest = scene.field.mesh.rest_vertices
    scene.solver.set_pinned(rest[:, 2] < np.median(rest[:, 2]))
    held = scene.solver.held_young_modulus(), scene.solver.substeps_that_hold()
    assert (body.held_young_modulus, body.substeps_that_hold) == held != before


def test_the_material_changes_one_value_at_a_time(scene):
    scene.body.set_material(young_modulus=2e4)
    assert scene.solver.material.young_modulus == 2e4
    assert scene.solver.material.damping == scene.body.material.damping


@pytest.fixture
def upper_half(ball):
    """A scene in which only the mesh's upper half can be seen."""
    rest = ball.mesh.rest_vertices
    return Scene(ball, "ball", "cpu", rest[rest[:, 2] > 0.5])


def test_at_rest_focus_frames_what_the_first_view_frames(upper_half):
    first = upper_half.orbit
    upper_half.orbit = replace(first, target=np.zeros(3), distance=9.0)
    upper_half.viewpoint.focus()
    assert upper_half.orbit.target == pytest.approx(first.target, abs=1e-6)
    assert upper_half.orbit.distance == pytest.approx(first.distance, abs=1e-5)


def test_focus_follows_what_is_seen_and_not_the_rest_of_the_mesh(upper_half):
    scene, (middle, distance) = upper_half, (upper_half.center, upper_half.orbit.distance)
    positions = scene.positions.copy()
    seen = scene.field.mesh.rest_vertices[:, 2] > 0.5
    positions[seen] += np.float32(0.2)
    positions[~seen] -= np.float32(3.0)
    scene.solver.set_state(positions)
    scene.revision += 1
    scene.viewpoint.focus()
    assert scene.orbit.target == pytest.approx(middle + 0.2, abs=1e-6)
    assert scene.orbit.distance == pytest.approx(distance, abs=1e-5)


def test_focus_on_a_vertex_turns_about_it(scene):
    scene.handles.hover = int(scene.handles.control_ids[3])
    scene.viewpoint.focus()
    assert scene.orbit.target == pytest.approx(scene.handles.at([scene.handles.hover])[0])


def test_an_object_without_pins_falls_onto_a_ground(scene):
    scene.set_gravity(9.81)
    assert not scene.on_ground  # its pins hold it
    scene.hold(False)
    assert scene.on_ground
    for _ in range(60):
        scene.clock.advance(1 / 30)
    assert scene.positions[:, 2].mean() > scene.solver.options.ground
    scene.hold(True)
    scene.set_gravity(0.0)
    scene.set_ground(False)
    scene.hold(False)
    assert not scene.on_ground  # it floats


def test_what_is_painted_is_stored_in_a_model_and_used_again(scene, tmp_path):
    """Around a point of the surface as it is now, less towards the radius."""
    scene.settings.grab_radius = 0.3
    vertex = int(scene.handles.corners(scene.handles.control_ids[0])[0])
    scene.paint(scene.handles.at([vertex])[0], 8.0)
    factors = scene.body.factors
    assert factors[vertex] == pytest.approx(8.0) and factors.min() == 1.0
    assert ((factors > 1.0) & (factors < 8.0)).any()
    save(replace(scene.field, stiffness=scene.body.factors), tmp_path / "m.npz")
    again = Scene(load(tmp_path / "m.npz"), "again", "cpu")
    np.testing.assert_allclose(again.body.factors, factors, rtol=1e-3)
    np.testing.assert_allclose(
        again.solver._compliances[0], scene.solver._compliances[0], rtol=1e-3
    )
    again.body.clear_paint()
    save(replace(again.field, stiffness=again.body.factors), tmp_path / "n.npz")
    assert load(tmp_path / "n.npz").stiffness is None


def test_esc_gives_back_what_yielded(scene):
    scene.body.set_material(yield_strain=0.05)
    vertex = grab_free(scene)
    scene.handles.drag_to(scene.handles.at([vertex])[0] + np.array([0.4, 0.0, 0.2]))
    for _ in range(30):
        scene.clock.advance(TIME_STEP)
    assert np.abs(scene.solver.rest_lengths - scene.solver.edges.rest_values).max() > 0.01
    scene.handles.cancel()
    for _ in range(60):
        scene.clock.advance(TIME_STEP)
    assert displacements(scene).max() < 1e-3


def test_a_ball_that_stood_still_moves_on(scene):
    """Also where the solver sleeps, as nothing is touched."""
    scene.push(np.array([3.0, 0.5, 0.5]), np.array([1.0, 0.0, 0.0]))
    for _ in range(120):
        scene.clock.advance(TIME_STEP)
    assert scene.solver.settled
    target = scene.ball.reached + np.array([0.0, 0.2, 0.0])
    scene.push_to(target)
    scene.clock.advance(TIME_STEP)
    np.testing.assert_allclose(scene.ball.reached, target)
    assert not scene.solver.settled


def test_reset_brings_pins_back_but_not_to_what_floats(scene):
    pin = int(scene.handles.pin_ids[0])
    scene.handles.set_pin(pin, False)
    assert not scene.solver.pinned[scene.pins].all()
    scene.reset()
    np.testing.assert_array_equal(scene.solver.pinned, scene.pins)
    scene.hold(False)
    scene.reset()
    assert not scene.solver.pinned.any()


def test_an_object_that_is_let_go_on_the_ground_stays_there(make_ball_field):
    """Its lowest vertices are held below the visible object, where the ground is."""
    scene = Scene(make_ball_field(3), "ball", "cpu")
    scene.floor = float(scene.field.mesh.rest_vertices[:, 2].min()) + 0.1 * scene.size
    scene.set_ground(True)
    scene.set_gravity(9.81)
    scene.hold(False)
    heights = []
    for _ in range(120):
        scene.clock.advance(1 / 60)
        heights.append(scene.solver.vertices.numpy()[:, 2].mean())
    assert max(heights) < scene.field.mesh.rest_vertices[:, 2].mean() + 0.03 * scene.size


def test_a_pose_that_was_set_is_looked_at_without_waiting_for_the_device(scene, monkeypatch):
    downloads, numpy = [], wp.array.numpy
    monkeypatch.setattr(wp.array, "numpy", lambda self: downloads.append(self) or numpy(self))
    vertices = scene.field.mesh.rest_vertices + np.float32(0.1)
    scene.solver.set_state(vertices)
    scene.revision += 1
    scene.look()
    assert downloads == []
    scene.solver.set_state(vertices + np.float32(0.1))
    np.testing.assert_array_equal(scene.positions, vertices.astype(np.float32))  # as looked at
    revision = scene.revision
    scene.look()
    assert scene.revision == revision + 1
    np.testing.assert_array_equal(scene.positions, scene.solver.vertices.numpy())


def test_a_step_waits_only_for_a_fit_that_takes_seconds(scene, monkeypatch):
    ratios = scene.solver.edges.sheet_ratios
    begun = []
    monkeypatch.setattr(type(ratios), "ready", False)
    monkeypatch.setattr(type(ratios), "begin", lambda self: begun.append(1))
    assert not scene.clock.waits and not begun  # nothing moves
    scene.solver.grab([0])
    assert scene.clock.waits and begun
    scene.clock.paused = True
    assert not scene.clock.waits
    scene.clock.paused = False
    scene.solver.set_compliances(1.0, None)
    assert not scene.clock.waits  # these need no fit
