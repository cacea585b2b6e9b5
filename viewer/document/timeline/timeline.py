"""The timeline: keys of camera and pose over ticks, a playhead, and poses that can be blended.

While it plays, each tick moves the playhead on.  The camera follows its keys.  The pose does so
in one of two ways (MOTIONS): by "interpolation" the vertices are the blend of two keys; by
"physics" what the keys hold is moved along, and the solver moves the rest.  All of it follows
from the edits, so that a session plays again to the bit.
"""

import warnings
from dataclasses import asdict, replace
from typing import Protocol

import numpy as np

from ....core.deform import Material, XpbdSolver
from ....wings.rig import BonePose, Skeleton
from ...camera import Orbit, changed, turned_to
from ..history.journal import Edited, edit
from ..history.undo import Pausable
from . import keys as k
from .driving import Drive, set_pins

TRACKS = "camera", "pose"
MOTIONS = "interpolation", "physics"
WEIGHTS = -2.0, 2.0  # of a saved pose
MOST_KEYS, MOST_POSES = 500, 32  # of a track
TURN_KEYS = 4  # of a whole turn: between two of them, the shorter way has to be the right one


class OfMaterial(Protocol):
    """A body."""

    material: Material

    def set_material(self, **changes) -> None: ...


class Boned(Protocol):
    """A rig."""

    skeleton: Skeleton | None


class PosedBones(Protocol):
    """Bones that a hand, a clip or a key has posed."""

    soft: bool
    drives: bool
    shows_vertices: bool
    current: BonePose

    def show_pose(self, pose: BonePose, at_once: bool) -> bool: ...
    def end(self) -> None: ...


class Gripped(Protocol):
    """What a hand holds."""

    hand: np.ndarray  # ids


class Keyed(Protocol):
    """What keys take up, and move."""

    solver: XpbdSolver
    grip: Gripped
    pinned: np.ndarray  # [V] bool
    clock: Pausable
    orbit: Orbit
    revision: int
    body: OfMaterial
    rigging: Boned
    posing: PosedBones

    def hands_off(self) -> None: ...


class Timeline(Edited):
    """The timeline of one object.

    Attributes:
        keys: Those of each track, sorted by tick: {"camera": (...), "pose": (...)}.
        poses: Those saved under a name, with their weights.
        head: The playhead [ticks].
        stands: Whether time stands still because the timeline shows a pose.
    """

    kept = "keys", "poses", "loop", "motion", "head", "stands"

    def __init__(self, keyed: Keyed):
        self.keys = dict.fromkeys(TRACKS, ())
        self.poses: tuple[k.SavedPose, ...] = ()
        self.loop, self.motion = False, MOTIONS[0]
        self.head = 0
        self.playing = self.stands = False
        self._keyed = keyed
        self._drive: Drive | None = None  # while physics moves what keys hold

    @property
    def end(self) -> int:
        """The tick of the last key; 0 without keys."""
        return max((keys[-1].tick for keys in self.keys.values() if keys), default=0)

    @property
    def moves_camera(self) -> bool:
        """Whether the camera is the timeline's, at this tick."""
        return self.playing and bool(self.keys["camera"])

    @property
    def _waits(self):
        """Whether it plays by physics while time stands still."""
        by_physics = self.motion == "physics" or self._is_soft
        return bool(self.keys["pose"]) and by_physics and self._keyed.clock.paused

    @property
    def _is_soft(self):
        """Whether bones move some of the object, and the solver the rest, at this tick."""
        return self._keyed.posing.soft and self.bones_at(self.head) is not None

    def orbit_at(self, tick: float) -> Orbit:
        """The camera at any time, if there are camera keys."""
        return k.orbit_at(self.keys["camera"], tick)

    def way_of_camera(self):
        """Where the camera is until the next tick, as it stands now.

        Returns:
            A function from the time since this tick [ticks] to an Orbit; None if the camera is
            not the timeline's.
        """
        if not self.moves_camera:
            return None
        keys, head, speed = self.keys["camera"], self.head, 0.0 if self._waits else 1.0
        return lambda since: k.orbit_at(keys, head + speed * since)

    # -- keys ----------------------------------------------------------------------------

    @edit("key", undo="key at tick {tick}")
    def key(self, tick: int, orbit: dict | None, pose: bool) -> None:
        """Key a camera, if one is given, and the pose of now, if wanted.

        Args:
            orbit: The values of an Orbit (`asdict`).
        """
        if orbit is not None:
            camera = k.CameraKey(tick, changed(Orbit(), orbit), self._easing("camera", tick))
            self._set("camera", k.with_key(self.keys["camera"], camera))
        if pose:
            self._set("pose", k.with_key(self.keys["pose"], self._pose_now(tick)))

    def _pose_now(self, tick):
        keyed, posing = self._keyed, self._keyed.posing
        pinned = keyed.pinned
        held = pinned.copy()
        held[keyed.grip.hand] = True
        vertices = keyed.solver.vertices.numpy().copy()
        easing, bones = self._easing("pose", tick), None
        if posing.drives and not posing.shows_vertices:
            bones = k.Bones(keyed.rigging.skeleton, posing.current)
        return k.PoseKey(tick, vertices, pinned, held, keyed.body.material, easing, bones)

    def _easing(self, track, tick):
        """That of the key before: one that is added goes on as the way was."""
        before = [key.easing for key in self.keys[track] if key.tick <= tick]
        return before[-1] if before else "smooth"

    @edit("move_key", undo="move a key")
    def move_key(self, track: str, tick: int, to_tick: int) -> None:
        """Move a key; one that is there is replaced.

        Raises:
            ValueError: There is no such key; so do the others.
        """
        key = self._key(track, tick)
        others = tuple(other for other in self.keys[track] if other is not key)
        self._set(track, k.with_key(others, replace(key, tick=to_tick)))

    @edit("copy_key", undo="copy a key")
    def copy_key(self, track: str, tick: int, to_tick: int) -> None:
        key = replace(self._key(track, tick), tick=to_tick)
        self._set(track, k.with_key(self.keys[track], key))

    @edit("delete_key", undo="delete a key")
    def delete_key(self, track: str, tick: int) -> None:
        key = self._key(track, tick)
        self._set(track, tuple(other for other in self.keys[track] if other is not key))

    @edit("ease_key", undo="easing")
    def ease_key(self, track: str, tick: int, easing: str) -> None:
        """Choose one of EASINGS for the way from a key to the next one."""
        key = replace(self._key(track, tick), easing=easing)
        self._set(track, k.with_key(self.keys[track], key))

    @edit("turntable", undo="turntable")
    def turntable(self, ticks: int, orbit: dict) -> None:
        """Turn a camera around its target in about so many ticks, again and again, from now on."""
        if orbit is None:
            raise ValueError("there is no camera to turn")
        orbit = changed(Orbit(), orbit)
        step = max(round(ticks / TURN_KEYS), 1)  # a whole number, so that all are equally fast
        yaws = orbit.yaw + np.linspace(0.0, 2.0 * np.pi, TURN_KEYS + 1)
        turn = ((n * step, turned_to(orbit, yaw)) for n, yaw in enumerate(yaws))
        self._set("camera", tuple(k.CameraKey(*one, "linear") for one in turn))
        self.loop, self.head = True, 0
        self.play()

    @edit("set_loop", undo="loop")
    def set_loop(self, on: bool) -> None:
        self.loop = on

    @edit("set_motion", undo="motion between poses")
    def set_motion(self, motion: str) -> None:
        """Choose one of MOTIONS; what plays, stops."""
        self._end()
        self.motion = motion

    def _key(self, track, tick):
        key = k.key_at(self.keys[track], tick)
        if key is None:
            raise ValueError(f"there is no {track} key at tick {tick}")
        return key

    def _set(self, track, keys):
        if len(keys) > MOST_KEYS:
            raise ValueError(f"a timeline has at most {MOST_KEYS} {track} keys")
        self.keys = self.keys | {track: keys}

    # -- time ----------------------------------------------------------------------------

    @edit("play", undo="play", begins=True)
    def play(self) -> None:
        """Play from the playhead, or from the beginning if it is at the end."""
        self._let_go()
        if self.head >= self.end:
            self.head = 0
        self._show()
        if self.keys["pose"] and self.motion == "interpolation" and not self._is_soft:
            self.stand()  # the pose stays, when the end is reached
        elif self.keys["pose"]:
            self._keyed.clock.paused = False
        self.playing = self.end > 0

    @edit("stop")
    def stop(self) -> None:
        self._end()

    @edit("scrub", undo="move the playhead", merges=True)
    def scrub(self, tick: int) -> None:
        """Put the playhead there, and show what the keys say; time stands still at a pose."""
        self._let_go()
        self.head = tick
        self._show()
        if self.keys["pose"]:
            self.stand()

    def stand(self) -> None:
        """Stop, time too; a hand lets it go on, unless the user had stopped it."""
        self._end()
        self._stop_time()

    def stand_still(self) -> None:
        """Stop time as `stand` does: bones show a pose, and the timeline's camera may go on."""
        if self.keys["pose"]:
            self._end()
        self._stop_time()

    def _stop_time(self):
        stands = self.stands or not self._keyed.clock.paused
        self._keyed.clock.paused = True
        self.stands = stands

    @property
    def shows_poses(self) -> bool:
        """Whether the pose is the timeline's, at this tick."""
        by_keys = self.motion == "interpolation" and not self._is_soft
        return self.playing and bool(self.keys["pose"]) and by_keys

    def give_way(self) -> None:
        """A hand takes hold: nothing plays, and time goes on if the timeline stopped it."""
        self._end()
        if self.stands:
            self._keyed.clock.paused = False

    def advance(self) -> bool:
        """A tick begins.  Returns whether the pose after it is set, so that no step is needed."""
        if not self.playing:
            return False
        ends = self.head >= self.end and not self.loop
        if ends or not self.end:
            self._end()
            return False
        by_physics = self.keys["pose"] and self.motion == "physics"
        driven = by_physics and self.bones_at(self.head) is None  # not the way of bones
        if self._waits:
            return False
        with self.journal.unrecorded(), warnings.catch_warnings(action="ignore"):
            # Of materials: the panel says what is held.
            return self._advance(driven)

    def skip(self, ticks: int) -> None:
        """Show what the keys say so many ticks later, for estimates: no physics moves the rest."""
        self.head += ticks
        with self.journal.unrecorded(), warnings.catch_warnings(action="ignore"):
            if self.head >= self.end:
                self.head = self.head % self.end if self.loop else self.end
            self._show()
            if self.head == self.end and not self.loop:
                self._end()

    def _advance(self, driven):
        before, self.head = self.head, self.head + 1
        wraps = self.loop and self.head >= self.end
        if driven:
            self._take_material(before + 1)
            self._move(before)
        if wraps:
            self.head = 0
        self._show_camera()
        if not driven:
            return self._show_pose()
        # What is held can go on if it is where the beginning has it; else all begins anew.
        keys = self.keys["pose"]
        return wraps and self._drive.differs(keys[0], keys[-1]) and self._show_pose()

    def _move(self, tick):
        """Send what the keys around a tick hold to where it is at the next one."""
        way = k.around(self.keys["pose"], tick)[:2]
        if self._drive is None or self._drive.way != way:
            self._drive = Drive(self._keyed.solver, way)
        self._drive.move(tick + 1)

    def _end_drive(self):
        """Give back what is moved."""
        drive, self._drive = self._drive, None
        if drive is not None:
            pins = drive.pins_after(self.head)
            if not len(self._keyed.grip.hand):
                self._keyed.solver.release()
            set_pins(self._keyed.solver, pins)

    def _show(self):
        self._show_camera()
        self._show_pose()
        self._keyed.revision += 1

    def _show_camera(self):
        if self.keys["camera"]:
            self._keyed.orbit = self.orbit_at(self.head)
            self.journal.forget_view(asdict(self._keyed.orbit))

    def _show_pose(self):
        """Set vertices, pins and material as the keys have them; returns whether there are any."""
        keyed, keys = self._keyed, self.keys["pose"]
        if not keys:
            return False
        self._end_drive()
        self._take_material(self.head)
        bones = self.bones_at(self.head)
        if bones is not None:
            return keyed.posing.show_pose(bones, at_once=not self.playing)
        keyed.posing.end()
        keyed.solver.stand(k.vertices_at(keys, self.head))
        set_pins(keyed.solver, k.around(keys, self.head)[0].pinned)
        return True

    def _take_material(self, tick):
        material = k.material_at(self.keys["pose"], tick)
        if material != self._keyed.body.material:
            self._keyed.body.set_material(**asdict(material))

    @property
    def taken_pins(self):
        """Pins that are moved, and so aren't the solver's, while physics plays.  [V] bool"""
        none = np.zeros(len(self._keyed.solver.pinned), bool)
        return none if self._drive is None else self._drive.pins

    # -- bones ---------------------------------------------------------------------------

    def bones_at(self, tick: float):
        """The pose of the object's bones that the keys around a tick have, or None."""
        keys, skeleton = self.keys["pose"], self._keyed.rigging.skeleton
        return k.bones_at(keys, tick, skeleton) if keys and skeleton is not None else None

    def span_of_bones(self) -> tuple[int, int]:
        """The first and the last tick between which all keys have poses of the object's bones.

        Raises:
            ValueError: There are no two such keys.
        """
        keys = self.keys["pose"]
        if len(keys) < 2 or any(self.bones_at(key.tick) is None for key in keys):
            raise ValueError("a clip needs two keys or more, each of a pose of these bones")
        return keys[0].tick, keys[-1].tick

    # -- the end of playing --------------------------------------------------------------

    def _end(self):
        self._end_drive()
        moved, self.playing = self.moves_camera, False
        if moved:  # from here on, the views that are recorded say where the camera is
            self.journal.note_view(asdict(self._keyed.orbit))

    def _let_go(self):
        self._keyed.hands_off()
        self._end()

    # -- saved poses ---------------------------------------------------------------------

    @edit("save_pose", undo="save the pose {name}")
    def save_pose(self, name: str) -> None:
        """Keep the pose under a name; one that has it is replaced."""
        vertices = self._keyed.solver.vertices.numpy().copy()
        others = [pose for pose in self.poses if pose.name != name]
        if len(others) >= MOST_POSES:
            raise ValueError(f"{MOST_POSES} poses are saved; delete one first")
        self.poses = (*others, k.SavedPose(name, vertices))

    @edit("delete_pose", undo="delete the pose {name}")
    def delete_pose(self, name: str) -> None:
        deleted = self._saved(name)
        self.poses = tuple(pose for pose in self.poses if pose is not deleted)

    @edit("blend_pose", undo="blend the pose {name}", merges=True)
    def blend_pose(self, name: str, weight: float) -> None:
        """Give a saved pose a weight, and show the rest shape plus all weighted differences."""
        changed = replace(self._saved(name), weight=weight)
        keyed = self._keyed
        self._let_go()
        keyed.posing.end()
        self.poses = tuple(changed if pose.name == name else pose for pose in self.poses)
        keyed.solver.set_state(k.blend(keyed.solver.rest_shape, self.poses))
        self.stand()
        keyed.revision += 1

    def _saved(self, name):
        pose = next((pose for pose in self.poses if pose.name == name), None)
        if pose is None:
            raise ValueError(f"no pose is saved as {name!r}")
        return pose

    # -- undo ----------------------------------------------------------------------------

    def restore(self, state: dict) -> None:
        """Nothing plays then."""
        self._end()
        if self.stands and not state["stands"]:
            self._keyed.clock.paused = False
        elif state["stands"]:
            self.stand()
        super().restore(state)
