"""Photographs alone to cameras: of a scene that is rendered here, so they are known."""

import json
import os
import shutil
import signal
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from captures import circle, similarity_errors, write_capture
from PIL import Image

from deformrf.commands import capturing, train
from deformrf.commands.running import INTERRUPTED
from deformrf.core.field import modelfile
from deformrf.core.render import Lens, has_rays
from deformrf.core.training import SparsePoints, load_dataset, load_points
from deformrf.wings import capture
from deformrf.wings.capture import (
    CaptureError,
    cameras,
    find_cameras,
    library,
    mapping,
    matching,
    work,
)

pytest.importorskip("pycolmap")
COUNT = 16
TURNED = {3: Image.Transpose.ROTATE_180, 6: Image.Transpose.ROTATE_90}  # to be stored so


@pytest.fixture(scope="module")
def poses():
    return circle(COUNT)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory, poses):
    folder = tmp_path_factory.mktemp("rendered")
    write_capture(folder, poses, np.random.default_rng(7))
    return folder


@pytest.fixture
def photos(rendered, tmp_path):
    """A folder of photographs without cameras."""
    return shutil.copytree(rendered, tmp_path / "my photos")


def test_the_cameras_of_photographs_are_recovered(photos, poses, tmp_path):
    """Photographs that are stored lying or upside down count as EXIF turns them."""
    for name, number in (("003", 6), ("006", 3)):
        exif = Image.Exif()
        exif[0x0112] = number
        image = Image.open(photos / f"{name}.jpg").transpose(TURNED[number])
        image.save(photos / f"{name}.jpg", quality=95, exif=exif)
    found = find_cameras(photos, tmp_path / "work")
    assert len(found.photos) == COUNT and found.mapped.pixel_error < 0.5
    assert not (tmp_path / "work").exists()
    views = load_dataset(photos, "train")
    assert {(lens.width, lens.height) for lens in views.lenses} == {(240, 180)}
    assert views.lenses[0].focal == pytest.approx((210.0, 210.0), rel=0.02)
    truth = poses[[int(name) for name in views.names]]
    centers, rotations = similarity_errors(views.poses, truth)
    assert np.median(centers) < 0.005 and centers.max() < 0.02
    assert np.median(rotations) < 0.3 and rotations.max() < 1.0
    # The images are read as the cameras saw them.
    third = views.image(views.names.index("003"))[..., :3].astype(int)
    neighbor = views.image(views.names.index("002"))[..., :3].astype(int)
    assert abs(third[:40].mean() - neighbor[:40].mean()) < 20
    check_points(views, load_points(photos))


def test_up_is_up_though_all_cameras_look_down_from_one_side():
    """Their mean up direction leans."""
    poses, count = circle(12, end=0.5 * np.pi), np.ones(12)
    points = SparsePoints(
        *(np.zeros((1, 3), kind) for kind in (np.float32, np.uint8)),
        *(np.zeros(1, kind) for kind in (np.int32, np.float32)),
    )
    turn = np.linalg.qr(np.random.default_rng().normal(size=(3, 3)))[0]
    poses[:, :3] = turn * np.linalg.det(turn) @ poses[:, :3]
    mapped = mapping.Mapped(
        np.arange(12), poses, np.ones((12, 7)), points, count, count, 0.5, groups=()
    )
    rotations = cameras.placed(mapped).poses[:, :3, :3]
    assert abs(rotations[:, 2, 0]).max() < 1e-9 and (rotations[:, 2, 1] > 0.5).all()


def check_points(views, points):
    """They lie in front of the cameras, and have the colors of the pixels that show them."""
    assert len(points.points) > 200 and points.track_length.min() >= 2
    view, lens = np.linalg.inv(views.poses[0]), views.lenses[0]
    local = points.points @ view[:3, :3].T + view[:3, 3]
    assert (local[:, 2] < 0).mean() > 0.99
    columns = (lens.center[0] - lens.focal[0] * local[:, 0] / local[:, 2]).astype(int)
    rows = (lens.center[1] + lens.focal[1] * local[:, 1] / local[:, 2]).astype(int)
    inside = (columns >= 0) & (columns < lens.width) & (rows >= 0) & (rows < lens.height)
    shown = views.image(0)[rows[inside], columns[inside], :3].astype(int)
    difference = np.abs(shown - points.colors[inside]).mean(axis=1)
    assert np.median(difference) < 30, "a point has the color of the pixel that shows it"


def test_an_interrupted_search_goes_on(photos, tmp_path, monkeypatch):
    kept = tmp_path / "work"
    with monkeypatch.context() as patched:
        patched.setattr(cameras, "map_photos", interrupted)
        with pytest.raises(KeyboardInterrupt):
            find_cameras(photos, kept)
    calls = []
    (kept / "000003.npz").unlink()  # an interrupt came between features and look
    pycolmap = library.load_pycolmap()
    for name in ("extract_features", "estimate_two_view_geometry"):
        monkeypatch.setattr(pycolmap, name, lambda *a, name=name, **n: calls.append(name))
    assert len(find_cameras(photos, kept).photos) == COUNT
    assert not calls, "features and matches were kept"


def interrupted(*_):
    raise KeyboardInterrupt


def test_work_on_other_photographs_is_not_taken(photos, tmp_path):
    found, _ = capture.photos.find_photos(photos)
    for chosen, size, known in ((found, 99, False), (found, 99, True), (found, 98, False)):
        assert work.open_work(tmp_path / "work", chosen, size)[1] == known
    Image.new("RGB", (240, 180)).save(photos / "005.jpg")
    changed, _ = capture.photos.find_photos(photos)
    assert not work.open_work(tmp_path / "work", changed, 98)[1]
    assert not work.open_work(tmp_path / "work", changed[1:], 98)[1]


def test_other_files_where_the_work_would_be_are_left_alone(photos, tmp_path):
    place = tmp_path / "work"
    place.mkdir()
    (place / "letter.txt").write_text("dear")
    assert len(find_cameras(photos, place).photos) == COUNT
    assert (place / "letter.txt").read_text() == "dear" and len([*place.iterdir()]) == 1
    assert not place.with_name("work-2").exists()


@pytest.fixture
def ctrl_c():
    """A function that presses Ctrl-C soon, also where the shell has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield lambda: threading.Timer(0.2, signal.raise_signal, [signal.SIGINT]).start()
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_a_call_of_the_library(ctrl_c):
    """The call learns it from its token; the handlers of signals are Python's."""

    def long_call(cancellation_token):
        while not cancellation_token.is_cancelled:
            time.sleep(0.01)

    ctrl_c()
    with pytest.raises(KeyboardInterrupt):
        library.interruptible(long_call)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_transforms_are_never_overwritten(photos, tmp_path):
    (photos / "transforms.json").write_text("mine")
    with pytest.raises(CaptureError, match="not overwritten"):
        find_cameras(photos, tmp_path / "work")
    assert (photos / "transforms.json").read_text() == "mine"


def make_text(folder):
    for number in range(20):
        (folder / f"{number}.jpg").write_text("no photograph")


def make_blank(folder):
    rng = np.random.default_rng()
    for number in range(10):
        wall = np.full((120, 160, 3), 230) + rng.integers(-1, 2, (120, 160, 1))
        Image.fromarray(wall.astype(np.uint8)).save(folder / f"{number}.jpg")


def make_two_groups(folder):
    rng = np.random.default_rng(5)
    for first in (0, 20):
        write_capture(folder, circle(6, end=2.0), rng, first=first)


@pytest.mark.parametrize(
    "make, sentence",
    [
        (make_text, "of 20 photographs in .* only 0 can be read"),
        (lambda f: Image.new("RGB", (80, 60)).save(f / "a.jpg"), "holds 1 photograph, and at lea"),
        (make_blank, "hardly any texture .* patterned"),
        (make_two_groups, r"2 groups .*6 from 0.0.jpg to .*the way from one to the other"),
        (lambda f: None, "holds no photographs"),
    ],
)
def test_photographs_without_cameras_end_in_one_sentence(tmp_path, make, sentence):
    folder = tmp_path / "photos"
    folder.mkdir()
    make(folder)
    with pytest.raises(CaptureError, match=sentence) as caught:
        find_cameras(folder, tmp_path / "work")
    assert "\n" not in str(caught.value)
    assert not (folder / "transforms.json").exists()


def test_a_photograph_of_something_else_is_left_out_and_named(photos, tmp_path):
    noise = np.random.default_rng().integers(0, 256, (180, 240, 3)).astype(np.uint8)
    Image.fromarray(noise).save(photos / "odd.png")
    (photos / "broken.jpg").write_bytes((photos / "000.jpg").read_bytes()[:900])
    found = find_cameras(photos, tmp_path / "work", image_size=200)
    # They were worked at that size, and their lenses are those of the files.
    assert {tuple(lens[5:]) for lens in found.mapped.lenses} == {(200, 150)}
    frame = json.loads((photos / "transforms.json").read_text())["frames"][0]
    assert (frame["w"], frame["h"]) == (240, 180)
    assert frame["fl_x"] == pytest.approx(210.0, rel=0.03)
    assert len(found.photos) == COUNT and set(found.left_out) == {"odd.png", "broken.jpg"}
    assert "odd.png" in capture.summary(found) and "broken.jpg" in found.unreadable[0]


def test_training_starts_with_photographs(call, trainer, photos, tmp_path):
    output = tmp_path / "m.npz"
    result = call(train.main, photos, "-o", output, "--device", "cpu", "--scene-radius", 1)
    assert result.code == 0, result.err
    assert f"The cameras of {COUNT} of {COUNT} photographs were found" in result.out
    assert trainer.calls[0][0].view_count == COUNT - 2  # every eighth is a test view
    assert modelfile.load(output)
    again = call(train.main, photos, "-o", output, "--device", "cpu", "--scene-radius", 1)
    assert again.code == 0 and "were found" not in again.out, "the cameras are there by now"


def test_the_command_keeps_what_was_done_at_ctrl_c(call, trainer, photos, tmp_path, monkeypatch):
    flags = (photos, "-o", tmp_path / "m.npz", "--device", "cpu", "--scene-radius", 1)
    with monkeypatch.context() as patched:
        patched.setattr(cameras, "map_photos", interrupted)
        result = call(train.main, *flags)
    assert result.code == INTERRUPTED and not trainer.calls
    assert "the same command goes on there" in result.err
    assert call(train.main, *flags, "--resume").code == 0
    assert len(trainer.calls) == 1 and not (tmp_path / "m.capture").exists()


def test_pairs_of_few_photographs_are_all_of_videos_those_near_and_keys():
    assert len(matching.pairs_to_match(range(50), False)) == 50 * 49 // 2
    for count in (30, 400, 2000):
        pairs = matching.pairs_to_match(range(count), True)
        assert len(set(pairs)) == len(pairs) < min(count * 13 + 5100, count * (count - 1) / 2)
        assert {(i, i + 1) for i in range(count - 1)} <= set(pairs)


def test_the_fuller_of_two_tries_is_taken(photos, tmp_path, monkeypatch):
    """Incremental mapping that stops early makes way for global mapping."""
    monkeypatch.setattr(mapping, "incremental", lambda *_, **named: [])
    assert len(find_cameras(photos, tmp_path / "work").photos) == COUNT


def test_lenses_that_bend_back_before_the_corner_are_known():
    """As core/render judges them, which refuses such lenses in data sets."""
    rng, answers = np.random.default_rng(), set()
    for k1, focal in zip(rng.uniform(-0.6, 0.3, 60), rng.uniform(150, 400, 60), strict=True):
        numbers = SimpleNamespace(params=(focal, 120.0, 90.0, k1), width=240, height=180)
        lens = Lens(240, 180, (focal, focal), (120.0, 90.0), (k1, 0.0, 0.0, 0.0))
        answers.add(has_rays(lens))
        assert mapping.reaches_corners(numbers) == has_rays(lens), (k1, focal)
    assert answers == {True, False}


def test_portrait_and_landscape_photographs_are_used_together(photos, poses, tmp_path):
    """A telephone that was turned: each shape has a lens of its own."""
    for number in range(0, COUNT, 3):
        path = photos / f"{number:03d}.jpg"
        image = Image.open(path)
        image.crop((52, 0, 188, 180)).save(path, quality=95)
    found = find_cameras(photos, tmp_path / "work")
    # Cropped pictures show less to match, and COLMAP's threads make runs differ: of some dozens,
    # one left out one of them.
    assert len(found.left_out) <= 1 and len(found.photos) == COUNT - len(found.left_out)
    views = load_dataset(photos, "train")
    assert {(lens.width, lens.height) for lens in views.lenses} == {(240, 180), (136, 180)}
    focals = [lens.focal[0] for lens in views.lenses]
    assert focals == pytest.approx([210.0] * len(focals), rel=0.05)
    truth = poses[[int(name) for name in views.names]]
    centers, rotations = similarity_errors(views.poses, truth)
    # 0.010 and 0.58 were seen.
    assert np.median(centers) < 0.02 and np.median(rotations) < 1.0


def test_other_workers_wait_for_the_cameras_that_the_first_finds(photos, tmp_path, monkeypatch):
    """Of several processes that torchrun starts, one looks for cameras."""
    monkeypatch.setattr(capturing, "WAIT_SECONDS", 0.01)
    monkeypatch.setattr(capturing, "found_by", lambda *_: pytest.fail("it is not the first"))
    monkeypatch.setenv("RANK", "1")
    waits = []

    def sleep(seconds):
        waits.append(seconds)
        if len(waits) == 3:
            (photos / "transforms.json").write_text('{"made_by": "deformrf-train", "frames": []}')

    monkeypatch.setattr(capturing.time, "sleep", sleep)
    found = capturing.prepared(photos, tmp_path / "m.npz", None)
    assert len(waits) == 3 and found == (photos, capture.IMAGE_SIZE)


def test_global_mapping_ends_at_ctrl_c(ctrl_c):
    """It runs in a process of its own, which is ended."""
    began = time.monotonic()
    ctrl_c()
    with pytest.raises(KeyboardInterrupt):
        mapping.run_alone("import time; time.sleep(600)")
    assert time.monotonic() - began < 60.0


def test_a_pipe_is_no_capture(tmp_path):
    """Nobody writes to it: reading would never end."""
    os.mkfifo(tmp_path / "transforms.json")
    assert not capture.is_capture(tmp_path)
