"""Bones in sessions: they play again to the bit, and damaged edits are refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from random_hands import use

from deformrf.viewer.document import (
    Player,
    Scene,
    SessionError,
    load_session,
    save_session,
    start_of,
)
from deformrf.wings import rig


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


class RandomBones:
    """Random edits of bones and clips, with hands and a timeline between them."""

    def __init__(self, scene, random):
        self.scene, self.random = scene, random
        self.posing, self.rigging, self.line = scene.posing, scene.rigging, scene.timeline

    def place(self):
        return 0.5 + self.random.uniform(-0.3, 0.3, 3)

    def joint(self):
        names = [one.name for one in self.rigging.joints]
        return names[self.random.integers(len(names))] if names else None

    def choose(self):
        self.rigging.selected = self.joint()

    def on_joint(self, act, *more):
        chosen = self.joint()
        if chosen is not None:
            act(*chosen, *more)

    def turn(self):
        if self.rigging.bone_count:
            bone = int(self.random.integers(self.rigging.bone_count))
            self.posing.hold_bone(bone)
            way = self.random.normal(size=3)
            self.posing.aim(rig.turned(self.rigging.skeleton, self.posing.current, bone, way))

    def reach(self):
        if self.rigging.bone_count:
            bone = int(self.random.integers(self.rigging.bone_count))
            self.posing.hold_bone(bone)
            bones = self.rigging.skeleton
            self.posing.aim(rig.reach(bones, self.posing.current, bone, self.place()))

    def with_clip(self, act, *more):
        if self.rigging.clips:
            act(self.rigging.clips[self.random.integers(len(self.rigging.clips))].name, *more)

    def save(self):
        try:
            self.rigging.save_clip(str(self.random.choice(["a", "b"])))
        except ValueError:  # too few keys are of these bones
            pass

    def drag(self):
        if self.scene.handles.grabbed is None:
            self.scene.handles.grab(int(self.random.choice(self.scene.handles.control_ids)))
        else:
            way = self.random.normal(scale=0.05, size=3)
            self.scene.handles.drag_to(self.scene.handles.grabbed.target.place + way)

    def delete(self):
        count = self.scene.field.mesh.tet_count
        some = self.random.choice(count, 3, replace=False)
        masks = np.zeros(count, np.uint64)
        masks[some] = np.uint64(2**64 - 1)
        self.scene.cuts.delete(masks)

    def edits(self):
        """All of them, likely ones several times."""
        scene, random, line = self.scene, self.random, self.line
        posing, rigging = self.posing, self.rigging
        return (
            *(lambda: rigging.add_joint(self.place()),) * 3,
            self.choose,
            lambda: self.on_joint(rigging.move_joint, self.place()),
            lambda: random.integers(3) or self.on_joint(rigging.delete_joint),
            *(self.turn,) * 5,
            *(self.reach,) * 3,
            lambda: rigging.bone_count and posing.rest_bones([0]),
            *(lambda: line.key(int(random.integers(40)), None, True),) * 4,
            *(self.save,) * 2,
            *(lambda: self.with_clip(posing.play_clip),) * 3,
            lambda: self.with_clip(posing.scrub_clip, float(random.uniform(0.0, 1.0))),
            lambda: random.integers(3) or self.with_clip(rigging.delete_clip),
            posing.stop_clip,
            lambda: posing.loop_clip(bool(random.integers(2))),
            lambda: posing.set_clip_speed(float(random.uniform(-2.0, 2.0))),
            *(lambda: posing.set_softness(float(random.choice([0.0, 0.3, 0.9]))),) * 2,
            lambda: posing.set_skinning(str(random.choice(rig.METHODS))),
            *(line.play,) * 2,
            lambda: line.scrub(int(random.integers(40))),
            lambda: line.set_motion(str(random.choice(["interpolation", "physics"]))),
            *(self.drag,) * 3,
            scene.handles.release,
            self.delete,
            lambda: setattr(scene.clock, "paused", bool(random.integers(3) == 0)),
            lambda: scene.handles.set_pin(
                int(random.integers(len(scene.positions))), bool(random.integers(2))
            ),
            scene.reset,
            scene.undo,
            scene.redo,
            scene.clock.single_step,
        )


@pytest.mark.parametrize("trial", range(3))
def test_random_use_of_bones_plays_again_to_the_bit_and_undoes_to_the_beginning(
    ball, scene, tmp_path, trial
):
    seed = int(np.random.default_rng().integers(2**32))
    random, start = np.random.default_rng(seed), start_of(scene)
    before = scene.solver.vertices.numpy().copy()
    use(scene, random, RandomBones(scene, random).edits(), 150, most_frames=4)
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    other = Scene(ball, "ball", "cpu")
    player = Player(other, session)
    for tick in [*np.sort(random.integers(0, session.ticks + 1, 20)), session.ticks]:
        player.play_to(tick)
    vertices = other.solver.vertices.numpy(), scene.solver.vertices.numpy()
    np.testing.assert_array_equal(*vertices, f"seed {seed}")
    np.testing.assert_array_equal(other.solver.pinned, scene.solver.pinned, f"seed {seed}")
    assert other.journal.events == scene.journal.events, f"seed {seed}"
    assert other.posing.seconds == scene.posing.seconds, f"seed {seed}"
    while scene.journal.cursor:
        scene.undo()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), before, f"seed {seed}")
    np.testing.assert_array_equal(scene.solver.pinned, scene.pins, f"seed {seed}")
    assert not scene.rigging.joints and not scene.rigging.clips, f"seed {seed}"


@pytest.mark.parametrize(
    "event",
    [
        [0, "begin_chain", {"point": [0.0, 0.0]}],
        [0, "add_bone", {"parent": -2, "head": [0, 0, 0], "tail": [0, 0, 1]}],
        [0, "add_bone", {"parent": -1, "head": [0, 0, 0], "tail": [0, 0, 1e9]}],
        [0, "add_bone", {"parent": -1, "head": [0, 0, 0]}],
        [0, "move_joint", {"bone": 0, "end": "middle", "to": [0, 0, 0]}],
        [0, "delete_joint", {"bone": 0.5, "end": "tail"}],
        [0, "name_bone", {"bone": 0, "text": "a\nb"}],
        [0, "turn_bones", {"bones": [0], "rotations": [[0, 0, 0, 2]]}],
        [0, "turn_bones", {"bones": [0], "rotations": [[0, 0, 1]]}],
        [0, "turn_bones", {"bones": [True], "rotations": [[0, 0, 0, 1]]}],
        [0, "rest_bones", {"bones": 0}],
        [0, "play_clip", {"clip": ""}],
        [0, "scrub_clip", {"clip": "a", "seconds": -1.0}],
        [0, "set_clip_speed", {"speed": 100.0}],
        [0, "set_softness", {"softness": 1.5}],
        [0, "set_skinning", {"method": "magic"}],
        [0, "view", {"show_bones": 1}],
    ],
)
def test_damaged_edits_of_bones_are_refused(ball, scene, tmp_path, event):
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl")
    path.write_text(path.read_text() + json.dumps(event) + "\n")
    with pytest.raises(SessionError, match="line 2: "):
        load_session(path, ball)


@pytest.mark.parametrize(
    "event, told",
    [
        ([0, "add_bone", {"parent": 0, "head": [0, 0, 0], "tail": [0, 0, 1]}], "no bone 0"),
        ([0, "delete_joint", {"bone": -1, "end": "head"}], "no bone -1"),
        ([0, "hold_bone", {"bone": 0}], "no bone 0"),
        ([0, "turn_bones", {"bones": [3], "rotations": [[0, 0, 0, 1]]}], "no bone 3"),
        ([0, "rest_bones", {"bones": [0]}], "no bone 0"),
        ([0, "play_clip", {"clip": "Run"}], "no clip 'Run'"),
        ([0, "save_clip", {"clip": "Run"}], "two keys or more"),
    ],
)
def test_edits_of_bones_that_are_not_there_are_a_damaged_session(
    ball, scene, tmp_path, event, told
):
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl")
    path.write_text(path.read_text() + json.dumps(event) + "\n")
    with pytest.raises(SessionError, match=told):
        Player(scene, load_session(path, ball)).play_to(0)


def test_rotations_without_bones_are_a_damaged_session(ball, scene, tmp_path):
    for height in (0.2, 0.8):
        scene.rigging.add_joint(np.array([0.5, 0.5, height]))
    scene.posing.hold_bone(0)
    path = save_session(scene, start_of(Scene(ball, "ball", "cpu")), tmp_path / "s.jsonl")
    damaged = [0, "turn_bones", {"bones": [0], "rotations": []}]
    path.write_text(path.read_text() + json.dumps(damaged) + "\n")
    with pytest.raises(SessionError, match="can't be played"):
        Player(Scene(ball, "ball", "cpu"), load_session(path, ball)).play_to(0)


def test_a_session_of_another_rig_is_refused(ball, scene, tmp_path):
    for height in (0.2, 0.8):
        scene.rigging.add_joint(np.array([0.5, 0.5, height]))
    rigged = replace(ball, rig_arrays=rig.arrays_of(scene.rigging.rig))
    other = Scene(rigged, "ball", "cpu")
    path = save_session(other, start_of(other), tmp_path / "s.jsonl")
    Player(other, load_session(path, rigged)).play_to(0)
    with pytest.raises(SessionError, match="another rig"):
        Player(scene, load_session(path, ball))
