"""The rig of the object in the view: joints that a hand places, weights, and clips.

Weights are the model's, or are made from the bones (wings/rig/weights.py) as soon as bones move
the object.  posing.py has what bones do to it.
"""

import time
from typing import Protocol

import numpy as np

from ....core.deform import TIME_STEP
from ....core.field import TetField
from ....wings.rig import BonePose, Rig, Skinner, automatic_weights, clip_of_poses, rig_from
from ..history.journal import Edited, edit
from . import joints
from .hold import Solved
from .joints import HEAD, LOOSE, TAIL, Joint

MOST_JOINTS = 200
BLINK = 0.3  # s; what takes longer is told of
SAMPLED = 2  # ticks between two keys of a clip that is made from the timeline


def rig_of(field, name: str) -> Rig | None:
    """The rig in a model of that name; None without one.

    Raises:
        ValueError: Its arrays are no rig.
    """
    if field.rig_arrays is None:
        return None
    try:
        return rig_from(field.rig_arrays, field.mesh.vertex_count)
    except ValueError as error:
        raise ValueError(f"the rig in the model {name} can't be used: {error}") from error


class MovingJoints(Protocol):
    """Where a pose has the joints."""

    ends: np.ndarray  # [B, 2, 3]

    def back_to_rest(self) -> None: ...
    def stop_clip(self) -> None: ...


class KeyedBones(Protocol):
    """Keys, some of them of poses of bones."""

    def span_of_bones(self) -> tuple[int, int]: ...
    def bones_at(self, tick: float) -> BonePose | None: ...


class Rigged(Solved, Protocol):
    """The object that has a rig."""

    field: TetField
    posing: MovingJoints
    timeline: KeyedBones


class Rigging(Edited):
    """The rig of one object.

    Attributes:
        skeleton: None without bones.
        weights: Of each bone on each vertex [V, B]; None: made from the bones once needed.
        offsets: Those of the model's weights [V, B, 3], or None.
        clips: What the rig can play.
        loose: The joint that begins a chain and has no bone yet [3], or None.
        selected: The chosen joint, by its name, or None.
        say: Shows a message to the user.
    """

    kept = "skeleton", "weights", "offsets", "clips", "loose"

    def __init__(self, rigged: Rigged, rig: Rig | None = None):
        """Take an object, and the rig of its model if it has one."""
        self.skeleton = self.weights = self.offsets = self.loose = None
        self.clips = ()
        if rig is not None:
            self.skeleton, self.clips = rig.skeleton, rig.clips
            self.weights, self.offsets = rig.weights, rig.offsets
        self.selected: tuple[int, str] | None = None
        self.say = lambda message: None
        self._rigged, self._first = rigged, self.state()
        self._bound = None  # skeleton and weights, the weights that follow, and the Skinner

    @property
    def bone_count(self) -> int:
        return 0 if self.skeleton is None else self.skeleton.bone_count

    @property
    def changed(self) -> bool:
        """Whether it is another one than the model's."""
        now = self.state()
        return any(now[name] is not self._first[name] for name in self.kept if name != "loose")

    @property
    def joints(self) -> list[Joint]:
        """All joints, where they are now."""
        ends = self._rigged.posing.ends
        return joints.joints_of(self.skeleton, self.loose, *np.moveaxis(ends, 1, 0))

    @property
    def chosen_bone(self) -> int | None:
        """The bone whose joint is chosen."""
        bone = LOOSE if self.selected is None else self.selected[0]
        return bone if 0 <= bone < self.bone_count else None

    def check(self, *bones: int) -> None:
        """Raise a ValueError if there are no such bones."""
        for bone in bones:
            if not 0 <= bone < self.bone_count:
                raise ValueError(f"there is no bone {bone}")

    # -- weights -------------------------------------------------------------------------

    def bound(self) -> Skinner:
        """What poses the object's vertices; weights that are missing are made."""
        last = self._bound
        if last is None or last[0] is not self.skeleton or last[1] is not self.weights:
            since, mesh = time.perf_counter(), self._rigged.field.mesh
            weights = self.weights
            if weights is None:
                weights = automatic_weights(mesh, self.skeleton)
            device = str(self._rigged.solver.device)
            skinner = Skinner(mesh.rest_vertices, weights, device, self.offsets)
            self._bound = self.skeleton, self.weights, weights, skinner
            seconds = time.perf_counter() - since
            if seconds > BLINK:
                self.say(f"the bones are bound to the object, which took {seconds:.1f} s")
        return self._bound[-1]

    @property
    def rig(self) -> Rig | None:
        """The rig as it is now; None without bones."""
        if self.skeleton is None:
            return None
        self.bound()
        return Rig(self.skeleton, self._bound[2], self.clips, self.offsets)

    # -- joints --------------------------------------------------------------------------

    def add_joint(self, point) -> None:
        """Put a joint there: a bone from the chosen joint to it, or the beginning of a chain."""
        bone, end = self.selected or (None, None)
        if bone == LOOSE and self.loose is not None:
            self.add_bone(-1, self.loose, point)
        elif self.chosen_bone is None:
            self.begin_chain(point)
            self.selected = LOOSE, HEAD
            return
        elif end == TAIL:
            self.add_bone(bone, self.skeleton.tails[bone], point)
        else:
            self.add_bone(int(self.skeleton.parents[bone]), self.skeleton.heads[bone], point)
        self.selected = self.bone_count - 1, TAIL

    @edit("begin_chain", undo="joint")
    def begin_chain(self, point) -> None:
        """Put a joint there, from which a chain of bones begins."""
        self._rigged.posing.back_to_rest()
        self.loose = np.asarray(point, float)

    @edit("add_bone", undo="joint")
    def add_bone(self, parent: int, head, tail) -> None:
        """Add a bone between two joints; `parent` is -1 for one that hangs on none.

        Raises:
            ValueError: There is no such parent, or there are too many bones.
        """
        if self.bone_count >= MOST_JOINTS:
            raise ValueError(f"{MOST_JOINTS} bones are the most that can be made here")
        head, tail = np.asarray(head, float), np.asarray(tail, float)
        self._take(joints.with_bone(self.skeleton, parent, head, tail), self.clips)
        if self.loose is not None and np.array_equal(head, self.loose):
            self.loose = None

    @edit("move_joint", undo="move a joint")
    def move_joint(self, bone: int, end: str, to) -> None:
        """Put a joint elsewhere; clips are forgotten, which are of the skeleton as it was."""
        to = np.asarray(to, float)
        if bone == LOOSE and self.loose is not None:
            self.loose = to
            return
        self.check(bone)
        self._take(joints.moved(self.skeleton, bone, end, to), ())

    @edit("delete_joint", undo="delete a joint")
    def delete_joint(self, bone: int, end: str) -> None:
        """Delete a joint and its bone; clips are forgotten, which are of the skeleton before."""
        if bone == LOOSE and self.loose is not None:
            self.loose = None
            return
        self.check(bone)
        self._take(joints.without_joint(self.skeleton, bone, end), ())

    @edit("name_bone", undo="name", merges=True)
    def name_bone(self, bone: int, text: str) -> None:
        """Give a bone another name; a ValueError if another one has it."""
        self.check(bone)
        self.skeleton = joints.renamed(self.skeleton, bone, text)

    def _take(self, skeleton, clips):
        """Take another skeleton, at rest."""
        self._rigged.posing.back_to_rest()
        self.skeleton, self.clips = skeleton, clips
        self.weights = self.offsets = None  # they were of the bones before

    # -- clips ---------------------------------------------------------------------------

    def clip(self, name: str):
        """The clip of that name; a ValueError without one."""
        for one in self.clips:
            if one.name == name:
                return one
        raise ValueError(f"there is no clip {name!r}")

    @edit("save_clip", undo="save the clip {clip}")
    def save_clip(self, clip: str) -> None:
        """Make a clip of the timeline's poses of these bones; one of that name is replaced.

        Raises:
            ValueError: Fewer than two keys have a pose of these bones.
        """
        timeline = self._rigged.timeline
        first, last = timeline.span_of_bones()
        ticks = np.unique(np.append(np.arange(first, last, SAMPLED), last))
        poses = [timeline.bones_at(int(tick)) for tick in ticks]
        made = clip_of_poses(clip, (ticks - first) * TIME_STEP, poses)
        self.clips = (*(one for one in self.clips if one.name != clip), made)

    @edit("delete_clip", undo="delete the clip {clip}")
    def delete_clip(self, clip: str) -> None:
        gone = self.clip(clip)
        self._rigged.posing.stop_clip()
        self.clips = tuple(one for one in self.clips if one is not gone)

    # -- undo ----------------------------------------------------------------------------

    def restore(self, state: dict) -> None:
        super().restore(state)
        names = [joint.name for joint in joints.joints_of(self.skeleton, self.loose)]
        self.selected = self.selected if self.selected in names else None
