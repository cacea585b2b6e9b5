"""The bundled model: bent by a drag and pinned there, it stays; under its weight it stands."""

import numpy as np
import pytest

from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.core.deform import TIME_STEP
from deformrf.core.field import load
from deformrf.viewer.document import EARTH, Scene


@pytest.fixture(scope="module")
def field():
    return load(DEFAULT_MODEL)


@pytest.mark.parametrize("trial", range(6))
def test_a_pinned_pose_stays_without_a_jerk(field, trial):
    """Bent by a quarter or a half of its size; from 3 s on no frame moves anything by 0.1 %.

    Before that, the guard of inverted tets may end twice, which moves the body.
    """
    random = np.random.default_rng()
    scene = Scene(field, "model", "cpu")
    vertex, way = int(random.choice(scene.handles.control_ids)), random.normal(size=3)
    way *= random.choice([0.25, 0.5]) * scene.size / np.linalg.norm(way)
    start = scene.handles.at([vertex])[0]
    scene.handles.grab(vertex)
    for frame in range(90):
        scene.handles.drag_to(start + way * min(1.0, (frame + 1) / 60))
        scene.clock.advance(TIME_STEP)
    scene.handles.pin_grab()
    for frame in range(480):
        before = scene.solver.vertices.numpy().copy()
        scene.solver.step(TIME_STEP)
        assert not scene.solver.rescue.running
        moved = np.linalg.norm(scene.solver.vertices.numpy() - before, axis=1).max()
        assert frame < 180 or moved < 1e-3 * scene.size


def test_the_model_stands_under_its_weight(field):
    """Gravity comes suddenly; for a minute it neither falls nor is rescued."""
    scene = Scene(field, "model", "cpu")
    scene.set_gravity(EARTH)
    for _ in range(3600):
        scene.solver.step(TIME_STEP)
        assert not scene.solver.rescue.running
    away = np.linalg.norm(scene.solver.vertices.numpy() - field.mesh.rest_vertices, axis=1)
    assert 0.0 < away[np.unique(field.mesh.tets)].max() < 0.1 * scene.size
    assert scene.solver.rescue.held_by is None
