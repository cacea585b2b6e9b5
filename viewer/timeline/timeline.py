"""The timeline: keys of camera and pose over ticks, a playhead, and poses that can be blended.

While it plays, each tick moves the playhead on.  The camera follows its keys.  The pose does so
in one of two ways (MOTIONS): by "interpolation" the vertices are the blend of two keys; by
"physics" what the keys hold is moved along, and the solver moves the rest.  All of it follows
from the edits, so that a session plays again to the bit.
"""

import warnings
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..camera import Orbit, changed, turned_to
from ..history import edit
from . import keys as k

TRACKS = "camera", "pose"
MOTIONS = "interpolation", "physics"
WEIGHTS = -2.0, 2.0  # of a saved pose
MOST_KEYS, MOST_POSES = 500, 32  # of a track
TURN_KEYS = 4  # of a whole turn: between two of them, the shorter way has to be the right one


@dataclass
class Drive:
    """What is moved from one pose key to the next while physics does the rest: K vertices."""

    first: k.PoseKey
    second: k.PoseKey
    ids: np.ndarray  # [K]
    pins: np.ndarray  # those of them that are pinned otherwise  [V] bool


class Timeline:
    """The timeline of one scene.

    Attributes:
        keys: Those of each track, sorted by tick: {"camera": (...), "pose": (...)}.
        poses: Those saved under a name, with their weights.
        head: The playhead [ticks].
        stands: Whether time stands still because the timeline shows a pose.
    """

    def __init__(self, scene):
        self.journal = None  # of the scene, once it has one
        self.keys = dict.fromkeys(TRACKS, ())
        self.poses: tuple[k.Pose, ...] = ()
        self.loop, self.motion = False, MOTIONS[0]
        self.head = 0
        self.playing = self.stands = False
        self._scene = scene
        self._drive: Drive | None = None

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
        return bool(self.keys["pose"]) and self.motion == "physics" and self._scene.paused

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
        """Key a camera, if one is given, and the pose that the scene has now, if wanted.

        Args:
            orbit: The values of an Orbit (`asdict`).
        """
        if orbit is not None:
            camera = k.CameraKey(tick, changed(Orbit(), orbit), self._easing("camera", tick))
            self._set("camera", k.with_key(self.keys["camera"], camera))
        if pose:
            self._set("pose", k.with_key(self.keys["pose"], self._pose_now(tick)))

    def _pose_now(self, tick):
        scene = self._scene
        pinned = scene.solver.pinned | self.taken_pins
        held = pinned.copy()
        if scene.handles.grabbed is not None:
            held[scene.handles.grabbed.ids] = True
        vertices = scene.solver.vertices.numpy().copy()
        easing = self._easing("pose", tick)
        return k.PoseKey(tick, vertices, pinned, held, scene.body.material, easing)

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
        """Put a copy of a key elsewhere."""
        key = replace(self._key(track, tick), tick=to_tick)
        self._set(track, k.with_key(self.keys[track], key))

    @edit("delete_key", undo="delete a key")
    def delete_key(self, track: str, tick: int) -> None:
        """Delete a key."""
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
        part = max(round(ticks / TURN_KEYS), 1)  # a whole number, so that all are equally fast
        turn = (
            k.CameraKey(
                n * part, turned_to(orbit, orbit.yaw + 2.0 * np.pi * n / TURN_KEYS), "linear"
            )
            for n in range(TURN_KEYS + 1)
        )
        self.keys["camera"] = tuple(turn)
        self.loop, self.head = True, 0
        self.play()

    @edit("set_loop", undo="loop")
    def set_loop(self, on: bool) -> None:
        """Play again and again, or once."""
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
        self.keys[track] = keys

    # -- time ----------------------------------------------------------------------------

    @edit("play", undo="play", begins=True)
    def play(self) -> None:
        """Play from the playhead, or from the beginning if it is at the end."""
        self._let_go()
        if self.head >= self.end:
            self.head = 0
        self._show()
        if self.keys["pose"] and self.motion == "interpolation":
            self.stand()  # the pose stays, when the end is reached
        elif self.keys["pose"]:
            self._scene.paused = False
        self.playing = self.end > 0

    @edit("stop")
    def stop(self) -> None:
        """Stop where it is."""
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
        stands = self.stands or not self._scene.paused
        self._scene.paused = True
        self.stands = stands

    @property
    def shows_poses(self) -> bool:
        """Whether the pose is the timeline's, at this tick."""
        return self.playing and bool(self.keys["pose"]) and self.motion == "interpolation"

    def give_way(self) -> None:
        """A hand takes hold: nothing plays, and time goes on if the timeline stopped it."""
        self._end()
        if self.stands:
            self._scene.paused = False

    def advance(self) -> bool:
        """A tick begins.  Returns whether the pose after it is set, so that no step is needed."""
        if not self.playing:
            return False
        ends = self.head >= self.end and not self.loop
        if ends or not self.end:
            self._end()
            return False
        driven = self.keys["pose"] and self.motion == "physics"
        if self._waits:
            return False
        with self.journal.unrecorded(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of materials: the panel says what is held
            return self._advance(driven)

    def _advance(self, driven):
        before, self.head = self.head, self.head + 1
        wraps = self.loop and self.head >= self.end
        if driven:
            self._move_held(before)
        if wraps:
            self.head = 0
        self._show_camera()
        if not driven:
            return self._show_pose()
        # What is held can go on if it is where the beginning has it; else all begins anew.
        return wraps and self._breaks() and self._show_pose()

    def _breaks(self):
        first, last, held = self.keys["pose"][0], self.keys["pose"][-1], self._drive
        return not np.array_equal(first.vertices[held.ids], last.vertices[held.ids])

    def _show(self):
        self._show_camera()
        self._show_pose()
        self._scene.revision += 1

    def _show_camera(self):
        if self.keys["camera"]:
            self._scene.orbit = self.orbit_at(self.head)
            self.journal.forget_view(asdict(self._scene.orbit))

    def _show_pose(self):
        """Set vertices, pins and material as the keys have them; returns whether there are any."""
        scene, keys = self._scene, self.keys["pose"]
        if not keys:
            return False
        self._end_drive()
        self._take_material(self.head)
        vertices = k.vertices_at(keys, self.head)
        if not np.array_equal(vertices, scene.solver.vertices.numpy()):
            scene.solver.set_state(vertices)
        else:
            scene.solver.velocities.zero_()
        self._set_pins(k.around(keys, self.head)[0].pinned)
        return True

    def _take_material(self, tick):
        material = k.material_at(self.keys["pose"], tick)
        if material != self._scene.body.material:
            self._scene.body.set_material(**asdict(material))

    def _set_pins(self, pinned):
        if not np.array_equal(pinned, self._scene.solver.pinned):
            self._scene.solver.set_pinned(pinned)

    # -- physics between poses -----------------------------------------------------------

    @property
    def taken_pins(self):
        """Pins that are moved, and so aren't the solver's, while physics plays.  [V] bool"""
        none = np.zeros(len(self._scene.solver.pinned), bool)
        return none if self._drive is None else self._drive.pins

    def _move_held(self, tick):
        """Send what the keys around a tick hold to where it is at the next tick."""
        keys, solver = self.keys["pose"], self._scene.solver
        first, second, _ = k.around(keys, tick)
        drive = self._drive
        if drive is None or drive.first is not first or drive.second is not second:
            drive = self._drive = self._begin(first, second)
        self._take_material(tick + 1)
        solver.move(k.vertices_at((first, second), tick + 1)[drive.ids].astype(float))

    def _begin(self, first, second):
        moves = (first.vertices != second.vertices).any(axis=1)
        driven = (first.held | second.held) & (moves | ~first.pinned)
        ids = np.flatnonzero(driven)
        self._set_pins(first.pinned & ~driven)
        self._scene.solver.grab(ids)
        return Drive(first, second, ids, driven & first.pinned)

    def _end_drive(self):
        """Give back what is moved; what is pinned stays where it has come to."""
        scene, drive = self._scene, self._drive
        if drive is None:
            return
        arrived = self.head >= drive.second.tick
        pins = drive.second.pinned if arrived else scene.solver.pinned | drive.pins
        self._drive = None
        if scene.handles.grabbed is None:
            scene.solver.release()
        self._set_pins(pins)

    def _end(self):
        self._end_drive()
        moved, self.playing = self.moves_camera, False
        if moved:  # from here on, the views that are recorded say where the camera is
            self.journal.note_view(asdict(self._scene.orbit))

    def _let_go(self):
        self._scene.handles.release()
        self._scene.end_push()
        self._end()

    # -- saved poses ---------------------------------------------------------------------

    @edit("save_pose", undo="save the pose {name}")
    def save_pose(self, name: str) -> None:
        """Keep the pose under a name; one that has it is replaced."""
        vertices = self._scene.solver.vertices.numpy().copy()
        others = [pose for pose in self.poses if pose.name != name]
        if len(others) >= MOST_POSES:
            raise ValueError(f"{MOST_POSES} poses are saved; delete one first")
        self.poses = (*others, k.Pose(name, vertices))

    @edit("delete_pose", undo="delete the pose {name}")
    def delete_pose(self, name: str) -> None:
        """Forget a saved pose."""
        deleted = self._saved(name)
        self.poses = tuple(pose for pose in self.poses if pose is not deleted)

    @edit("blend_pose", undo="blend the pose {name}", merges=True)
    def blend_pose(self, name: str, weight: float) -> None:
        """Give a saved pose a weight, and show the rest shape plus all weighted differences."""
        changed = replace(self._saved(name), weight=weight)
        scene = self._scene
        self._let_go()
        self.poses = tuple(changed if pose.name == name else pose for pose in self.poses)
        scene.solver.set_state(k.blend(scene.solver.rest_shape, self.poses))
        self.stand()
        scene.revision += 1

    def _saved(self, name):
        pose = next((pose for pose in self.poses if pose.name == name), None)
        if pose is None:
            raise ValueError(f"no pose is saved as {name!r}")
        return pose

    # -- undo ----------------------------------------------------------------------------

    def state(self) -> dict:
        """What edits change."""
        names = "poses", "loop", "motion", "head", "stands"
        return {name: getattr(self, name) for name in names} | {"keys": dict(self.keys)}

    def restore(self, state: dict) -> None:
        """Return to a state; nothing plays."""
        self._end()
        if self.stands and not state["stands"]:
            self._scene.paused = False
        elif state["stands"]:
            self.stand()
        vars(self).update(state)
        self.keys = dict(self.keys)
