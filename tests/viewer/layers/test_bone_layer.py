"""Bones over the picture of the object."""

import moderngl
import numpy as np
import pytest

from deformrf.core.base.paths import SHADERS
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.document import LOOSE, Scene
from deformrf.viewer.layers import BoneLayer, Canvas, gl
from deformrf.viewer.layers.bone_layer import (
    CHOSEN,
    VERTICES,
    bone_instances,
    joint_spheres,
    left_behind,
)

SIZE = 400, 300


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    for place in ([0.5, 0.5, 0.2], [0.5, 0.5, 0.5], [0.6, 0.5, 0.8]):
        made.rigging.add_joint(np.array(place))
    return made


@pytest.mark.gl
def test_a_bone_is_closed_and_its_faces_look_outwards(window):
    ends = np.random.default_rng().normal(size=(5, 2, 3)).astype(np.float32)
    ctx, shader = window[1], (SHADERS / "bones.vert.glsl").read_text()
    program = ctx.program(vertex_shader=shader, varyings=["gl_Position", "facing"])
    gl.set_uniforms(program, world_to_camera=np.eye(4), projection=np.eye(4))
    layout = (ctx.buffer(ends), "3f 3f/i", "head", "tail")
    made = ctx.buffer(reserve=4 * 7 * VERTICES * len(ends))
    ctx.vertex_array(program, [layout]).transform(made, moderngl.TRIANGLES, VERTICES, instances=5)
    vertices = np.frombuffer(made.read(), np.float32).reshape(5, -1, 3, 7)
    corners, facing = vertices[..., :3].astype(float), vertices[:, :, 0, 4:]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    inside = ends.mean(axis=1)[:, None]
    assert (((corners.mean(axis=2) - inside) * normals).sum(axis=-1) > 0.0).all()
    np.testing.assert_allclose(normals.sum(axis=1), 0.0, atol=1e-5)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    np.testing.assert_allclose(facing, normals, atol=1e-3)
    for bone, end in zip(corners.reshape(5, -1, 1, 3), ends, strict=True):
        assert (abs(bone - end).max(axis=-1).min(axis=0) < 1e-6).all()  # both are corners


def test_bones_are_drawn_far_ones_first_and_the_chosen_one_is_seen(scene):
    scene.rigging.selected = 0, "tail"
    bones = bone_instances(scene)
    assert (bones[:, 6:] == np.float32(CHOSEN)).all(axis=1).sum() == 1
    eye = scene.orbit.pose[:3, 3]
    away = np.linalg.norm(0.5 * (bones[:, :3] + bones[:, 3:6]) - eye, axis=1)
    assert away[0] >= away[1]


@pytest.mark.parametrize("selected", [None, (0, "head"), (1, "tail"), (LOOSE, "head")])
def test_each_joint_has_a_sphere_where_it_is(scene, selected):
    assert len(joint_spheres(scene)) == 3
    scene.rigging.begin_chain([0.1, 0.2, 0.3])
    scene.rigging.selected = selected
    spheres = joint_spheres(scene, [0.0, 0.0, 0.0])
    places = [joint.place for joint in scene.rigging.joints] + [np.zeros(3)]
    order = np.lexsort(spheres[:, :3].T), np.lexsort(np.float32(places).T)
    np.testing.assert_array_equal(spheres[order[0], :3], np.float32(places)[order[1]])
    names = [joint.name for joint in scene.rigging.joints] + [()]
    chosen = [names[k] == selected for k in order[1]]
    seen = (spheres[order[0], 4:] == np.float32(CHOSEN)).all(axis=1)
    np.testing.assert_array_equal(seen, chosen)
    away = np.linalg.norm(spheres[:, :3] - scene.orbit.pose[:3, 3], axis=1)
    assert (np.diff(away) <= 1e-6).all()


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


def test_bones_that_a_bent_object_has_left_behind_are_not_drawn(scene):
    assert not left_behind(scene)
    scene.posing.hold_bone(0)
    scene.posing.turn_bones([0], [[0.8, 0.6, 0.0, 0.0]])
    assert not left_behind(scene)  # the object goes along
    scene.posing.give_way()
    assert left_behind(scene)
    scene.reset()
    assert not left_behind(scene)
    scene.solver.stand(scene.positions + np.float32([0.0, 0.0, 0.1 * scene.size]))
    scene.revision += 1
    assert left_behind(scene)  # a hand has moved it
    scene.settings.tool = "bones"
    assert not left_behind(scene)  # else nobody could take one
