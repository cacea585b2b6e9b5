"""Bones under the mouse: joints are placed and moved, bones turned, and reached with.

Pixels are the image's, x to the right, y down.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ...wings.rig import BonePose, reach, turned
from ..camera import project, ray
from ..document import HEAD, TAIL, Joint, Matter
from .constraints import MOVE, SCALE, TURN, Constraint
from .drags import BEHIND, is_ahead, miss_of
from .gizmo import chosen_joint, is_root, own_axes
from .under_mouse import surface_at

PICK = 9.0  # points from a joint's middle, or from a bone's line, where the mouse has it
AWAY = 1e-3  # object sizes: joints are placed on an object that is no farther from rest


@dataclass
class BoneDrag:
    """A drag of a joint or a bone."""

    joint: Joint  # as it was when the button went down
    press: np.ndarray  # where that was, or where the present kind began [pixels]  [2]
    miss: np.ndarray  # from the joint to the press [pixels]  [2]
    moves_joint: bool  # of the skeleton, instead of posing; a key may change the tool meanwhile
    start: BonePose | None = None  # of the bones, when the present kind began; None: a click so far
    kind: str = MOVE  # a bone reaches; or TURN
    held: Constraint = field(default_factory=Constraint)
    angle: float = 0.0  # so far [radians]
    amount: float | None = None  # so far: object sizes or degrees

    @property
    def line(self) -> str:
        """What it does, in words."""
        return self.held.words(self.kind, self.amount)


class BoneTool:
    """What the tools "joints" and "bones" do, from one event of the mouse to the next."""

    def __init__(self, scene, depth_image: Callable, log: Callable, say: Callable):
        """Take what Controls takes."""
        self.scene = scene
        self.drag: BoneDrag | None = None
        self.place = None  # where a joint that is dragged would go  [3]
        self._depth_image, self._log, self._say = depth_image, log, say
        self._matter = None  # what was deleted, and the Matter that is left, once it is needed
        scene.rigging.say = say

    # -- what is under the mouse ---------------------------------------------------------

    def pick(self, camera, pixel, ratio: float) -> Joint | None:
        """The joint under a pixel; else the bone, by its tail.  `ratio`: pixels per point."""
        scene = self.scene
        joints = scene.rigging.joints
        if not joints or not scene.settings.show_bones:
            return None
        pixels, t = project(camera, np.array([joint.place for joint in joints]))
        away = np.nan_to_num(np.linalg.norm(pixels - pixel, axis=1), nan=np.inf)
        near = np.flatnonzero(away <= PICK * ratio)
        if len(near):
            return joints[near[np.lexsort((t[near], np.round(away[near] / ratio)))[0]]]
        if scene.settings.tool == "joints":
            return None
        return self._pick_bone(camera, pixel, ratio)

    def _pick_bone(self, camera, pixel, ratio):
        ends = self.scene.posing.ends
        heads, _ = project(camera, ends[:, 0])
        tails, _ = project(camera, ends[:, 1])
        along = tails - heads
        length = np.maximum((along**2).sum(axis=1), 1e-12)
        share = np.clip(((pixel - heads) * along).sum(axis=1) / length, 0.0, 1.0)
        away = np.linalg.norm(heads + share[:, None] * along - pixel, axis=1)
        away = np.nan_to_num(away, nan=np.inf)
        if not len(away) or away.min() > PICK * ratio:
            return None
        bone = int(away.argmin())
        return Joint(bone, "body", ends[bone, 1])

    # -- a gesture -----------------------------------------------------------------------

    def press(self, camera, pixel, ratio: float) -> bool:
        """The left button goes down; whether it has a joint or a bone."""
        joint = self.pick(camera, pixel, ratio)
        if joint is None:
            return False
        self._begin(camera, pixel, joint, TURN if joint.end == "body" else MOVE)
        self.scene.rigging.selected = joint.bone, TAIL if joint.end == "body" else joint.end
        return True

    def take(self, camera, pixel, kind: str) -> bool:
        """A gizmo, or a key, takes what is chosen; whether it can."""
        joint, on_joints = chosen_joint(self.scene), self.scene.settings.tool == "joints"
        if joint is None or (joint.bone < 0 and not on_joints):
            self._say(f"nothing to {kind}: choose a {'joint' if on_joints else 'bone'} by a click")
            return False
        if kind == SCALE or (kind == TURN and on_joints):
            self._say(f"{kind}: not with a {'joint' if on_joints else 'bone'}")
            return False
        if not on_joints and not (kind == MOVE and is_root(self.scene, joint)):
            joint = Joint(joint.bone, TAIL, self.scene.posing.ends[joint.bone, 1])
        if not is_ahead(camera, joint.place):
            self._say(BEHIND)
            return False
        self._begin(camera, pixel, joint, kind)
        return True

    def _begin(self, camera, pixel, joint, kind):
        miss, moves_joint = (
            miss_of(camera, pixel, joint.place),
            self.scene.settings.tool == "joints",
        )
        self.drag = BoneDrag(joint, pixel, miss, moves_joint, kind=kind)
        if joint.bone >= 0:
            self.drag.held.own = own_axes(self.scene, joint.bone)

    def move(self, camera, pixel, ratio: float) -> None:
        """The mouse moves on, farther than in a click."""
        scene, drag = self.scene, self.drag
        if drag.moves_joint:
            now = drag.joint.place if self.place is None else self.place
            self.place = self._led(camera, pixel, now)
            return
        if drag.joint.bone < 0:
            return
        if drag.start is None:
            if drag.joint.end == HEAD and not is_root(scene, drag.joint):
                self._say("this head stays where it is: drag a bone, or a tip")
                self.drag = None
                return
            scene.posing.hold_bone(drag.joint.bone)
            drag.start = scene.posing.current
            self._log("hold_bone", bone=drag.joint.bone, kind=drag.kind)
        if not scene.posing.drives:  # a reset lets go while the button is still down
            return
        skeleton, bone = scene.rigging.skeleton, drag.joint.bone
        if drag.kind == TURN:
            scene.posing.aim(turned(skeleton, drag.start, bone, self._turn(camera, pixel, ratio)))
            return
        aim = self._led(camera, pixel, drag.joint.place)
        if drag.joint.end == HEAD:  # all that hangs on the root goes along
            translations = drag.start.translations.copy()
            translations[bone] = aim
            scene.posing.aim(replace(drag.start, translations=translations))
        else:
            scene.posing.aim(reach(skeleton, drag.start, bone, aim))

    def _led(self, camera, pixel, now):
        """Where what is dragged goes.  `now`: where it is.  Both [3]"""
        drag, size = self.drag, self.scene.size
        start = drag.joint.place
        place = drag.held.place(camera, pixel - drag.miss, start, now, size)
        if not np.isfinite(place).all():
            return now
        drag.amount = drag.held.length(place - start, size)
        return place

    def _turn(self, camera, pixel, ratio):
        """By which the bone is turned about its head, axis times angle.  [3]"""
        drag, head = self.drag, self.scene.posing.ends[self.drag.joint.bone, 0]
        drag.angle = drag.held.angle(camera, head, drag.press, pixel, ratio, drag.angle)
        drag.amount = math.degrees(drag.angle)
        return drag.angle * drag.held.turn_axis(camera)

    def release(self) -> None:
        """The button goes up: a joint stays where it was dragged to."""
        rigging, drag = self.scene.rigging, self.drag
        if self.place is not None:
            rigging.move_joint(drag.joint.bone, drag.joint.end, self.place)
            self._log("move_joint", bone=drag.joint.bone, end=drag.joint.end, to=self.place)
        elif drag is not None and drag.start is not None:
            self.scene.posing.follow()
            self._log("pose", bone=drag.joint.bone)
        elif drag is not None:
            self._log("select_joint", bone=drag.joint.bone, end=drag.joint.end)
        self.drag = self.place = None

    def cancel(self) -> None:
        """Give up the gesture: the bones are as they were."""
        drag, scene = self.drag, self.scene
        self.drag = self.place = None
        began = drag is not None and drag.start is not None
        if began and scene.journal.undoes == "pose a bone":
            scene.undo()

    def turn_into(self, kind: str, camera, pixel) -> None:
        """Let the drag in progress turn the bone, or reach with its tip."""
        drag, scene = self.drag, self.scene
        if kind == SCALE or drag.joint.bone < 0 or drag.moves_joint:
            self._say(f"{kind}: not with a bone or a joint")
            return
        if drag.joint.end != TAIL:
            self._say("a bone's body turns it")
            return
        if drag.start is not None:
            scene.posing.follow()
            drag.start = scene.posing.current
        drag.joint = Joint(drag.joint.bone, TAIL, scene.posing.ends[drag.joint.bone, 1])
        drag.press = np.array(pixel, float)
        drag.miss = miss_of(camera, pixel, drag.joint.place)
        drag.kind = MOVE if drag.kind == kind == TURN else kind
        drag.angle, drag.amount = 0.0, None
        drag.held.text, drag.held.tangent = "", None

    # -- joints --------------------------------------------------------------------------

    def click(self, camera, pixel) -> None:
        """Place a joint in the middle of the matter under the mouse."""
        scene = self.scene
        moved = abs(scene.positions - scene.field.mesh.rest_vertices).max()
        if moved > AWAY * scene.size:
            scene.reset()
            self._say("joints are placed on the object at rest, where it is now: click again")
            return
        surface = surface_at(camera, self._depth_image(), pixel)
        if surface is None:
            scene.rigging.selected = None
            return
        if self._matter is None or self._matter[0] is not scene.cuts.removed:
            self._matter = scene.cuts.removed, Matter(scene.cuts.field)
        start, way = ray(camera, pixel)
        found = self._matter[1].middle(start, way, float((surface - start) @ way))
        if found is None:
            self._say("there is nothing solid under the mouse")
            return
        try:
            scene.rigging.add_joint(found[0])
        except ValueError as error:  # there are too many
            self._say(str(error))
            return
        self._log("joint", place=found[0], bones=scene.rigging.bone_count)

    def delete(self) -> bool:
        """Delete the chosen joint; whether there was one."""
        rigging = self.scene.rigging
        if rigging.selected not in [joint.name for joint in rigging.joints]:
            return False
        rigging.delete_joint(*rigging.selected)
        rigging.selected = None
        return True
