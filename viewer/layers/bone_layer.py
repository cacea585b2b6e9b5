"""Draws bones over the object: octahedra from head to tail, with a sphere at each joint.

They are seen through the object.  Far ones are drawn first, and only faces that look at the
eye, so that they need no depth.  B bones, S joints.
"""

import moderngl
import numpy as np

from ...core.render import view_projection
from ..camera import pose_of
from ..rigging import LOOSE, MOST_JOINTS
from . import gl
from .handle_layer import SPHERE_FLOATS

BONE, CHOSEN, JOINT = (0.62, 0.70, 0.86), (1.0, 0.62, 0.0), (0.16, 0.28, 0.55)
DRAGGED = (0.9, 0.9, 0.2)
OPACITY = 0.85
WAIST, WIDTH = 0.15, 0.09  # where a bone is thickest and how thick, in its lengths
JOINT_SIZE = 0.55  # of a handle's radius
MOST_BONES = 1024
# Corners of an octahedron: head, tail, and four around the waist; seen from outside, faces turn
# counterclockwise.
FACES = np.array(
    [(0, 3, 2), (0, 4, 3), (0, 5, 4), (0, 2, 5), (1, 2, 3), (1, 3, 4), (1, 4, 5), (1, 5, 2)]
)
FLOATS = 9  # of a vertex: position, normal, tint
VERTICES = FACES.size  # of a bone


class BoneLayer:
    """The bones of one scene."""

    def __init__(self, ctx: moderngl.Context, scene):
        self._ctx, self._scene = ctx, scene
        self._buffer = ctx.buffer(reserve=4 * FLOATS * VERTICES * MOST_BONES, dynamic=True)
        layout = (self._buffer, "3f 3f 3f", "position", "normal", "tint")
        self._bones = ctx.vertex_array(gl.program(ctx, "bones"), [layout])
        most = 2 * max(MOST_BONES, MOST_JOINTS) + 2
        self._sphere_buffer = ctx.buffer(reserve=4 * SPHERE_FLOATS * most, dynamic=True)
        layout = (self._sphere_buffer, "3f 1f 3f/i", "center", "radius", "tint")
        self._spheres = ctx.vertex_array(gl.program(ctx, "handles"), [layout])
        self._ends = self._state = None  # what the buffers hold
        self._vertex_count = self._sphere_count = 0

    def draw(self, camera, clip_range, place=None) -> None:
        """Draw into the framebuffer in use; `place` is where a dragged joint would go.  [3]"""
        scene = self._scene
        if not scene.settings.show_bones:
            return
        self._write(place)
        if not self._sphere_count:
            return
        view = np.linalg.inv(camera.camera_to_world)
        projection = view_projection(camera, *clip_range) @ camera.camera_to_world
        matrices = {"world_to_camera": view, "projection": projection}
        self._ctx.enable_only(moderngl.BLEND | moderngl.CULL_FACE)
        gl.blend_over(self._ctx)
        if self._vertex_count:
            gl.set_uniforms(self._bones.program, opacity=OPACITY, **matrices)
            self._bones.render(moderngl.TRIANGLES, vertices=self._vertex_count)
        self._ctx.enable_only(moderngl.BLEND)
        gl.set_uniforms(
            self._spheres.program,
            depth_terms=gl.depth_terms(*clip_range, camera.parallel),
            bias=0.0,
            pixel_angle=1.0 / camera.focal,
            opacity=1.0,
            parallel=camera.parallel,
            **matrices,
        )
        self._spheres.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=self._sphere_count)

    def _write(self, place):
        """Bring what is drawn to the buffers, if it has changed."""
        scene, rigging = self._scene, self._scene.rigging
        state = (
            (rigging.selected, scene.handle_radius),
            pose_of(scene.orbit)[:3, 3].tobytes(),  # far ones are drawn first
            [None if one is None else np.asarray(one).tobytes() for one in (rigging.loose, place)],
        )
        ends = scene.posing.ends
        if self._ends is ends and self._state == state:
            return
        self._ends, self._state = ends, state
        faces, spheres = bone_faces(scene), joint_spheres(scene, place)
        self._vertex_count, self._sphere_count = len(faces), len(spheres)
        if len(faces):
            self._buffer.write(faces)
        if len(spheres):
            self._sphere_buffer.write(spheres)

    def release(self) -> None:
        for part in (self._bones, self._buffer, self._spheres, self._sphere_buffer):
            part.release()


def _far_first(scene, places):
    away = np.linalg.norm(places - pose_of(scene.orbit)[:3, 3], axis=1)
    return np.argsort(-away, kind="stable")


def bone_faces(scene):
    """Position, normal and tint of the corners of all bones' faces.  [24 B, 9] float32"""
    ends = scene.posing.ends
    order = _far_first(scene, ends.mean(axis=1))
    corners = octahedra(ends[order])[:, FACES]  # [B, 8, 3, 3]
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = normals / np.maximum(length, 1e-30)
    faces = np.empty((*corners.shape[:3], FLOATS), np.float32)
    faces[..., :3], faces[..., 3:6], faces[..., 6:] = corners, normals[:, :, None], BONE
    faces[order == scene.rigging.chosen_bone, ..., 6:] = CHOSEN
    return faces.reshape(-1, FLOATS)


def octahedra(ends):
    """The corners of bones from heads to tails [B, 2, 3]: both, and four between.  [B, 6, 3]"""
    head, tail = ends[:, 0], ends[:, 1]
    along = tail - head
    length = np.linalg.norm(along, axis=1, keepdims=True)
    axis = np.where(length > 0.0, along / np.maximum(length, 1e-30), (0.0, 0.0, 1.0))
    helper = np.eye(3)[abs(axis).argmin(axis=1)]
    side = np.cross(axis, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(axis, side)
    middle, width = head + WAIST * along, WIDTH * length
    around = [middle + width * way for way in (side, other, -side, -other)]
    return np.stack([head, tail, *around], axis=1)


def joint_spheres(scene, place=None):
    """Center, radius and tint of each joint's sphere, far ones first.  [S, 7] float32"""
    rigging = scene.rigging
    joints = rigging.joints
    rows = [[*one.place, JOINT_SIZE * scene.handle_radius, *JOINT] for one in joints]
    for row, joint in zip(rows, joints, strict=True):
        if joint.name == rigging.selected:
            row[4:] = CHOSEN
        if joint.bone == LOOSE:
            row[3] = scene.handle_radius
    if place is not None:
        rows.append([*place, scene.handle_radius, *DRAGGED])
    spheres = np.array(rows, np.float32).reshape(-1, SPHERE_FLOATS)
    return spheres[_far_first(scene, spheres[:, :3])]
