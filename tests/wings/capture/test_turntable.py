"""A box that turns on a table before a camera that stands still, from photographs to masks."""

import json
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from captures import circle, similarity_errors, write_capture, write_turntable
from PIL import Image

from deformrf.core.training import UNTOLD, load_dataset
from deformrf.wings.capture import (
    CaptureError,
    features,
    find_cameras,
    find_photos,
    still,
    summary,
    turntable,
    work,
)
from deformrf.wings.capture.carving import overlap

pytest.importorskip("pycolmap")
ANGLES, HEIGHTS = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), (1.2, 1.9)


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """The folder of photographs, the cameras as the box sees them, where the box is."""
    folder = tmp_path_factory.mktemp("turned") / "photos"
    return folder, *write_turntable(folder, ANGLES, HEIGHTS, np.random.default_rng(5))


@pytest.fixture(scope="module")
def found(turned, tmp_path_factory):
    return find_cameras(turned[0], tmp_path_factory.mktemp("work") / "m.capture")


def quietly(*arguments):
    """A phase that nobody sees."""
    return nullcontext(lambda done: None)


def extracted(folder, place):
    """The work on a folder of photographs, with their features."""
    photos, _ = find_photos(folder)
    begun, _ = work.open_work(place / "m.capture", photos, 1600)
    features.find_features(begun, quietly)
    return begun


def test_cameras_walk_around_the_object(turned, found):
    poses = turned[1]
    assert len(found.mapped.numbers) == len(poses)
    assert found.rings == (tuple(range(24)), tuple(range(24, 48)))
    assert found.mapped.is_on_circles
    centers, rotations = similarity_errors(found.mapped.poses, poses[found.mapped.numbers])
    assert np.median(centers) < 0.01
    assert np.median(rotations) < 0.6


def test_masks_are_where_the_object_is(turned, found):
    scores = []
    for number, mask in found.found.masks.items():
        told, true = mask != UNTOLD, turned[2][number]
        inside = mask > 127
        scores.append((inside & true & told).sum() / ((inside | true) & told).sum())
    assert np.mean(scores) > 0.9


def test_training_uses_masks_and_box(turned, found):
    folder = turned[0]
    scene = json.loads((folder / "transforms.json").read_text())
    assert scene["frames"][3]["mask_path"] == "masks/003.jpg.png"
    np.testing.assert_allclose(scene["object_box"], found.found.box)
    dataset = load_dataset(folder, "train")
    assert dataset.masked
    assert dataset.bounds is not None
    with Image.open(folder / "masks" / "003.jpg.png") as mask:
        row = dataset.names.index("003")
        np.testing.assert_array_equal(dataset.image(row)[..., 3], np.asarray(mask))


def test_what_was_done_is_told(found):
    told = summary(found)
    assert "The camera stood still: 48 photographs of a turntable in 2 rings." in told
    assert str(found.masks_at) in told
    assert f"about --aabb {found.found.box[0, 0]:.3g} " in told


def test_a_hand_does_not_stand_still(tmp_path):
    folder = tmp_path / "photos"
    write_capture(folder, circle(12), np.random.default_rng(7))
    assert still.find_rings(extracted(folder, tmp_path), quietly) == []


def test_the_same_photograph_again_and_again_turns_nothing(tmp_path):
    """A camera that stands still before something that stands still has no turntable."""
    folder = tmp_path / "photos"
    write_capture(folder, np.repeat(circle(2), 8, axis=0), np.random.default_rng(7))
    begun = extracted(folder, tmp_path)
    assert len(still.find_rings(begun, quietly)) == 2
    assert turntable.find_turning(begun, quietly) == []


def test_rings_that_do_not_fit_are_told_as_such(turned, tmp_path):
    """Every fifth photograph: the box turns by 60° from one to the next."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for path in sorted(turned[0].glob("*.jpg"))[::4]:
        (folder / path.name).write_bytes(path.read_bytes())
    with pytest.raises(CaptureError, match=r"stood still for 12 photographs .* 2 rings"):
        find_cameras(folder, tmp_path / "m.capture")


def test_rings_have_mattes_where_a_program_s_are_of_nothing(turned, found, tmp_path):
    """It took another corner of each photograph for the object."""
    photos, _ = find_photos(turned[0])
    begun, _ = work.open_work(tmp_path / "m.capture", photos, 1600, program="digest")
    for number, shown in enumerate(turned[2]):
        wrong = np.zeros(shown.shape, np.uint8)
        wrong[40 * (number % 4) :][:30, 4 * number :][:, :15] = 255
        begun.keep_matte(number, wrong, made=True)
        begun.keep_matte(number, np.where(shown, np.uint8(255), np.uint8(0)))
    masks = turntable.find_masks(begun, found.mapped, quietly)
    scores = [overlap(mask > 127, turned[2][n]) for n, mask in masks.masks.items()]
    assert np.mean(scores) > 0.9
    told = summary(replace(found, program="rembg", found=masks))
    assert "What rembg takes for the object is not one thing in space, so its masks are not" in told
    assert f"What turns was cut out by masks, in {found.masks_at}" in told
    assert "mended by the votes" not in told


@pytest.mark.soak
def test_masks_of_the_user_are_followed(turned, tmp_path):
    """Features, cameras and box are those of what the masks show; no masks are written."""
    folder = tmp_path / "photos"
    folder.mkdir()
    (tmp_path / "masks").mkdir()
    for number in range(48):
        name = f"{number:03d}"
        (folder / f"{name}.jpg").write_bytes((turned[0] / f"{name}.jpg").read_bytes())
        Image.fromarray(255 * turned[2][number].astype(np.uint8)).save(
            tmp_path / "masks" / f"{name}.png"
        )
    capture = find_cameras(folder, tmp_path / "m.capture", masks=tmp_path / "masks")
    rows = capture.mapped.numbers
    assert len(rows) >= 44
    centers, _ = similarity_errors(capture.mapped.poses, turned[1][rows])
    assert np.median(centers) < 0.02
    assert capture.masks_at is None
    assert not (folder / "masks").exists()
    assert capture.found.box.shape == (2, 3)
