"""What can be taken hold of: control points, pins and their patches."""

from types import SimpleNamespace

import numpy as np
import pytest
from displaced import displacements

from deformrf.core.deform import TIME_STEP
from deformrf.core.geometry import TetMesh
from deformrf.viewer.document import Scene


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


def grab_free(scene):
    vertex = int(scene.handles.control_ids[0])
    scene.handles.grab(vertex)
    return vertex


def test_a_drag_takes_along_what_is_within_the_radius_as_one_body(scene):
    scene.settings.grab_radius = 0.3
    vertex = grab_free(scene)
    rest = scene.positions.copy()
    ids = scene.handles.grabbed.ids
    assert len(ids) > 1
    scene.handles.drag_to(scene.handles.at([vertex], rest)[0] + [0.1, 0.0, 0.0])
    scene.clock.advance(TIME_STEP)
    moved = scene.positions[ids] - rest[ids]
    assert moved == pytest.approx(np.tile([0.1, 0, 0], (len(ids), 1)), abs=1e-5)


def test_a_soft_drag_is_followed_but_not_exactly_and_weaker_towards_the_radius(scene):
    scene.settings.soft_grab, scene.settings.grab_radius = True, 0.3
    vertex = grab_free(scene)
    rest = scene.positions.copy()
    way = np.array([0.1, 0.0, 0.0], np.float32)
    scene.handles.drag_to(scene.handles.at([vertex], rest)[0] + way)
    for _ in range(120):
        scene.clock.advance(TIME_STEP)
    moved = scene.positions - rest
    (gone,) = scene.handles.at([vertex], moved)
    assert 0.9 < gone[0] / way[0] < 1.01
    ids = scene.handles.grabbed.ids
    away = np.linalg.norm(rest[ids] - scene.handles.at([vertex], rest), axis=1)
    followed = moved[ids, 0] / way[0]
    assert followed[away > 0.2 * scene.size].mean() < followed[away < 0.1 * scene.size].mean()
    scene.handles.release()
    for _ in range(300):
        scene.clock.advance(TIME_STEP)
    assert displacements(scene).max() < 0.01


def test_a_soft_drag_of_one_vertex_to_far_away_tears_nothing(scene):
    scene.settings.soft_grab, scene.settings.grab_radius = True, 0.0
    vertex = grab_free(scene)
    assert set(scene.handles.grabbed.ids) == set(scene.handles.corners(vertex))
    scene.handles.drag_to(scene.handles.at([vertex])[0] + np.float32(100.0))
    for _ in range(60):
        scene.clock.advance(TIME_STEP)
    assert displacements(scene).max() < 3.0


def test_a_pin_that_was_freed_can_be_dragged_and_pinned_again(scene):
    pin = int(scene.handles.pin_ids[0])
    assert pin not in scene.handles.control_ids
    scene.handles.set_pin(pin, False)
    assert pin in scene.handles.control_ids and pin not in scene.handles.pin_ids
    scene.handles.set_pin(pin, True)
    assert pin not in scene.handles.control_ids and pin in scene.handles.pin_ids


def test_a_speck_has_no_handles(ball):
    """What floats above the object would be its top, and nothing of the object would move."""
    mesh, count = ball.mesh, 2 * ball.mesh.vertex_count  # two balls side by side
    speck = mesh.rest_vertices[mesh.tets[0]] * 0.2 + [0.4, 0.4, 1.4]
    rest = np.concatenate([mesh.rest_vertices, np.add(mesh.rest_vertices, [1.0, 0.0, 0.0]), speck])
    tets = np.concatenate([mesh.tets, mesh.tets + count // 2, count + np.arange(4)[None]])
    tets = tets.astype(np.int32)
    field = SimpleNamespace(
        mesh=TetMesh(rest, np.zeros(rest.shape, np.int32), tets),
        meta={},
        stiffness=None,
        rig_arrays=None,
    )
    scene = Scene(field, "ball with a speck", "cpu")
    assert len(scene.handles.control_ids) > 10 and scene.handles.points.corners.max() < count


@pytest.mark.parametrize("soft", [False, True])
def test_a_drag_is_pinned_with_its_patch_where_it_is(scene, soft):
    scene.settings.soft_grab, scene.settings.grab_radius = soft, 0.3
    vertex = grab_free(scene)
    held = scene.handles.grabbed.ids
    scene.handles.drag_to(scene.handles.grabbed.target.place + np.array([0.1, 0.0, 0.1]))
    for _ in range(30):
        scene.clock.advance(TIME_STEP)
    before = scene.positions.copy()
    scene.handles.pin_grab()
    patch = scene.solver.pinned & ~scene.pins
    assert scene.handles.grabbed is None and patch[scene.handles.corners(vertex)].all()
    assert 1 < patch.sum() <= len(held) and set(np.flatnonzero(patch)) <= set(held)
    for _ in range(30):
        scene.clock.advance(TIME_STEP)
    np.testing.assert_allclose(scene.positions[patch], before[patch], atol=1e-6)


@pytest.mark.parametrize("end", ["release", "cancel", "undo", "pin", "pose"])
def test_a_place_is_held_by_a_point_that_passes_unless_it_is_pinned_or_posed(scene, end):
    handles, count = scene.handles, len(scene.handles.points)
    place = 0.5 * handles.points.at(scene.positions)[:2].sum(axis=0)
    handles.grab_place(place)
    (handle,) = handles.grabbed.handles
    np.testing.assert_allclose(handles.at([handle])[0], place, atol=0.2 * scene.size)
    start = handles.at([handle])[0]
    handles.drag_to(start + np.array([0.05, 0.0, 0.0]))
    scene.clock.advance(TIME_STEP)
    np.testing.assert_allclose(handles.at([handle])[0] - start, [0.05, 0.0, 0.0], atol=1e-5)
    handles.select([0, handle])
    if end == "pin":
        handles.pin_grab()
    elif end == "pose":
        scene.settings.hand = "pose"
        handles.let_go()
    else:
        getattr(scene if end == "undo" else handles, end)()
    stays = end in ("pin", "pose")
    assert len(handles.points) == count + stays and handles.grabbed is None
    assert handles.selected == [0, handle][: 1 + stays]
    assert not stays or handles.is_pinned(handle)
    scene.undo()
    assert len(handles.points) == count


def test_a_patch_is_freed_as_one_and_other_pins_stay(scene):
    first, second = (int(i) for i in scene.handles.control_ids[[0, 1]])
    scene.handles.set_pin(first, True)
    one = scene.solver.pinned & ~scene.pins
    scene.handles.set_pin(second, True)
    assert (scene.solver.pinned & ~scene.pins).sum() > one.sum()
    scene.handles.set_pin(int(np.flatnonzero(one)[-1]), False)  # any of them
    pinned, corners = scene.solver.pinned, scene.handles.corners
    assert not pinned[corners(first)].any() and pinned[corners(second)].all()
    assert scene.solver.pinned[scene.pins].all()
    scene.handles.set_pin(int(corners(second)[0]), False)
    np.testing.assert_array_equal(scene.solver.pinned, scene.pins)
