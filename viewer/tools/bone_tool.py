"""Bones under the mouse: joints are placed and moved, bones turned, and reached with."""

from dataclasses import dataclass, replace

import numpy as np

from ...wings.rig import reach, turned
from ..camera import away_from_lines, project, ray
from ..document import HEAD, TAIL, Joint, Matter
from .drags import BEHIND, MOVE, SCALE, TURN, Drag, is_ahead, miss_of
from .gizmo import Gizmo
from .tool import DragTool

PICK = 9.0  # points from a joint's middle, or from a bone's line, where the mouse has it
AWAY = 1e-3  # object sizes: joints are placed on an object that is no farther from rest


@dataclass(kw_only=True)
class BoneDrag(Drag):
    """A drag of a joint or a bone, which reaches or turns; `before` is None: a click so far."""

    joint: Joint  # as it was when the button went down
    moves_joint: bool  # of the skeleton, instead of posing; a key may change the tool meanwhile

    is_plain = False  # the gizmo, or how far it has turned, is shown


class BoneTool(DragTool):
    """Turns bones, reaches with their tips, and moves roots.

    Attributes:
        place: Where a joint that is dragged would go, or None.  [3]
    """

    hint = "Drag a bone: turn it.  Its tip: reach.  A root's head: move all.  Esc: back to Bend"

    place = None
    on_joints = False  # places joints, instead of posing bones

    # -- what is under the mouse ---------------------------------------------------------

    def joint_at(self, pixel) -> Joint | None:
        """The joint under a pixel; else the bone, by its tail."""
        scene, camera, ratio = self.scene, self.view.camera, self.view.ratio
        joints = scene.rigging.joints
        if not joints or not scene.settings.show_bones:
            return None
        pixels, t = project(camera, np.array([joint.place for joint in joints]))
        away = np.nan_to_num(np.linalg.norm(pixels - pixel, axis=1), nan=np.inf)
        near = np.flatnonzero(away <= PICK * ratio)
        if len(near):
            return joints[near[np.lexsort((t[near], np.round(away[near] / ratio)))[0]]]
        ends = self.scene.posing.ends
        heads, _ = project(camera, ends[:, 0])
        tails, _ = project(camera, ends[:, 1])
        away = np.nan_to_num(away_from_lines(pixel, heads, tails), nan=np.inf)
        if self.on_joints or not len(away) or away.min() > PICK * ratio:
            return None
        bone = int(away.argmin())
        return Joint(bone, "body", ends[bone, 1])

    # -- a gesture -----------------------------------------------------------------------

    def press(self, pixel, modifiers) -> bool:
        joint = self.joint_at(pixel)
        if joint is None:
            return False
        self._begin(pixel, joint, TURN if joint.end == "body" else MOVE)
        self.scene.rigging.selected = joint.bone, TAIL if joint.end == "body" else joint.end
        return True

    def take(self, kind) -> bool:
        joint, on_joints = self._chosen, self.on_joints
        what = "joint" if on_joints else "bone"
        if joint is None or (joint.bone < 0 and not on_joints):
            self.view.say(f"nothing to {kind}: choose a {what} by a click")
            return False
        if kind == SCALE or (kind == TURN and on_joints):
            self.view.say(f"{kind}: not with a {what}")
            return False
        if not on_joints and not (kind == MOVE and self._is_root(joint)):
            joint = Joint(joint.bone, TAIL, self.scene.posing.ends[joint.bone, 1])
        if not is_ahead(self.view.camera, joint.place):
            self.view.say(BEHIND)
            return False
        self._begin(self.view.press_at, joint, kind)
        return True

    def _begin(self, pixel, joint, kind):
        miss, self.mode = miss_of(self.view.camera, pixel, joint.place), "bone"
        self.drag = BoneDrag(pixel, miss, kind, joint=joint, moves_joint=self.on_joints)
        if joint.bone >= 0:
            self.drag.held.own = self.scene.posing.axes(joint.bone)

    @property
    def waits(self) -> bool:
        return self.drag is not None and self.drag.before is None and self.place is None

    def move(self, before, pixel) -> bool:
        if self.drag is not None:
            self.follow(pixel)
        return True

    def follow(self, pixel) -> None:
        scene, drag = self.scene, self.drag
        if drag.moves_joint:
            now = drag.joint.place if self.place is None else self.place
            self.place = drag.led(self.view.camera, pixel, drag.joint.place, now, scene.size)
            return
        if drag.joint.bone < 0:
            return
        if drag.before is None:
            if drag.joint.end == HEAD and not self._is_root(drag.joint):
                self.view.say("this head stays where it is: drag a bone, or a tip")
                self.drag = None
                return
            scene.posing.hold_bone(drag.joint.bone)
            drag.before = scene.posing.current
            self.view.log("hold_bone", bone=drag.joint.bone, kind=drag.kind)
        if not scene.posing.drives:  # a reset lets go while the button is still down
            return
        skeleton, bone = scene.rigging.skeleton, drag.joint.bone
        camera, place = self.view.camera, drag.joint.place
        if drag.kind == TURN:
            turn = drag.turn(camera, scene.posing.ends[bone, 0], pixel, self.view.ratio)
            scene.posing.aim(turned(skeleton, drag.before, bone, turn))
            return
        aim = drag.led(camera, pixel, place, place, scene.size)
        if drag.joint.end == HEAD:  # all that hangs on the root goes along
            translations = drag.before.translations.copy()
            translations[bone] = aim
            scene.posing.aim(replace(drag.before, translations=translations))
        else:
            scene.posing.aim(reach(skeleton, drag.before, bone, aim))

    def release(self, pixel, clicked, modifiers) -> None:
        self.finish()

    def finish(self) -> None:
        """A joint stays where it was dragged to."""
        rigging, drag = self.scene.rigging, self.drag
        if self.place is not None:
            rigging.move_joint(drag.joint.bone, drag.joint.end, self.place)
            self.view.log("move_joint", bone=drag.joint.bone, end=drag.joint.end, to=self.place)
        elif drag is not None and drag.before is not None:
            self.scene.posing.follow()
            self.view.log("pose", bone=drag.joint.bone)
        elif drag is not None:
            self.view.log("select_joint", bone=drag.joint.bone, end=drag.joint.end)

    def end(self) -> None:
        self.mode, self.drag, self.place = "", None, None

    def cancel(self) -> None:
        drag, scene = self.drag, self.scene
        began = drag is not None and drag.before is not None
        if began and scene.journal.undoes == "pose a bone":
            scene.undo()

    # -- by keys and by the gizmo --------------------------------------------------------

    @property
    def gizmo(self):
        """A joint moves; a bone turns about its head, or its tip moves, or a root does."""
        settings, posing, joint = self.scene.settings, self.scene.posing, self._chosen
        if joint is None or not settings.show_bones or settings.gizmo == "off":
            return None
        is_own = settings.own_axes and joint.bone >= 0
        axes = posing.axes(joint.bone) if is_own else np.eye(3)
        if self.on_joints:
            return Gizmo(MOVE, joint.place, axes)
        if joint.bone < 0:
            return None
        head, tail = posing.ends[joint.bone]
        if settings.gizmo == MOVE:
            return Gizmo(MOVE, head if self._is_root(joint) else tail, axes)
        return Gizmo(TURN, head, axes)

    def has_before_gizmo(self, pixel) -> bool:
        joint = self.joint_at(pixel)
        return joint is not None and joint.end != "body"

    @property
    def _chosen(self):
        rigging = self.scene.rigging
        return next((one for one in rigging.joints if one.name == rigging.selected), None)

    def _is_root(self, joint):
        """Whether a joint is the head of a bone that hangs on none: it can be moved in a pose."""
        parents = self.scene.rigging.skeleton.parents
        return joint.bone >= 0 and joint.end == HEAD and parents[joint.bone] < 0

    @property
    def drag_place(self):
        drag = self.drag
        if self.place is not None or drag.joint.bone < 0:
            return drag.joint.place
        moves_tail = drag.kind == MOVE and drag.joint.end == TAIL
        return self.scene.posing.ends[drag.joint.bone, int(moves_tail)]

    def turn_into(self, kind) -> None:
        """Let the drag in progress turn the bone, or reach with its tip."""
        drag, scene, pixel = self.drag, self.scene, self.view.pointer
        if kind == SCALE or drag.joint.bone < 0 or drag.moves_joint:
            self.view.say(f"{kind}: not with a bone or a joint")
            return
        if drag.joint.end != TAIL:
            self.view.say("a bone's body turns it")
            return
        now = drag.before
        if now is not None:
            scene.posing.follow()
            now = scene.posing.current
        drag.joint = Joint(drag.joint.bone, TAIL, scene.posing.ends[drag.joint.bone, 1])
        kind = MOVE if drag.kind == kind == TURN else kind
        drag.begin(kind, now, self.view.camera, pixel, drag.joint.place)

    def delete(self) -> bool:
        """Delete the chosen joint; whether there was one."""
        rigging, joint = self.scene.rigging, self._chosen
        if joint is not None:
            rigging.delete_joint(*joint.name)
            rigging.selected = None
        return joint is not None


class JointTool(BoneTool):
    """Places and moves joints."""

    on_joints = True
    _matter = None  # what was deleted, and the Matter that is left, once it is needed

    hint = "Click on the object: a joint, joined to the chosen one.  Drag: move.  Esc: back to Bend"

    def click(self, pixel) -> None:
        """Place a joint in the middle of the matter under the mouse."""
        scene = self.scene
        moved = abs(scene.positions - scene.field.mesh.rest_vertices).max()
        if moved > AWAY * scene.size:
            scene.reset()
            self.view.say("joints are placed on the object at rest, where it is now: click again")
            return
        surface = self.view.surface_at(pixel, beside=False)
        if surface is None:
            scene.rigging.selected = None
            return
        if self._matter is None or self._matter[0] is not scene.cuts.removed:
            self._matter = scene.cuts.removed, Matter(scene.cuts.field)
        start, way = ray(self.view.camera, pixel)
        found = self._matter[1].middle(start, way, float((surface - start) @ way))
        if found is None:
            self.view.say("there is nothing solid under the mouse")
            return
        try:
            scene.rigging.add_joint(found[0])
        except ValueError as error:  # there are too many
            self.view.say(str(error))
            return
        self.view.log("joint", place=found[0], bones=scene.rigging.bone_count)
