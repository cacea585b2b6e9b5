"""Projects: they open where they were moved to, as they were saved, and are never trusted."""

import json
import shutil
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from peak_memory import peak_memory

from deformrf.core import field as fields
from deformrf.core.base.paths import BUNDLED
from deformrf.viewer.camera import values_of
from deformrf.viewer.document import (
    Player,
    ProjectError,
    Scene,
    load_project,
    open_session,
    save_project,
    save_session,
    start_of,
)
from deformrf.viewer.document.sessions import project as p
from deformrf.wings import rig as rigs

LOOKS = {
    "background": (0.1, 0.2, 0.3),
    "mode": "depth",
    "hand": "pose",
    "gizmo": "turn",
    "grab_radius": 0.2,
    "soft_grab": True,
    "own_axes": True,
    "show_timeline": True,
    "show_wireframe": True,
}


@pytest.fixture
def scene(ball, tmp_path):
    """A scene of a ball's file, models/ball.npz."""
    (tmp_path / "models").mkdir()
    fields.save(ball, tmp_path / "models" / "ball.npz")
    return scene_of(tmp_path / "models" / "ball.npz")


def scene_of(source):
    made = Scene(fields.load(source), source.stem, "cpu")
    made.source = source
    return made


def work(scene):
    """Bend it, key it, save a view, and let it swing; what it began with."""
    start = start_of(scene)
    scene.set_gravity(3.0)
    scene.handles.set_pin(int(scene.handles.control_ids[0]), True)
    scene.timeline.key(0, values_of(scene.orbit), True)
    for _ in range(5):
        scene.clock.advance(1.0 / 60.0)
    scene.timeline.key(30, None, True)
    scene.viewpoint.save()
    scene.orbit = replace(scene.orbit, yaw=0.7, distance=1.5)
    vars(scene.settings).update(LOOKS)
    for _ in range(5):
        scene.clock.advance(1.0 / 60.0)
    return start


def reopened(path):
    """A scene in which a project was played."""
    project = load_project(path)
    scene = Scene(project.field, project.source.stem, "cpu")
    scene.source = project.source
    Player(scene, project.session).play_to(project.session.ticks)
    project.apply_looks(scene)
    return project, scene


def assert_same(scene, other):
    for name in ("vertices", "velocities", "pinned"):
        one, two = (getattr(s.solver, name) for s in (scene, other))
        one, two = (a if isinstance(a, np.ndarray) else a.numpy() for a in (one, two))
        np.testing.assert_array_equal(one, two)
    assert values_of(other.orbit) == values_of(scene.orbit)
    assert other.viewpoint.saved.keys() == scene.viewpoint.saved.keys()
    cameras, poses = ([s.timeline.keys[t] for s in (scene, other)] for t in ("camera", "pose"))
    told = [[(key.tick, values_of(key.orbit), key.easing) for key in keys] for keys in cameras]
    assert told[0] == told[1]
    for one, two in zip(*poses, strict=True):
        assert one.tick == two.tick
        np.testing.assert_array_equal(one.vertices, two.vertices)
    for name in p.LOOKS:
        assert getattr(other.settings, name) == getattr(scene.settings, name), name
    assert [step.label for step in other.journal.steps] == [s.label for s in scene.journal.steps]


def test_a_project_that_was_moved_opens_as_it_was_saved(scene, tmp_path):
    start = work(scene)
    model = scene.source.read_bytes()
    path = save_project(scene, start, tmp_path / "work.deformrf")
    assert scene.source == path
    with zipfile.ZipFile(path) as archive:
        assert archive.read("model.npz") == model
        assert json.loads(archive.read("project.json"))["file"] == "models/ball.npz"
    (tmp_path / "elsewhere").mkdir()
    moved = shutil.move(path, tmp_path / "elsewhere" / "other name.deformrf")
    shutil.rmtree(tmp_path / "models")
    project, other = reopened(moved)
    assert project.said == "" and project.source == moved and other.name == "other name"
    assert_same(scene, other)
    while other.undo():
        assert scene.undo()
    assert not scene.undo() and np.flatnonzero(other.solver.pinned).tolist() == start["pins"]
    np.testing.assert_array_equal(other.solver.vertices.numpy(), scene.solver.vertices.numpy())
    again = save_project(other, project.session.header["start"], tmp_path / "again.deformrf")
    with zipfile.ZipFile(again) as archive:
        assert archive.read("model.npz") == model
    assert_same(other, reopened(again)[1])


def test_saving_again_replaces_the_file_and_keeps_the_model(scene, tmp_path):
    path = save_project(scene, start := work(scene), tmp_path / "work.deformrf")
    shutil.rmtree(tmp_path / "models")
    scene.set_gravity(1.0)
    scene.clock.advance(0.1)
    save_project(scene, start, path)
    assert reopened(path)[1].body.gravity == 1.0
    assert [file.name for file in tmp_path.iterdir()] == ["work.deformrf"]


@pytest.mark.parametrize("name", BUNDLED)
def test_a_bundled_model_is_named(name, tmp_path):
    scene = scene_of(BUNDLED[name])
    start = start_of(scene)
    scene.set_gravity(2.0)
    path = save_project(scene, start, tmp_path / "work.deformrf")
    assert scene.source == BUNDLED[name] and path.stat().st_size < 2**16
    project, other = reopened(path)
    assert project.source == BUNDLED[name] and project.said == "" and other.body.gravity == 2.0
    rewrite(path, **{"project.json": changed_about(sha256="0" * 64)})
    assert "another version of the model" in load_project(path).said


@pytest.mark.parametrize("loss", ["never", "gone", "another", "size"])
def test_without_its_file_a_model_is_copied(scene, ball, make_ball_field, tmp_path, loss):
    if loss == "never":
        scene = Scene(ball, "ball", "cpu")
    elif loss == "gone":
        scene.source.unlink()
    elif loss == "another":
        fields.save(make_ball_field(7), scene.source)
    else:  # --object-size
        scene.field = replace(scene.field, meta={**scene.field.meta, "size": 3.0})
    path = save_project(scene, work(scene), tmp_path / "work.deformrf")
    project, other = reopened(path)
    assert_same(scene, other)
    if loss != "never":
        assert fields.same_values(project.field.table, scene.field.table)


def test_a_model_with_a_rig_and_stiffnesses_keeps_them(scene, tmp_path):
    for height in (0.2, 0.5, 0.8):
        scene.rigging.add_joint(np.array([0.5, 0.5, height]))
    arrays = rigs.arrays_of(scene.rigging.rig)
    stiffness = np.full(scene.field.mesh.vertex_count, 2.0, np.float32)
    fields.save(replace(scene.field, rig_arrays=arrays, stiffness=stiffness), scene.source)
    rigged = scene_of(scene.source)
    start = start_of(rigged)
    rigged.posing.hold_bone(1)
    rigged.posing.turn_bones([1], [[0.0, 0.6, 0.0, 0.8]])
    scene.source.unlink()  # else it is taken as it is
    path = save_project(rigged, start, tmp_path / "work.deformrf")
    other = reopened(path)[1]
    np.testing.assert_array_equal(other.positions, rigged.positions)
    assert other.rigging.bone_count == 2


def test_a_session_finds_its_model_in_the_project_that_it_was_saved_beside(
    scene, ball, make_ball_field, tmp_path
):
    path = save_project(scene, start := work(scene), tmp_path / "work.deformrf")
    session = save_session(scene, start, tmp_path / "s.jsonl")
    opened = open_session(session, make_ball_field(7, spacing=0.1), None)
    assert opened.source == path and "began with work.deformrf" in opened.said
    unpacked = tmp_path / "unpacked"
    zipfile.ZipFile(path).extractall(unpacked)
    opened = open_session(unpacked / "session.jsonl", make_ball_field(7, spacing=0.1), None)
    assert opened.source == unpacked / "model.npz"


def test_a_long_session_of_like_edits_is_no_bomb(scene, tmp_path, monkeypatch):
    monkeypatch.setattr("deformrf.core.base.archive.FREE_BYTES", 0)
    start = start_of(scene)
    for _ in range(40000):
        scene.journal.note("settle", count=1)
    path = save_project(scene, start, tmp_path / "work.deformrf")
    with zipfile.ZipFile(path) as archive:
        assert archive.getinfo("session.jsonl").compress_type == zipfile.ZIP_STORED
    assert len(load_project(path).session.events) == 40001  # and the view


def test_a_name_with_another_ending_is_refused(scene, tmp_path):
    with pytest.raises(ProjectError, match=r"has to end in \.deformrf"):
        save_project(scene, start_of(scene), tmp_path / "work.zip")
    assert not (tmp_path / "work.zip").exists()


def test_a_project_that_cant_be_written_stays_as_it_was(scene, tmp_path, monkeypatch):
    path = save_project(scene, start := work(scene), tmp_path / "work.deformrf")
    before = path.read_bytes()

    def fail(*arguments, **named):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(zipfile.ZipFile, "writestr", fail)
    with pytest.raises(OSError, match="No space left"):
        save_project(scene, start, path)
    assert path.read_bytes() == before and len(list(tmp_path.iterdir())) == 2


# -- damaged and forged ones -------------------------------------------------------------------


@pytest.fixture
def path(scene, tmp_path):
    return save_project(scene, work(scene), tmp_path / "work.deformrf")


def rewrite(path, kinds=None, **changes):
    """Replace entries; None removes one, a function changes it."""
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    for name, change in changes.items():
        entries[name] = change(entries[name]) if callable(change) else change
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in entries.items():
            if content is not None:
                archive.writestr(name, content, (kinds or {}).get(name, zipfile.ZIP_STORED))


def changed_about(**changes):
    return lambda content: json.dumps(json.loads(content) | changes)


def refused(path):
    """The sentence about a file."""
    with pytest.raises(ProjectError) as caught:
        load_project(path)
    sentence = str(caught.value)
    assert str(path) in sentence and sentence.isprintable() and len(sentence) < 700
    return sentence


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_download_that_was_cut_is_told_of(path, share):
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert "is not a project, or is damaged" in refused(path)


def test_other_files_are_no_projects(path, scene, tmp_path):
    assert "there is no project" in refused(tmp_path / "absent.deformrf")
    assert "not a file" in refused(tmp_path)
    path.write_text("no zip")
    assert "is not a project" in refused(path)
    fields.save(scene.field, tmp_path / "model.npz")
    model = (tmp_path / "model.npz").rename(path)
    assert "is not a project, or is damaged: it has no 'project.json'" in refused(model)


ABOUTS = {
    "version": ({p.KEY: 2}, "has version 2; this program reads 1"),
    "versions": ({p.KEY: [1] * 10**4}, "this program reads 1"),
    "bundled": ({"bundled": None}, "doesn't say where its model is"),
    "unknown": ({"bundled": True, "model": "../../etc"}, "has no model '../../etc'"),
    "list": ({"bundled": True, "model": ["fox"]}, "has no model"),
    "another": ({"bundled": True, "model": "fox"}, "the model fox of this program is not the one"),
    "hash": ({"sha256": "0" * 64}, "its model is damaged, or is not the one that was saved"),
    "no hash": ({"sha256": None}, "its model is damaged"),
}


@pytest.mark.parametrize("changes, sentence", ABOUTS.values(), ids=ABOUTS)
def test_what_a_project_says_of_itself_is_checked(path, changes, sentence):
    rewrite(path, **{"project.json": changed_about(**changes)})
    assert sentence in refused(path)


ENTRIES = {
    "no json": ({"project.json": b"{"}, "is damaged"),
    "nested": ({"project.json": b"[" * 10**5}, "is damaged"),
    "nan": ({"project.json": b"NaN"}, "doesn't say so"),
    "long": ({"project.json": b" " * (2**20 + 1)}, "'project.json' has 1048577 bytes, over"),
    "no session": ({"session.jsonl": None}, "it lacks 'session.jsonl'"),
    "session": ({"session.jsonl": b"{}\n"}, "is not a session"),
    "event": ({"session.jsonl": lambda text: text + b'[9, "exec", {}]\n'}, "unknown edit 'exec'"),
    "no model": ({"model.npz": None}, "it lacks 'model.npz'"),
    "model": ({"model.npz": b"no zip"}, "its model is damaged"),
}


@pytest.mark.parametrize("changes, sentence", ENTRIES.values(), ids=ENTRIES)
def test_entries_are_checked(path, changes, sentence):
    rewrite(path, **changes)
    assert sentence in refused(path)


def test_a_model_that_is_not_the_session_s_is_told_of(path, make_ball_field, tmp_path):
    """Though its hash is right; so is one that differs in its stiffness alone."""
    field = load_project(path).field
    factors = np.full(field.mesh.vertex_count, 2.0, np.float32)
    for other in (make_ball_field(7, spacing=0.1), replace(field, stiffness=factors)):
        fields.save(other, tmp_path / "other.npz")
        model = (tmp_path / "other.npz").read_bytes()
        about = changed_about(sha256=p._hash_of(model))
        rewrite(path, **{"model.npz": model, "project.json": about})
        assert "its model is not the one that its session began with" in refused(path)


def test_a_damaged_model_with_its_hash_is_told_of(path):
    rewrite(path, **{"model.npz": b"no", "project.json": changed_about(sha256=p._hash_of(b"no"))})
    assert "is not a model file" in refused(path)


def test_an_entry_twice_is_refused(path):
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("session.jsonl", "{}")
    assert "two entries of one name" in refused(path)


def test_other_entries_are_never_read_or_written(path, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    rewrite(path, **{"../../evil.txt": b"evil", "/tmp/evil": b"evil", "more.bin": b"x" * 10**6})
    load_project(path)
    assert sorted(tmp_path.rglob("*")) == before


def test_bombs_are_refused_before_they_take_memory(path, scene):
    text = zipfile.ZipFile(path).read("session.jsonl") + b" " * (100 * 2**20)
    deflated = {"session.jsonl": zipfile.ZIP_DEFLATED}
    rewrite(path, deflated, **{"session.jsonl": text})
    del text
    assert "unpacks to more than" in refused(path)
    assert peak_memory(lambda: refused(path)) < 50 * 2**20


def test_a_model_that_is_compressed_is_refused(path):
    rewrite(path, {"model.npz": zipfile.ZIP_DEFLATED})
    assert "its model is compressed" in refused(path)


def test_other_compressions_are_refused(path):
    rewrite(path, {"session.jsonl": zipfile.ZIP_LZMA})
    assert "'session.jsonl' is compressed in a way" in refused(path)


def test_an_entry_that_declares_more_than_it_has_is_damaged(path):
    content = bytearray(path.read_bytes())
    at = content.rindex(b"PK\x01\x02", 0, content.rindex(b"session.jsonl"))
    size = int.from_bytes(content[at + 24 : at + 28], "little")
    content[at + 24 : at + 28] = (size + 1000).to_bytes(4, "little")
    path.write_bytes(content)
    assert "damaged" in refused(path)


def test_unknown_and_bad_looks_are_left_out(path):
    looks = LOOKS | {
        "grab_radius": 1e9,
        "mode": "exec",
        "hand": ["pose"],
        "background": [0.0, float("nan"), 1.0],
        "target_fps": 1e9,
        "__class__": 3,
    }
    rewrite(path, **{"project.json": changed_about(looks=looks, orbit={"yaw": 1.0})})
    project = load_project(path)
    kept = LOOKS.keys() - {"grab_radius", "mode", "hand", "background"}
    assert project.looks.keys() == kept and project.orbit is None
    rewrite(path, **{"project.json": changed_about(looks=[1], orbit=7)})
    assert load_project(path).looks == {}


def test_random_damage_is_refused_or_harmless(path, seeded=20):
    """Whatever bytes are flipped: a sentence, or the project as it was."""
    random, whole = np.random.default_rng(seeded), path.read_bytes()
    expected = load_project(path)
    ends = len(whole) - 400  # the zip's list of entries, where most checks are
    refusals = 0
    for count in range(120):
        content = bytearray(whole)
        low = ends if count % 2 else 0
        for at in random.integers(low, len(whole), random.integers(1, 5)):
            content[at] ^= 1 << random.integers(8)
        path.write_bytes(content)
        try:
            found = load_project(path)
        except ProjectError as error:
            refusals += 1
            assert str(path) in str(error) and str(error).isprintable()
        else:
            assert found.session == expected.session and found.looks == expected.looks
            assert fields.same_values(found.field, expected.field)
    assert refusals > 60


def test_random_json_is_refused_or_harmless(path):
    """Values of project.json that are replaced by others, hash and zip being right."""
    random = np.random.default_rng(3)
    about = json.loads(zipfile.ZipFile(path).read("project.json"))
    others = [None, True, -1, 10**400, 1.5, "", "x" * 10**4, [], [[]], {}, {"a": {}}, "\ud800"]
    for _ in range(60):
        values = dict(about, looks=dict(about["looks"]), orbit=dict(about["orbit"]))
        place = values[str(random.choice(["looks", "orbit"]))] if random.integers(3) else values
        place[str(random.choice(list(place)))] = others[random.integers(len(others))]
        rewrite(path, **{"project.json": json.dumps(values)})
        try:
            project = load_project(path)
        except ProjectError as error:
            assert str(error).isprintable()
        else:
            project.apply_looks(Scene(project.field, "ball", "cpu"))
