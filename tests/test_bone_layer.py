"""Bones over the picture of the object."""

import numpy as np
import pytest

from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.layers import Canvas
from deformrf.viewer.layers.bone_layer import (
    CHOSEN,
    FACES,
    BoneLayer,
    bone_faces,
    joint_spheres,
    octahedra,
)
from deformrf.viewer.scene import Scene

SIZE = 400, 300


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    for place in ([0.5, 0.5, 0.2], [0.5, 0.5, 0.5], [0.6, 0.5, 0.8]):
        made.rigging.add_joint(np.array(place))
    return made


def test_a_bone_is_closed_and_its_faces_look_outwards():
    ends = np.random.default_rng().normal(size=(5, 2, 3))
    corners = octahedra(ends)[:, FACES]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    inside = ends.mean(axis=1)[:, None]
    assert (((corners.mean(axis=2) - inside) * normals).sum(axis=-1) > 0.0).all()
    np.testing.assert_allclose(normals.sum(axis=1), 0.0, atol=1e-12)


def test_bones_are_drawn_far_ones_first_and_the_chosen_one_is_seen(scene):
    scene.rigging.selected = 0, "tail"
    faces = bone_faces(scene).reshape(2, 24, 9)
    chosen = (faces[:, 0, 6:] == np.float32(CHOSEN)).all(axis=1)
    assert chosen.sum() == 1
    eye = orbits.pose_of(scene.orbit)[:3, 3]
    away = np.linalg.norm(faces[:, :, :3].mean(axis=1) - eye, axis=1)
    assert away[0] >= away[1]
    assert len(joint_spheres(scene)) == 3
    assert len(joint_spheres(scene, [0.0, 0.0, 0.0])) == 4


@pytest.mark.gl
@pytest.mark.parametrize("parallel", [False, True])
def test_bones_are_where_they_are_and_seen_through_the_object(scene, window, parallel):
    from dataclasses import replace

    scene.orbit = replace(scene.orbit, parallel=parallel)
    camera, clips = orbits.camera_of(scene.orbit, *SIZE), orbits.clip_range(scene.orbit)
    canvas, layer = Canvas(window[1]), BoneLayer(window[1], scene)
    canvas.use(SIZE)
    window[1].clear(0, 0, 0, 1, depth=0.0)  # all is behind something
    layer.draw(camera, clips)
    drawn = canvas.read().max(axis=-1) > 40
    places = scene.posing.ends.mean(axis=1)
    pixels, _ = picking.project(camera, places)
    for x, y in pixels.astype(int):
        assert drawn[y, x]
    assert 0.002 < drawn.mean() < 0.1
    scene.settings.show_bones = False
    window[1].clear(0, 0, 0, 1)
    layer.draw(camera, clips)
    assert not canvas.read().any()
    layer.release()
