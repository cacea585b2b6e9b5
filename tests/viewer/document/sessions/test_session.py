"""Edits that are recorded, undone, stored and played again."""

import json
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from random_hands import use

from deformrf.core.deform import PRESETS
from deformrf.core.field import pack_mask, subtet_middles
from deformrf.viewer.document import (
    Player,
    Scene,
    Session,
    SessionError,
    load_session,
    save_session,
    start_of,
)
from deformrf.viewer.document.history import journal


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


class RandomHand:
    """Random edits of the object."""

    def __init__(self, scene, random):
        self.scene, self.random = scene, random

    def drag(self):
        handles = self.scene.handles
        if handles.grabbed is None:
            self.scene.settings.grab_radius = float(self.random.uniform(0.0, 0.4))
            self.scene.settings.soft_grab = bool(self.random.integers(2))
            free = handles.control_ids
            if handles.takeable and self.random.integers(2):
                handles.grab_selected()
            elif len(free):
                handles.grab(int(self.random.choice(free)))
        elif self.random.integers(3):
            handles.drag_to(handles.grabbed.target.place + self.random.normal(scale=0.05, size=3))
        elif self.random.integers(2):
            stretch = np.diag(self.random.uniform(0.7, 1.4, 3)) if self.random.integers(2) else None
            rotation = self.random.normal(scale=0.5, size=3)
            handles.turn_to(rotation, self.random.uniform(0.7, 1.4), stretch)
        else:
            handles.widen(self.random.uniform(0.7, 1.4))

    def select(self):
        free = self.scene.handles.control_ids
        if len(free):
            how = str(self.random.choice(["replace", "add", "remove", "intersect", "toggle"]))
            self.scene.handles.select(self.random.choice(free, 5), how)

    def pin(self):
        if self.scene.handles.grabbed is not None:
            self.scene.handles.pin_grab()
        else:
            self.scene.handles.set_pin(
                int(self.random.integers(len(self.scene.positions))), bool(self.random.integers(2))
            )

    def push(self):
        shown = self.scene.handles.control_ids
        if self.scene.ball is not None:
            self.scene.push_to(self.scene.ball.target + self.random.normal(scale=0.05, size=3))
        elif len(shown):  # not all are hidden
            self.scene.push(self.scene.handles.at(shown[:1])[0], [0.0, -1.0, 0.0])

    def let_go(self):
        self.scene.handles.let_go()

    def cancel(self):
        if self.scene.handles.grabbed is not None:
            self.scene.handles.cancel()

    def paint(self):
        self.scene.paint(self.random.uniform(0.2, 0.8, 3), float(self.random.choice([0.8, 1.2])))

    def delete(self):
        """What lies behind a plane, a twentieth of the object at first."""
        along = subtet_middles(self.scene.field.mesh) @ self.random.normal(size=3)
        with suppress(ValueError):  # all that is left lies there
            self.scene.cuts.delete(pack_mask(along > np.quantile(along, 0.95)))

    def edits(self):
        """All of them, likely ones several times."""
        scene, random = self.scene, self.random
        return (
            *(self.drag,) * 6,
            self.delete,
            *(self.push,) * 2,
            *(self.select,) * 2,
            scene.handles.hide,
            scene.handles.unhide,
            lambda: scene.handles.add_point(random.uniform(0.3, 0.7, 3)),
            self.pin,
            self.let_go,
            self.cancel,
            self.paint,
            scene.handles.release,
            scene.end_push,
            scene.reset,
            scene.undo,
            scene.redo,
            scene.body.rest_here,
            scene.body.undo_rest_here,
            scene.body.clear_paint,
            lambda: scene.body.set_material(young_modulus=float(10.0 ** random.uniform(4, 7))),
            lambda: scene.body.set_material(yield_strain=float(random.choice([0.05, np.inf]))),
            lambda: scene.body.set_options(substep_count=int(random.integers(5, 30))),
            lambda: scene.body.set_automatic_substeps(bool(random.integers(2))),
            lambda: scene.body.set_meters(float(random.uniform(0.2, 3.0))),
            lambda: scene.set_gravity(float(random.choice([0.0, 9.81]))),
            lambda: scene.set_ground(bool(random.integers(2))),
            lambda: scene.hold(bool(random.integers(2))),
            lambda: setattr(scene.clock, "paused", bool(random.integers(4) == 0)),
            scene.clock.single_step,
            lambda: setattr(scene.settings, "mode", str(random.choice(["color", "depth"]))),
        )


def same(scene, other):
    np.testing.assert_array_equal(other.solver.vertices.numpy(), scene.solver.vertices.numpy())
    np.testing.assert_array_equal(other.solver.velocities.numpy(), scene.solver.velocities.numpy())
    np.testing.assert_array_equal(other.solver.pinned, scene.solver.pinned)
    assert other.body.material == scene.body.material
    assert other.solver.options == scene.solver.options
    np.testing.assert_array_equal(other.cuts.removed, scene.cuts.removed)
    np.testing.assert_array_equal(other.cuts.kept, scene.cuts.kept)
    assert other.handles.selected == scene.handles.selected
    assert other.handles.points.rows() == scene.handles.points.rows()


@pytest.mark.parametrize("trial", range(3))
def test_random_sessions_play_again_to_the_bit_and_undo_to_the_beginning(
    ball, scene, tmp_path, trial
):
    random, start = np.random.default_rng(), start_of(scene)
    before = scene.solver.vertices.numpy().copy()
    use(scene, random, RandomHand(scene, random).edits(), 150, most_frames=3)
    path = save_session(scene, start, tmp_path / "s.jsonl")

    session, other = load_session(path, ball), Scene(ball, "ball", "cpu")
    player = Player(other, session)
    for tick in np.sort(random.integers(0, session.ticks + 1, 20)):  # in parts, as a film does
        player.play_to(tick)
    player.play_to(session.ticks)
    same(scene, other)
    assert other.journal.events == scene.journal.events  # the player's own session is the same

    while scene.journal.cursor:
        scene.undo()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), before)
    assert not scene.solver.velocities.numpy().any() and not scene.cuts.some
    np.testing.assert_array_equal(scene.solver.pinned, scene.pins)
    assert start_of(scene) == start and scene.body.factors is None


def test_what_changes_nothing_is_no_step_and_labels_are_the_panels_words(scene):
    scene.body.clear_paint()
    scene.set_ground(False)
    scene.handles.unhide()
    scene.body.set_material(young_modulus=scene.body.material.young_modulus)
    scene.handles.set_pin(int(np.flatnonzero(scene.pins)[0]), True)
    assert scene.journal.steps == []
    scene.body.set_material(young_modulus=2e6)
    scene.body.set_options(substep_count=12)
    scene.body.set_material(**vars(PRESETS["rubber"]))
    scene.body.clear_paint()
    labels = [step.label for step in scene.journal.steps]
    assert labels == ["stiffness", "substeps", "material"]


def test_undo_and_redo_move_a_cursor_over_named_steps(scene):
    journal, rest = scene.journal, scene.positions.copy()
    assert not scene.undo() and not scene.redo()
    scene.body.set_material(young_modulus=2e6)
    scene.body.set_material(young_modulus=3e6)  # a slider that is being dragged: one step
    vertex = int(scene.handles.control_ids[0])
    scene.handles.grab(vertex)
    scene.handles.drag_to(scene.handles.at([vertex], rest)[0] + [0.1, 0.0, 0.0])
    scene.clock.advance(0.05)
    scene.handles.release()
    moved = scene.solver.vertices.numpy().copy()
    assert [step.label for step in journal.steps] == ["stiffness", "drag"]
    assert scene.undo()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), rest)
    assert journal.redoes == "drag" and journal.undoes == "stiffness"
    assert scene.undo() and scene.body.material.young_modulus == 1e6
    assert scene.redo() and scene.body.material.young_modulus == 3e6
    assert scene.redo()
    np.testing.assert_array_equal(scene.solver.vertices.numpy(), moved)
    scene.undo()
    scene.set_ground(True)  # another edit: what was undone can't be done again
    assert not scene.redo()


def test_an_edit_that_is_refused_is_not_recorded(scene):
    with pytest.raises(ValueError):
        scene.body.set_material(poisson_ratio=2.0)
    assert scene.journal.events == [] and scene.journal.steps == []
    scene.body.set_material(poisson_ratio=0.4)
    assert [event.name for event in scene.journal.events] == ["set_material"]


def test_a_hundred_steps_can_be_undone_however_large(scene, monkeypatch):
    monkeypatch.setattr(journal, "MOST_BYTES", 0)
    for k in range(130):
        scene.set_ground(k % 2 == 0)
    assert sum(scene.undo() for _ in range(200)) == 100


@pytest.fixture
def lines(scene, tmp_path):
    """The lines of a good session; `write` writes them, changed, and returns the path."""
    start = start_of(scene)
    scene.handles.grab(int(scene.handles.control_ids[0]))
    scene.clock.advance(0.1)
    scene.handles.release()
    path = save_session(scene, start, tmp_path / "s.jsonl")
    return [json.loads(line) for line in path.read_text().splitlines()]


DAMAGE = {
    "no header": lambda lines: lines.pop(0),
    "another format": lambda lines: lines[0].pop("deformrf session"),
    "a later version": lambda lines: lines[0].update({"deformrf session": 2}),
    "another mesh": lambda lines: lines[0].update(rest="0"),
    "no start": lambda lines: lines[0].pop("start"),
    "a start that can't be": lambda lines: lines[0]["start"].update(young_modulus=-1.0),
    "a start of other things": lambda lines: lines[0]["start"].update(window=3),
    "endless": lambda lines: lines[0].update(ticks=10**12),
    "half a tick": lambda lines: lines[-1].__setitem__(0, 0.5),
    "before time": lambda lines: lines[-1].__setitem__(0, -1),
    "out of order": lambda lines: lines[1].__setitem__(0, 10**6),
    "an unknown edit": lambda lines: lines[-1].__setitem__(1, "__init__"),
    "a vertex that is not there": lambda lines: lines.append(
        [99, "grab", dict(GRAB, vertex=10**6)]
    ),
    "half a vertex": lambda lines: lines.append([99, "grab", dict(GRAB, vertex=0.5)]),
    "a true vertex": lambda lines: lines.append([99, "grab", dict(GRAB, vertex=True)]),
    "a lack of arguments": lambda lines: lines.append([99, "grab", {"vertex": 1}]),
    "arguments in a list": lambda lines: lines.append([99, "grab", [1, 2]]),
    "a point at infinity": lambda lines: lines.append([99, "move", {"to": [1e300, 0, 0]}]),
    "a flat point": lambda lines: lines.append([99, "move", {"to": [0, 0]}]),
    "too many substeps": lambda lines: lines.append([99, "set_options", {"substep_count": 10**6}]),
    "substeps by chance": lambda lines: lines[0]["start"].update(automatic_substeps="often"),
    "an unknown integrator": lambda lines: lines[0]["start"].update(integrator="none"),
    "another integrator later": lambda lines: lines.append(
        [99, "set_options", {"integrator": "euler"}]
    ),
    "an option of its own": lambda lines: lines.append([99, "set_options", {"rescue": False}]),
    "no material": lambda lines: lines.append([99, "set_material", {"poisson_ratio": 0.6}]),
    "an unknown mode": lambda lines: lines.append([99, "view", {"mode": "x-ray"}]),
    "an unknown surface": lambda lines: lines.append([99, "view", {"mesh_surface": ["plain"]}]),
    "half a ground": lambda lines: lines.append([99, "view", {"show_ground": 0.5}]),
    "more than opaque": lambda lines: lines.append([99, "view", {"mesh_opacity": 2}]),
    "colors of no range": lambda lines: lines.append([99, "view", {"mesh_range": 0}]),
    "a ball of no size": lambda lines: lines.append([99, "push", dict(BALL, radius=0)]),
    "a camera above itself": lambda lines: lines.append([99, "view", {"pitch": 1.6}]),
    "a long tick": lambda lines: lines[-1].__setitem__(0, "x" * 10**6),
    "a long name": lambda lines: lines[-1].__setitem__(1, "x" * 10**6),
    "a long argument": lambda lines: lines.append([99, "view", {"x" * 10**6: [0] * 10**5}]),
    "another mesh of long numbers": lambda lines: lines[0].update(rest="0", tets=[0] * 10**6),
    "a camera beyond": lambda lines: lines.append([99, "view", {"distance": 1e9}]),
}
TEN = '"substep_count": 10'
BALL = {"point": [0, 0, 0], "towards_eye": [0, 0, 1], "radius": 0.1}
GRAB = {"vertex": 1, "radius": 0.1, "soft": False}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_session_is_refused_in_one_sentence(ball, lines, tmp_path, damage):
    DAMAGE[damage](lines)
    path = tmp_path / "damaged.jsonl"
    path.write_text("\n".join(map(json.dumps, lines)))
    with pytest.raises(SessionError) as caught:
        load_session(path, ball)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert len(str(caught.value)) < len(str(path)) + 300


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"[" * 10**6, b"NaN", b"{}", b'{"a": 1'])
def test_other_files_are_no_sessions(ball, tmp_path, content):
    path = tmp_path / "no.jsonl"
    path.write_bytes(content)
    with pytest.raises(SessionError):
        load_session(path, ball)


def test_a_session_of_another_material_starts_with_it(ball, scene, tmp_path):
    scene.body.set_material(young_modulus=5e5)
    scene.journal.clear()
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl")
    other = Scene(ball, "ball", "cpu")
    Player(other, load_session(path, ball))
    assert start_of(other) == start_of(scene)
    assert other.journal.events == [] and not other.clock.moving


def test_substeps_follow_the_material_and_are_recorded(ball, scene, tmp_path):
    """A session plays with the numbers that it has, whatever this version would choose."""
    start, options = start_of(scene), lambda of: of.solver.options.substep_count
    default = options(scene)
    scene.body.set_material(young_modulus=1e8)
    scene.clock.advance(1 / 60)
    assert options(scene) == scene.solver.substeps_that_hold() > default
    assert [step.label for step in scene.journal.steps] == ["stiffness"]
    path = save_session(scene, start, tmp_path / "s.jsonl")
    path.write_text(path.read_text().replace(f'"substep_count": {options(scene)}', TEN))
    session = load_session(path, ball)
    Player(other := Scene(ball, "ball", "cpu"), session).play_to(session.ticks)
    assert options(other) == 10 and other.body.automatic_substeps

    scene.undo()
    scene.clock.advance(1 / 60)
    assert options(scene) == default
    scene.body.set_options(substep_count=12)
    scene.clock.advance(1 / 60)
    assert options(scene) == 12
    scene.body.set_automatic_substeps(True)
    scene.clock.advance(1 / 60)
    assert options(scene) == default


def test_a_session_that_names_no_integrator_keeps_the_first(ball, scene, lines, tmp_path):
    del lines[0]["start"]["integrator"], lines[0]["start"]["automatic_substeps"]
    path, own = tmp_path / "s.jsonl", scene.solver.options.integrator
    path.write_text("\n".join(map(json.dumps, lines)))
    session = load_session(path, ball)
    Player(other := Scene(ball, "ball", "cpu"), session).play_to(session.ticks)
    other.body.set_options(substep_count=12)
    other.undo()
    other.reset()
    again = load_session(save_session(other, session.header["start"], path), ball)
    assert not (other.body.automatic_substeps or again.header["start"]["automatic_substeps"])
    for kept in (other.solver.options.integrator, again.header["start"]["integrator"]):
        assert kept == "euler" != own
    other.states.begin_anew()
    assert other.solver.options.integrator == own
    assert other.body.automatic_substeps


def test_a_film_of_a_session_without_events_has_one_picture(scene):
    assert Session({"ticks": 0}, []).ticks == 0


def test_a_drag_that_is_given_up_is_no_step(scene):
    scene.set_ground(True)
    scene.handles.grab(int(scene.handles.control_ids[0]))
    scene.handles.cancel()
    assert [step.label for step in scene.journal.steps] == ["ground"]
    assert scene.journal.cursor == 1


def test_undo_of_an_edit_during_a_push_brings_no_ball_back(scene):
    scene.push(scene.handles.at(scene.handles.control_ids[:1])[0], [0.0, -1.0, 0.0])
    scene.body.set_material(young_modulus=2e6)
    scene.end_push()
    scene.undo()
    assert scene.solver.options.colliders == () and scene.ball is None


def test_a_session_of_a_copy_with_other_stiffnesses_is_refused(ball, scene, tmp_path):
    path = save_session(scene, start_of(scene), tmp_path / "s.jsonl")
    stiffer = replace(ball, stiffness=np.full(ball.mesh.vertex_count, 2.0, np.float32))
    with pytest.raises(SessionError, match="other stiffnesses"):
        Player(Scene(stiffer, "ball", "cpu"), load_session(path, stiffer))


def test_views_of_a_camera_that_is_nowhere_are_not_noted(scene):
    scene.note_view()
    count = len(scene.journal.events)
    scene.orbit = replace(scene.orbit, target=np.full(3, np.nan))
    scene.note_view()
    assert len(scene.journal.events) == count


def test_a_drag_that_is_given_up_keeps_the_steps_within_it(scene):
    scene.handles.grab(int(scene.handles.control_ids[0]))
    scene.body.set_material(young_modulus=2e6)
    scene.handles.cancel()
    assert [step.label for step in scene.journal.steps] == ["stiffness"]
    while scene.undo():
        pass
    assert scene.body.material.young_modulus == 1e6


def test_a_drag_that_is_given_up_leaves_no_empty_step_before_those_within_it(scene):
    rest, (handle, *_) = scene.solver.vertices.numpy().copy(), scene.handles.control_ids
    scene.set_gravity(1.0)
    scene.handles.grab(int(handle))
    scene.handles.drag_to(np.add(scene.handles.grabbed.target.place, [0.1, 0.0, 0.0]))
    scene.clock.advance(0.1)
    scene.body.set_material(young_modulus=2e6)
    scene.set_ground(True)
    scene.handles.cancel()
    assert [step.label for step in scene.journal.steps] == ["gravity", "stiffness", "ground"]
    for _ in range(2):  # to poses without the drag
        scene.undo()
        np.testing.assert_array_equal(scene.solver.vertices.numpy(), rest)
    assert scene.body.material.young_modulus == 1e6 and not scene.on_ground
    scene.undo()
    assert not scene.undo() and scene.body.gravity == 0.0


def test_what_is_shown_is_part_of_a_session(ball, scene, tmp_path):
    start, settings = start_of(scene), scene.settings
    shown = {"mesh_surface": "strain", "mesh_opacity": 0.4, "mesh_range": 0.05}
    shown |= {"show_ground": False, "show_wireframe": True}
    for name, value in shown.items():
        setattr(settings, name, value)
    scene.clock.advance(0.1)
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    other = Scene(ball, "ball", "cpu")
    Player(other, session).play_to(session.ticks)
    assert {name: getattr(other.settings, name) for name in shown} == shown


def test_names_and_views_that_a_user_can_make_are_ones_that_a_session_can_have(
    ball, scene, tmp_path
):
    start, handle = start_of(scene), int(scene.handles.control_ids[0])
    scene.handles.name(handle, "a\tname\u00a0" + 70 * "x")
    scene.handles.name(handle, "\n")
    scene.orbit = replace(scene.orbit, target=np.array([0.0, -1599.0, 1e7]))
    scene.note_view()
    events = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball).events
    assert [event.name for event in events] == ["name", "name", "view"]


def test_a_choice_of_the_hand_is_a_step_when_it_was_one(ball, scene, tmp_path):
    scene.settings.hand = "pose"  # as the preferences may have it
    start = start_of(scene)
    scene.body.set_material(young_modulus=2e6)
    scene.handles.choose_hand("physics")
    scene.undo()
    session = load_session(save_session(scene, start, tmp_path / "s.jsonl"), ball)
    other = Scene(ball, "ball", "cpu")
    Player(other, session).play_to(session.ticks)
    assert other.body.material.young_modulus == 2e6 and other.settings.hand == "pose"
