"""What bones do to the object: poses that a hand makes, and clips that play.

`softness` says how.  At 0 each pose sets all vertices by skinning, and time stands still, as at
a pose of the timeline.  Above 0 the vertices that `driven_vertices` chooses follow the bones,
and the solver moves the others.  All of it follows from the edits, so that a session plays
again to the bit.

Shapes: B bones, V vertices.
"""

from dataclasses import replace
from typing import Protocol

import numpy as np

from ....core.base.kept import Kept
from ....core.deform import TIME_STEP
from ....core.field import TetField
from ....wings.rig import (
    METHODS,
    BonePose,
    VertexClip,
    driven_vertices,
    mixed,
    moved_tails,
    phase,
    posed,
)
from ..history.journal import Edited, edit
from ..history.undo import Pausable
from .hold import Solved
from .rigging import Rigging

SPEEDS = -4.0, 4.0  # of clips
NO_ENDS = np.zeros((0, 2, 3))
FADE = 0.3  # s from one clip that plays to the next


class BoneGrip(Protocol):
    """What bones hold vertices by."""

    def hold_bones(self, ids: np.ndarray, targets: np.ndarray) -> None: ...
    def release_bones(self) -> None: ...


class MovedByBones(Solved, Protocol):
    """The object that bones move."""

    field: TetField
    grip: BoneGrip
    clock: Pausable
    revision: int

    def make_way(self, soft: bool) -> None: ...
    def reset(self) -> None: ...


class Posing(Edited):
    """The pose of one object's bones.

    Attributes:
        pose: Of the bones; None: at rest.
        drives: Whether the bones move the object now.
        shows_vertices: Whether the pose is not the bones', but that of a clip of vertices.
        clip, seconds: The name of the chosen clip, empty without one, and the time in it.
    """

    kept = (
        *("softness", "method", "clip", "seconds", "loop", "speed"),
        *("pose", "drives", "shows_vertices"),
    )

    def __init__(self, moved: MovedByBones, rigging: Rigging):
        self.softness, self.method = 0.0, METHODS[0]
        self.clip, self.seconds, self.loop, self.speed = "", 0.0, True, 1.0
        self.pose: BonePose | None = None
        self.playing = self.drives = self.shows_vertices = False
        self._moved, self._rigging = moved, rigging
        self._fades = None  # the clip before, the time in it, and the time since [s]
        self._aim: BonePose | None = None  # where a drag wants the bones, until they are there
        self._pins = None  # that are taken off while bones hold vertices  [V] bool
        self._driven = Kept()  # ids of vertices
        self._frames, self._ends = Kept(), Kept()

    @property
    def current(self) -> BonePose:
        """The pose of the bones, also if they are at rest."""
        return self._rigging.skeleton.rest_pose if self.pose is None else self.pose

    @property
    def ends(self):
        """The bones' heads and tails, where they are now; another array where they moved.

        [B, 2, 3]
        """
        return self._ends.of((self._rigging.skeleton, self.pose), self._ends_now)

    def _ends_now(self):
        skeleton = self._rigging.skeleton
        if skeleton is None:
            return NO_ENDS
        if self.pose is None:
            return np.stack([skeleton.heads, skeleton.tails], axis=1)
        frames, matrices = self._matrices(self.pose)
        return np.stack([frames[:, :3, 3], moved_tails(skeleton, matrices)], axis=1)

    def axes(self, bone: int):
        """A bone's own axes as they are now, in columns.  [3, 3]"""
        turn = self._matrices(self.current)[0][bone, :3, :3]
        return turn / np.maximum(np.linalg.norm(turn, axis=0), 1e-12)

    # -- by hand -------------------------------------------------------------------------

    @edit("hold_bone", undo="pose a bone", begins=True)
    def hold_bone(self, bone: int) -> None:
        """A hand takes a bone: from now on the bones move the object."""
        self._rigging.check(bone)
        self._act()
        self._show(self.current)

    def aim(self, pose: BonePose) -> None:
        """Send the bones to a pose of other rotations and translations; they reach it soon."""
        self._aim = pose

    def follow(self, share: float = 1.0) -> None:
        """Turn and move the bones by a share of the way to where they were sent."""
        if self._aim is None:
            return
        moved = np.flatnonzero((self._aim.translations != self.current.translations).any(axis=1))
        if share < 1.0:
            wanted = mixed(self.current, self._aim, share)
        else:
            wanted, self._aim = self._aim, None
        which = np.flatnonzero((wanted.rotations != self.current.rotations).any(axis=1))
        if len(which):
            self.turn_bones(which, wanted.rotations[which])
        if len(moved):
            self.move_bones(moved, wanted.translations[moved])

    @edit("turn_bones")
    def turn_bones(self, bones, rotations) -> None:
        """Give bones [K] these rotations relative to their parents, unit quaternions.  [K, 4]"""
        self._set(bones, "rotations", rotations)

    @edit("move_bones")
    def move_bones(self, bones, translations) -> None:
        """Put the heads of bones [K] there, in their parents' spaces [model units].  [K, 3]"""
        self._set(bones, "translations", translations)

    def _set(self, bones, name, values):
        """Give bones [K] these rows of an array of the pose, if they move the object."""
        self._rigging.check(*bones)
        if len(bones) != len(values):
            raise ValueError(f"{len(bones)} bones have {len(values)} {name}")
        if self.drives:
            array = getattr(self.current, name).copy()
            array[np.asarray(bones, int)] = np.reshape(values, (-1, array.shape[1]))
            self._show(replace(self.current, **{name: array}))

    @edit("rest_bones", undo="bones at rest")
    def rest_bones(self, bones) -> None:
        """Bring these bones [K] to rest, relative to their parents."""
        self._rigging.check(*bones)
        if self._rigging.skeleton is None:
            raise ValueError("there are no bones")
        rest, now, arrays = self._rigging.skeleton.rest_pose, self.current, {}
        for name in ("translations", "rotations", "scales"):
            arrays[name] = getattr(now, name).copy()
            arrays[name][bones] = getattr(rest, name)[bones]
        self._act()
        self._show(BonePose(**arrays))

    # -- clips ---------------------------------------------------------------------------

    @property
    def chosen(self):
        """The clip that is chosen, or the first one; None without clips."""
        clips = self._rigging.clips
        return next((one for one in clips if one.name == self.clip), clips[0] if clips else None)

    @edit("play_clip", undo="play {clip}", begins=True)
    def play_clip(self, clip: str) -> None:
        """Play a clip from where one is in it, or from its beginning after its end.

        If another one plays, its pose fades into the new one's.
        """
        before = (self.clip, self.seconds, 0.0) if self.playing and clip != self.clip else None
        duration = self._choose(clip).duration
        if not self.loop and not 0.0 < self.seconds < duration:
            self.seconds = 0.0 if self.speed >= 0.0 else duration
        self._act()
        self.playing, self._fades = True, before
        self._show_clip()

    @edit("stop_clip")
    def stop_clip(self) -> None:
        """Stop where it is; bones go on to hold what they hold."""
        self.playing = False

    @edit("scrub_clip", undo="move in {clip}", merges=True)
    def scrub_clip(self, clip: str, seconds: float) -> None:
        self.seconds = min(seconds, self._choose(clip).duration)
        self._act()
        self._show_clip()

    @edit("loop_clip", undo="loop of clips")
    def loop_clip(self, on: bool) -> None:
        self.loop = on

    @edit("set_clip_speed", undo="speed of clips", merges=True)
    def set_clip_speed(self, speed: float) -> None:
        """Play clips that many times as fast; below 0 backwards."""
        self.speed = speed

    def _choose(self, name):
        """Make a clip the chosen one, at its beginning if it wasn't; returns it."""
        clip = self._rigging.clip(name)
        if name != self.clip:
            self.clip, self.seconds = name, 0.0
        return clip

    def _show_clip(self):
        clip = self._rigging.clip(self.clip)
        if isinstance(clip, VertexClip):
            self.pose, self.shows_vertices = None, True
            self._move(clip.vertices_at(self.seconds))
        else:
            self._show(self._faded(clip.pose_at(self._rigging.skeleton, self.seconds)))

    def _faded(self, pose):
        """A clip's pose, and as much as is left of the one before."""
        if self._fades is None:
            return pose
        name, seconds, since = self._fades
        clip = next((one for one in self._rigging.clips if one.name == name), None)
        if since >= FADE or clip is None or isinstance(clip, VertexClip):
            self._fades = None
            return pose
        before = clip.pose_at(self._rigging.skeleton, phase(clip.duration, seconds))
        share = since / FADE
        return mixed(before, pose, share * share * (3.0 - 2.0 * share))

    @property
    def soft(self) -> bool:
        """Whether the solver moves some of the object while bones do."""
        return self.softness > 0.0

    @property
    def shows(self) -> bool:
        """Whether the object's pose is the playing clip's, at this tick."""
        return self.playing and not self.soft

    def advance(self, seen: bool = True) -> bool:
        """A tick begins.  Returns whether the clip sets the pose, so that no step is needed.

        Args:
            seen: Whether the pose after the tick is looked at.
        """
        if not self.playing or (self.soft and self._moved.clock.paused):
            return False
        after = self.seconds + self.speed * TIME_STEP
        if self._fades is not None:
            name, seconds, since = self._fades
            self._fades = name, seconds + self.speed * TIME_STEP, since + TIME_STEP
        duration = self._rigging.clip(self.clip).duration
        self.seconds = phase(duration, after) if self.loop else min(max(after, 0.0), duration)
        if not self.loop and not 0.0 < after < duration:
            self.playing = False
        if seen or self.soft or not self.playing:
            with self.journal.unrecorded():
                self._show_clip()
        return not self.soft

    # -- the object ----------------------------------------------------------------------

    @edit("set_softness", undo="softness", merges=True)
    def set_softness(self, softness: float) -> None:
        """Let the solver move more of the object, 1 the most; at 0 bones move all of it."""
        self.softness = softness
        if self.drives:
            self._let_go()
            playing, fades = self.playing, self._fades
            self._act()
            self._again()
            self.playing, self._fades = playing, fades

    @edit("set_skinning", undo="skinning")
    def set_skinning(self, method: str) -> None:
        """Choose one of wings.rig's METHODS."""
        self.method = method
        if self.drives:
            self._again()

    def show_pose(self, pose: BonePose, at_once: bool) -> bool:
        """The timeline has a pose for the bones.  Returns whether it has set all vertices.

        Args:
            at_once: All vertices are where bones have them, however soft the object is.
        """
        self.playing, self.drives = False, True
        if at_once and self.soft:
            self._let_go()
            self._moved.solver.set_state(self._vertices(pose))
        self._show(pose)
        return not self.soft

    def _act(self):
        """From now on the bones move the object, but no clip plays."""
        self.playing, self._fades = False, None
        self._moved.make_way(self.soft)
        self.drives = True

    def _show(self, pose):
        """Bring the object, or what bones hold of it, into a pose."""
        self.pose, self.shows_vertices = pose, False
        self._move(self._vertices(pose))

    def _again(self):
        """Bring the object into the pose that it had."""
        if self.shows_vertices:
            self._show_clip()
        else:
            self._show(self.current)

    def _vertices(self, pose):
        """Where skinning puts the vertices.  [V, 3] float32"""
        _, matrices = self._matrices(pose)
        return self._rigging.bound().pose(matrices, self.method).numpy()

    def _matrices(self, pose):
        """The bones' frames in a pose, and skinning matrices, both [B, 4, 4].

        Skinning and drawing want those of the same pose.
        """
        skeleton = self._rigging.skeleton

        def work():
            frames = posed(skeleton, pose)
            return frames, frames @ skeleton.inverse_rest

        return self._frames.of((skeleton, pose), work)

    def _move(self, vertices):
        if self.soft:
            if self._pins is None:
                self._pins = self._moved.solver.pinned.copy()
                self._moved.solver.set_pinned(np.zeros_like(self._pins))
            given = self._moved.field.mesh, self._rigging.skeleton, self.softness
            driven = self._driven.of(given, lambda: driven_vertices(*given))
            self._moved.grip.hold_bones(driven, vertices[driven])
        else:
            self._moved.solver.stand(vertices)
        self._moved.revision += 1

    @property
    def taken_pins(self):
        """Pins that aren't the solver's while bones hold vertices.  [V] bool"""
        none = np.zeros(len(self._moved.solver.pinned), bool)
        return none if self._pins is None else self._pins

    def _let_go(self):
        """Bones hold nothing; what was pinned is again, where it has come to."""
        self._moved.grip.release_bones()
        if self._pins is not None:
            pins, self._pins = self._pins, None
            self._moved.solver.set_pinned(self._moved.solver.pinned | pins)

    def give_way(self) -> None:
        """Time goes on: what stood still is the solver's, and returns to its rest shape."""
        if not self.soft:
            self.playing = self.drives = False

    def end(self) -> None:
        """Something else moves the object now."""
        self.playing = self.drives = self.shows_vertices = False
        self._aim = self._fades = None
        self._let_go()

    def rest(self) -> None:
        """The bones are at rest, and move nothing."""
        self.end()
        self.pose, self.seconds = None, 0.0

    def back_to_rest(self) -> None:
        """The bones are at rest, and so is the object if they have moved it."""
        moved = self.drives
        self.rest()
        if moved:
            self._moved.reset()

    # -- undo ----------------------------------------------------------------------------

    def restore(self, state: dict) -> None:
        """Return to a state, whose positions are there already: bones hold what they held."""
        self.end()
        super().restore(state)
        if self.drives and self.soft:
            self._again()
