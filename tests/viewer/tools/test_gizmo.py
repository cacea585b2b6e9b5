"""The gizmo's parts are where the picture has its axes, and are taken where they show."""

import numpy as np
import pytest
from random_hands import random_axes, random_camera

from deformrf.viewer.camera import pixels_per_unit, project
from deformrf.viewer.document import Scene
from deformrf.viewer.tools import Controls
from deformrf.viewer.tools import gizmo as g


def random_gizmo(random, kind):
    return g.Gizmo(kind, random.uniform(0.4, 0.6, 3), random_axes(random))


def test_an_arrow_lies_on_its_axis_and_is_as_long_as_it_is_to_be():
    random = np.random.default_rng()
    for _ in range(100):
        camera, ratio = random_camera(random)
        gizmo = random_gizmo(random, "move")
        depth = (gizmo.pivot - camera.position) @ camera.forward
        length = g.LENGTH * ratio / pixels_per_unit(camera, depth)
        shares = np.array([g.GAP, 0.6, 1.0])
        for part in g.parts_of(gizmo, camera, ratio):
            if not part.across:
                way = length * np.outer(shares, gizmo.axes[:, part.axis])
                np.testing.assert_allclose(part.line, project(camera, gizmo.pivot + way)[0])


@pytest.mark.parametrize("kind", ["move", "turn", "scale"])
def test_a_part_is_taken_where_it_shows_and_nothing_far_from_all(kind):
    random = np.random.default_rng()
    for _ in range(50):
        camera, ratio = random_camera(random)
        parts = g.parts_of(random_gizmo(random, kind), camera, ratio)
        assert len(parts) >= 3
        for part in parts:
            taken = g.part_at(parts, part.grip, ratio)
            assert taken is part or taken.away(part.grip) <= part.away(part.grip) + 1e-9
            assert part.away(part.grip) < 1e-6
        far = np.concatenate([part.line for part in parts]).max(axis=0) + 2.0 * g.REACH * ratio
        assert g.part_at(parts, far, ratio) is None


def test_rings_show_the_half_that_is_nearer_to_the_eye():
    random = np.random.default_rng()
    camera, ratio = random_camera(random)
    gizmo = random_gizmo(random, "turn")
    parts = g.parts_of(gizmo, camera, ratio)
    assert [part.name for part in parts] == ["x", "y", "z", "view"]
    for part in parts[:3]:
        assert len(part.line) <= g.PIECES // 2 + 6
        steps = np.linalg.norm(np.diff(part.line, axis=0), axis=1)
        assert steps.max() < 1.5 * g.LENGTH * ratio * g.RING_STEP  # nothing is skipped


def test_behind_the_eye_there_is_none():
    random = np.random.default_rng()
    camera, ratio = random_camera(random)
    gizmo = random_gizmo(random, "move")
    behind = camera.position - 10.0 * camera.forward
    assert g.parts_of(g.Gizmo("move", behind, gizmo.axes), camera, ratio) == []


def test_the_best_rotation_is_found_also_with_noise_and_after_a_reflection():
    random = np.random.default_rng()
    for _ in range(50):
        rest, turn = random.normal(size=(8, 3)), random_axes(random)
        now = rest @ turn.T + random.normal(size=3)
        np.testing.assert_allclose(g.best_rotation(rest, now), turn, atol=1e-9)
        found = g.best_rotation(rest, random.normal(size=(8, 3)))
        np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(found) == pytest.approx(1.0)
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(g.best_rotation(line, line), np.eye(3))
    np.testing.assert_array_equal(g.best_rotation(line[:1], line[:1]), np.eye(3))


def test_what_is_selected_has_one_where_it_is(ball):
    scene = Scene(ball, "ball", "cpu")
    controls = Controls(scene, lambda: None, lambda *_, **__: None)
    assert controls.tool.gizmo is None
    ids = [int(one) for one in scene.handles.control_ids[:3]]
    scene.handles.select(ids)
    np.testing.assert_array_equal(controls.tool.gizmo.pivot, scene.handles.at(ids).mean(axis=0))
    turn = random_axes(np.random.default_rng())
    scene.solver.set_state((scene.positions @ turn.T).astype(np.float32))
    scene.revision += 1
    scene.settings.own_axes = True
    np.testing.assert_allclose(controls.tool.gizmo.axes, turn, atol=1e-5)
    for name, value in (("gizmo", "off"), ("tool", "box"), ("show_handles", False)):
        before = getattr(scene.settings, name)
        setattr(scene.settings, name, value)
        assert controls.tool.gizmo is None
        setattr(scene.settings, name, before)
