"""Deleted parts: undone to the bit, played again, left out of pictures and files."""

import json
from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import (
    load,
    nearer_to_matter,
    pack_mask,
    save,
    specks,
    subtet_middles,
    unpack_mask,
)
from deformrf.core.geometry import face_components
from deformrf.core.render import Renderer
from deformrf.viewer.camera import camera_of
from deformrf.viewer.document import (
    Player,
    Scene,
    SessionError,
    load_session,
    save_session,
    start_of,
)
from deformrf.viewer.document.history.undo import _same
from deformrf.viewer.document.scene.cuts import ALL
from deformrf.wings import rig


def state_of(scene):
    """The scene's state; whether the solver sleeps is known again some steps after an undo."""
    return scene.states.now() | {"asleep": None}


@pytest.fixture
def scene(ball):
    return Scene(ball, "ball", "cpu")


def above(scene, height):
    """Masks of the sub-tets whose middles lie above a height at rest."""
    return pack_mask(subtet_middles(scene.field.mesh)[..., 2] > height)


def at_random(scene, random, share=0.3):
    """Masks of the sub-tets on one side of a plane through the object, about that share."""
    middles = subtet_middles(scene.field.mesh)
    along = middles @ random.normal(size=3)
    return pack_mask(along > np.quantile(along, 1.0 - share))


def drag(scene, random, ticks=20):
    """Drag a point for some ticks, and let it go."""
    handles = scene.handles
    free = handles.control_ids
    if len(free):
        handles.grab(int(random.choice(free)))
        handles.drag_to(handles.grabbed.start + random.normal(scale=0.05, size=3))
    for _ in range(ticks):
        scene.clock.advance(1 / 60)
    handles.release()


# -- which tets stay ---------------------------------------------------------------------------


def test_empty_tets_go_with_the_matter_that_they_are_nearest_to():
    row = np.full((7, 4), -1)  # tets side by side: matter at both ends, empty between
    row[1:, 0], row[:-1, 1] = np.arange(6), np.arange(1, 7)
    ends = np.isin(np.arange(7), [0, 6])
    first, last = np.arange(7) == 0, np.arange(7) == 6
    assert nearer_to_matter(row, ends, ~ends & False).all()
    np.testing.assert_array_equal(nearer_to_matter(row, first, last), np.arange(7) <= 3)
    apart = row.copy()
    apart[2, 1] = apart[3, 0] = -1  # and where no way leads from one end to the other
    np.testing.assert_array_equal(nearer_to_matter(apart, first, last), np.arange(7) <= 2)


def test_tets_of_the_solver_have_matter_or_are_empty_and_near_it(scene):
    random = np.random.default_rng()
    for _ in range(3):
        scene.cuts.delete(at_random(scene, random))
        has = scene.cuts.left != 0
        assert scene.cuts.kept[has].all()
        assert not scene.cuts.kept[~has & (scene.field.occupancy != 0)].any()
        assert len(scene.solver.tets) == scene.cuts.kept.sum()
        np.testing.assert_array_equal(
            np.flatnonzero(scene.cuts.vertices), np.unique(scene.solver.tets)
        )


# -- undo and sessions -------------------------------------------------------------------------


@pytest.mark.parametrize("begin", ["at rest", "bent", "yielded"])
def test_delete_and_undo_is_the_first_state_to_the_bit(scene, begin):
    random = np.random.default_rng()
    if begin == "yielded":
        scene.body.set_material(yield_strain=0.02)
    if begin != "at rest":
        drag(scene, random)
    before = state_of(scene)
    count = len(scene.journal.steps)
    assert scene.cuts.delete(at_random(scene, random))
    assert len(scene.journal.steps) == count + 1
    after = state_of(scene)
    for _ in range(5):
        scene.clock.advance(1 / 60)
    assert scene.undo()
    assert _same(before, state_of(scene))
    assert scene.solver.tets is not None and len(scene.solver.tets) == scene.field.mesh.tet_count
    assert scene.redo()
    assert _same(after["cuts"], state_of(scene)["cuts"])


def test_after_undo_the_object_moves_as_if_nothing_had_been_deleted(ball):
    ways = []
    for deletes in (True, False):
        scene = Scene(ball, "ball", "cpu")
        if deletes:
            scene.cuts.delete(above(scene, 0.6))
            scene.undo()
        drag(scene, np.random.default_rng(7))
        ways.append(scene.solver.vertices.numpy().copy())
    np.testing.assert_array_equal(*ways)


def test_a_session_plays_again_to_the_bit(scene, ball, tmp_path):
    random = np.random.default_rng()
    start = start_of(scene)
    for _ in range(4):
        drag(scene, random, 5)
        scene.cuts.delete(at_random(scene, random, 0.15))
        if random.integers(2):
            scene.undo()
    drag(scene, random, 5)
    path = save_session(scene, start, tmp_path / "s.jsonl")
    again = Scene(ball, "ball", "cpu")
    session = load_session(path, ball)
    Player(again, session).play_to(session.ticks)
    first, second = state_of(scene), state_of(again)
    assert scene.handles.points.rows() == again.handles.points.rows()
    first["handles"].pop("points"), second["handles"].pop("points")
    assert first["cuts"]["removed"].any()
    assert _same(first, second)


@pytest.mark.parametrize(
    ("tets", "masks", "words"),
    [
        ([1], [], "have 0 masks"),
        ([10**6], ["f" * 16], "no tet 1000000"),
        ([0], ["f" * 15], "can't have masks"),
        ([0], ["g" * 16], "can't have masks"),
        ([-1], ["f" * 16], "can't have tets"),
        ([0.5], ["f" * 16], "can't have tets"),
        ("all", ["f" * 16], "can't have tets"),
    ],
)
def test_a_session_with_bad_masks_is_refused(scene, ball, tmp_path, tets, masks, words):
    path = save_session(scene, start_of(scene), tmp_path / "bad.jsonl")
    with path.open("a") as file:
        file.write(json.dumps([0, "delete", {"tets": tets, "masks": masks}]) + "\n")
    with pytest.raises(SessionError, match=words):
        session = load_session(path, ball)
        Player(Scene(ball, "ball", "cpu"), session).play_to(session.ticks)


def test_all_of_the_object_cannot_be_deleted(scene):
    before = state_of(scene)
    with pytest.raises(ValueError, match="nothing of the object"):
        scene.cuts.delete(np.full(scene.field.mesh.tet_count, ALL))
    assert _same(before, state_of(scene))
    assert not scene.journal.steps and not scene.cuts.some


def test_deleting_nothing_is_no_step(scene):
    scene.cuts.delete(above(scene, 0.6))
    assert not scene.cuts.delete(above(scene, 0.6))
    assert len(scene.journal.steps) == 1


def test_a_preview_is_no_edit_and_can_be_dropped(scene):
    scene.cuts.show_preview(above(scene, 0.6))
    assert scene.cuts.some and not scene.journal.events
    assert (scene.cuts.left != scene.field.occupancy).any()
    scene.cuts.show_preview(None)
    np.testing.assert_array_equal(scene.cuts.left, scene.field.occupancy)


# -- what follows ------------------------------------------------------------------------------


def test_points_and_pins_that_were_deleted_can_not_be_taken(scene):
    handles, rest = scene.handles, scene.field.mesh.rest_vertices
    first = handles.at(handles.control_ids)
    scene.cuts.delete(above(scene, 0.55))
    left = handles.at(handles.control_ids)
    assert 0 < len(left) < len(first)
    assert left[:, 2].max() < 0.62  # a tet's edge above
    assert not len(set(map(tuple, left)) - set(map(tuple, first)))
    assert rest[handles.pin_ids][:, 2].max() < 0.62
    scene.undo()
    np.testing.assert_array_equal(handles.at(handles.control_ids), first)


def test_an_object_without_its_pins_is_pinned_at_the_lowest_part_that_is_left(scene):
    rest = scene.field.mesh.rest_vertices
    pins = scene.pins
    assert scene.held
    low = pack_mask(subtet_middles(scene.field.mesh)[..., 2] < 0.45)
    scene.cuts.delete(low)
    assert scene.held
    pinned = scene.solver.pinned & scene.cuts.vertices
    assert 0.2 < rest[pinned][:, 2].min() and rest[pinned][:, 2].max() < 0.55
    scene.undo()
    np.testing.assert_array_equal(scene.pins, pins)
    scene.hold(False)
    scene.cuts.delete(low)  # what floated is not pinned by that
    assert not scene.held
    assert scene.cuts.lowest > 0.4  # where a ground is put now


def test_what_is_left_is_not_held_by_what_was_deleted(scene):
    """The object's upper half, cut off from the pinned one, falls."""
    middles = subtet_middles(scene.field.mesh)[..., 2]
    scene.cuts.delete(pack_mask((middles > 0.3) & (middles < 0.7)))
    top = scene.cuts.vertices & (scene.field.mesh.rest_vertices[:, 2] > 0.75)
    labels = face_components(scene.cuts.neighbours)
    assert labels.max() >= 1
    before = scene.positions[top, 2].mean()
    scene.body.set_options(contact=False)
    scene.set_gravity(9.81)
    for _ in range(12):
        scene.clock.advance(1 / 60)
    assert scene.positions[top, 2].mean() < before - 0.05


def test_rest_lengths_of_edges_that_yielded_stay(scene):
    scene.body.set_material(yield_strain=0.01)
    drag(scene, np.random.default_rng())

    def lengths(solver):
        ends = np.sort(solver.edges.vertices, axis=1)
        return dict(zip(map(tuple, ends.tolist()), solver.rest_lengths.tolist(), strict=True))

    before, own = lengths(scene.solver), lengths(Scene(scene.field, "ball", "cpu").solver)
    assert any(before[pair] != own[pair] for pair in own)
    scene.cuts.delete(above(scene, 0.7))
    after = lengths(scene.solver)
    common = after.keys() & before.keys()
    assert len(common) > 100
    assert all(after[pair] == before[pair] for pair in common)


def test_specks_go_at_once(ball):
    places = subtet_middles(ball.mesh)
    large = np.linalg.norm(places - [0.5, 0.5, 0.4], axis=-1) < 0.25
    small = np.linalg.norm(places - [0.5, 0.5, 0.83], axis=-1) < 0.04
    scene = Scene(replace(ball, occupancy=pack_mask(large | small)), "ball", "cpu")
    assert 0 < scene.cuts.delete_specks() == specks(scene.field).sum()
    assert not unpack_mask(scene.cuts.left)[small].any()
    assert unpack_mask(scene.cuts.left)[large].all()
    assert scene.cuts.delete_specks() == 0


# -- pictures and files ------------------------------------------------------------------------


def test_the_saved_model_renders_as_the_edited_one(scene, tmp_path):
    random = np.random.default_rng()
    scene.cuts.delete(above(scene, 0.62))
    scene.cuts.delete(at_random(scene, random, 0.2))
    smaller = scene.cuts.smaller(None)
    assert smaller.mesh.tet_count == scene.cuts.kept.sum() < scene.field.mesh.tet_count
    path = tmp_path / "smaller.npz"
    save(smaller, path, entry_bits=16)
    camera = camera_of(scene.orbit, 96, 72)
    images = []
    for field in (scene.cuts.field, load(path)):
        renderer = Renderer(field)
        renderer.set_vertices(field.mesh.rest_vertices)
        images.append(renderer.render(camera).color_array().astype(int))
    assert (images[0][..., 3] > 200).any() and (images[0][..., 3] == 0).any()
    assert np.abs(images[0] - images[1]).max() <= 1


def test_masks_on_the_device_show_what_a_new_renderer_shows(scene):
    renderer = Renderer(scene.field)
    rest, camera = scene.field.mesh.rest_vertices, camera_of(scene.orbit, 64, 48)
    renderer.set_vertices(rest)
    whole = renderer.render(camera).color_array()
    scene.cuts.delete(above(scene, 0.6))
    renderer.set_occupancy(scene.cuts.left)
    new = Renderer(scene.cuts.field)
    new.set_vertices(rest)
    shown = renderer.render(camera).color_array().astype(int)
    assert (shown != whole).any()
    # A piece of a ray ends where the part's own tets end, not only where masks do.
    assert np.abs(shown - new.render(camera).color_array()).mean() < 0.5
    renderer.set_occupancy(scene.field.occupancy)
    np.testing.assert_array_equal(renderer.render(camera).color_array(), whole)


@pytest.mark.parametrize("motion", ["interpolation", "physics"])
def test_keys_of_the_timeline_stay_and_play(scene, ball, tmp_path, motion):
    random, start, line = np.random.default_rng(), start_of(scene), scene.timeline
    line.set_motion(motion)
    line.key(0, None, True)
    handles = scene.handles
    handles.grab(int(handles.control_ids[0]))
    handles.drag_to(handles.grabbed.start + 0.1)
    for _ in range(10):
        scene.clock.advance(1 / 60)
    line.key(20, None, True)
    handles.release()
    line.play()
    for _ in range(5):
        scene.clock.advance(1 / 60)
    scene.cuts.delete(at_random(scene, random))  # which ends the playing
    assert not line.playing and len(line.keys["pose"]) == 2
    for _ in range(3):
        scene.clock.advance(1 / 60)
    line.play()
    for _ in range(30):
        scene.clock.advance(1 / 60)
    assert np.isfinite(scene.positions).all()
    path = save_session(scene, start, tmp_path / "s.jsonl")
    again, session = Scene(ball, "ball", "cpu"), load_session(path, ball)
    Player(again, session).play_to(session.ticks)
    np.testing.assert_array_equal(again.solver.vertices.numpy(), scene.solver.vertices.numpy())
    while scene.journal.cursor:
        scene.undo()
    assert not scene.cuts.some


@pytest.mark.parametrize("soft", [False, True])
def test_bones_let_go_of_an_object_that_is_cut(scene, ball, tmp_path, soft):
    start, rigging, posing = start_of(scene), scene.rigging, scene.posing
    rigging.add_joint(np.array([0.5, 0.5, 0.3]))
    rigging.add_joint(np.array([0.5, 0.5, 0.7]))
    if soft:
        posing.set_softness(0.5)
    posing.hold_bone(0)
    for step in range(10):
        turned = rig.turned(rigging.skeleton, posing.current, 0, np.array([0.05 * step, 0.0, 0.1]))
        posing.aim(turned)
        scene.clock.advance(1 / 60)
        if step == 5:
            scene.cuts.delete(above(scene, 0.7))
    assert np.isfinite(scene.positions).all() and scene.cuts.some
    path = save_session(scene, start, tmp_path / "s.jsonl")
    again, session = Scene(ball, "ball", "cpu"), load_session(path, ball)
    Player(again, session).play_to(session.ticks)
    np.testing.assert_array_equal(again.solver.vertices.numpy(), scene.solver.vertices.numpy())
