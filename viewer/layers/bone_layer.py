"""Draws bones over the object: octahedra from head to tail, with a sphere at each joint.

They are seen through the object.  Far ones are drawn first, and only faces that look at the
eye, so that they need no depth.  The shader makes the faces.  B bones, S joints.
"""

import moderngl
import numpy as np

from ...core.base.kept import Kept
from ..document import ENDS, LOOSE, MOST_JOINTS, joint_mask
from ..settings import OF_BONES
from . import gl
from .drawn import DrawnObject
from .handle_layer import Spheres, far_first, sphere_rows

BONE, CHOSEN, JOINT = (0.62, 0.70, 0.86), (1.0, 0.62, 0.0), (0.16, 0.28, 0.55)
DRAGGED = (0.9, 0.9, 0.2)
OPACITY = 0.85
JOINT_SIZE = 0.55  # of a handle's radius
MOST_BONES = 1024
BONE_FLOATS = 9  # head, tail, tint
VERTICES = 24  # of a bone
AWAY = 0.03  # object sizes: bones are drawn in an object that is no farther from them


class BoneLayer:
    """The bones of one object."""

    def __init__(self, ctx: moderngl.Context, drawn: DrawnObject):
        self._ctx, self._drawn = ctx, drawn
        row = "3f 3f 3f/i", "head", "tail", "tint"
        self._bones = gl.Instances(ctx, "bones", row, BONE_FLOATS, MOST_BONES)
        self._spheres = Spheres(ctx, 2 * max(MOST_BONES, MOST_JOINTS) + 2)
        self._written = Kept()  # what the buffers hold

    def draw(self, camera, clip_range, place=None) -> None:
        """Draw into the framebuffer in use; `place` is where a dragged joint would go.  [3]"""
        if not self._drawn.settings.show_bones or left_behind(self._drawn):
            return
        drawn, rigging = self._drawn, self._drawn.rigging
        eye = drawn.viewpoint.orbit.pose  # far ones are drawn first
        shown = drawn.posing.ends, eye, rigging.selected, rigging.loose, place
        self._written.of(shown, lambda: self._write(place))
        gl.blend_over(self._ctx, moderngl.CULL_FACE)
        matrices = gl.view_matrices(camera, clip_range)
        self._bones.render(moderngl.TRIANGLES, VERTICES, opacity=OPACITY, **matrices)
        self._ctx.enable_only(moderngl.BLEND)
        self._spheres.draw(camera, clip_range)

    def _write(self, place):
        self._bones.write(bone_instances(self._drawn))
        self._spheres.write(joint_spheres(self._drawn, place))

    def release(self) -> None:
        self._bones.release()
        self._spheres.release()


def left_behind(drawn: DrawnObject) -> bool:
    """Whether the object is elsewhere than its bones: a hand has bent it, or it has sprung back.

    Bones drawn there would tell something wrong.  With a tool of bones in the hand they show in
    any case: the object follows as soon as one takes one.
    """
    posing, skeleton = drawn.posing, drawn.rigging.skeleton
    if skeleton is None or drawn.settings.tool in OF_BONES:
        return False
    if posing.drives:
        return posing.shows_vertices
    at_rest = np.stack([skeleton.heads, skeleton.tails], axis=1)
    bent = abs(drawn.positions - drawn.field.mesh.rest_vertices).max(initial=0.0)
    posed = abs(posing.ends - at_rest).max(initial=0.0)
    return max(bent, posed) > AWAY * drawn.size


def bone_instances(drawn: DrawnObject):
    """Head, tail and tint of each bone, far ones first.  [B, 9] float32"""
    ends, chosen = drawn.posing.ends, drawn.rigging.chosen_bone
    bones = np.empty((len(ends), BONE_FLOATS), np.float32)
    bones[:, :6], bones[:, 6:] = ends.reshape(-1, 6), BONE
    if chosen is not None:
        bones[chosen, 6:] = CHOSEN
    return far_first(bones, 0.5 * (ends[:, 0] + ends[:, 1]), drawn.viewpoint.orbit.pose[:3, 3])


def joint_spheres(drawn: DrawnObject, place=None):
    """Rows of the joints' spheres, far ones first.  [S, 7] float32"""
    rigging, radius = drawn.rigging, drawn.handle_radius
    shown = joint_mask(rigging.skeleton)  # [B, 2], of heads and tails
    tints = np.full((*shown.shape, 3), JOINT)
    if rigging.chosen_bone is not None:
        bone, end = rigging.selected
        tints[bone, ENDS.index(end)] = CHOSEN
    spheres = [sphere_rows(drawn.posing.ends[shown], JOINT_SIZE * radius, tints[shown])]
    if rigging.loose is not None:
        tint = JOINT if rigging.selected is None or rigging.selected[0] != LOOSE else CHOSEN
        spheres.append(sphere_rows([rigging.loose], radius, tint))
    if place is not None:
        spheres.append(sphere_rows([place], radius, DRAGGED))
    spheres = np.concatenate(spheres)
    return far_first(spheres, spheres[:, :3], drawn.viewpoint.orbit.pose[:3, 3])
