"""Photographs with an EXIF orientation: whether cameras are those of the turned images."""

import json
from pathlib import Path

import numpy as np
import pytest
from colmap_files import circle, some_sparse, write_binary
from PIL import Image, ImageOps

from deformrf.core.base.images import ORIENTATION
from deformrf.core.training import DatasetError, list_images, load_dataset, read_image, size_of

WIDE, TALL = (16, 12), (12, 16)  # width and height


def save(path, size, number):
    """Write random pixels with an orientation; them as they are stored, and as it turns them."""
    rng = np.random.default_rng()
    exif = Image.Exif()
    exif[ORIENTATION] = number
    path.parent.mkdir(parents=True, exist_ok=True)
    image = Image.fromarray(rng.integers(0, 256, (size[1], size[0], 3), np.uint8))
    image.save(path)
    stored = Image.open(path).convert("RGB")  # as JPEG has them
    image.save(path, exif=exif)
    turned = ImageOps.exif_transpose(Image.open(path)).convert("RGB")
    return np.asarray(stored), np.asarray(turned)


def as_colmap(folder, photos):
    """A COLMAP model of the photographs: (name, stored size, stated size, orientation) each."""
    sizes = sorted({stated for _, _, stated, _ in photos})
    cameras = {
        i + 1: ("SIMPLE_PINHOLE", *size, (20.0, size[0] / 2, size[1] / 2))
        for i, size in enumerate(sizes)
    }
    sparse = some_sparse([name for name, *_ in photos], cameras)
    sparse.images = [
        (number, pose, sizes.index(stated) + 1, name, features)
        for (number, pose, _, name, features), (_, _, stated, _) in zip(
            sparse.images, photos, strict=True
        )
    ]
    write_binary(sparse, folder / "sparse/0")
    return {name: save(folder / "images" / name, size, n) for name, size, _, n in photos}


def as_transforms(folder, photos, file="transforms.json", **more):
    """The same as transforms.json with sizes of each frame; without a size where that is None."""
    frames = [
        {"file_path": f"images/{name}", "transform_matrix": pose.tolist(), "fl_x": 20.0, **more}
        | ({} if stated is None else {"w": stated[0], "h": stated[1]})
        for (name, _, stated, _), pose in zip(photos, circle(len(photos)), strict=True)
    ]
    folder.mkdir(exist_ok=True)
    (folder / file).write_text(json.dumps({"frames": frames}))
    return {name: save(folder / "images" / name, size, n) for name, size, _, n in photos}


WRITERS = pytest.mark.parametrize("write", [as_colmap, as_transforms])
ENDINGS = pytest.mark.parametrize("ending", ["png", "jpg", "tif"])


def loaded(folder):
    """All images of both splits by name, without their ending."""
    found = {}
    for split in ("train", "test"):
        dataset = load_dataset(folder, split)
        found |= {name: dataset.image(i)[..., :3] for i, name in enumerate(dataset.names)}
    return found


def photos_of(is_turned, ending="png"):
    """Every orientation among upright photographs; the stated sizes of 5 to 8 tell."""
    photos = [(f"{i}.{ending}", WIDE, WIDE, 1) for i in range(3)]
    for number in range(2, 9):
        stated = TALL if is_turned and number >= 5 else WIDE
        photos.append((f"turn{number}.{ending}", WIDE, stated, number))
    return photos


@WRITERS
@ENDINGS
@pytest.mark.parametrize("is_turned", [True, False], ids=["turned", "stored"])
@pytest.mark.parametrize("teller", [5, 6, 7, 8])
def test_what_one_portrait_tells_holds_for_all(tmp_path, write, ending, is_turned, teller):
    """Also for those turned by a half or mirrored, whose size is the same either way."""
    photos = [p for p in photos_of(is_turned, ending) if p[3] <= 4 or p[3] == teller]
    photos.append((f"square.{ending}", (12, 12), (12, 12), 6))
    written = write(tmp_path, photos)
    found = loaded(tmp_path)
    assert len(found) == len(written)
    for name, (stored, turned) in written.items():
        expected = turned if is_turned else stored
        np.testing.assert_array_equal(found[Path(name).stem], expected, err_msg=name)
    assert load_dataset(tmp_path, "train").said == ()


@pytest.mark.parametrize("is_turned", [True, False], ids=["turned", "stored"])
def test_the_training_images_tell_about_the_test_images(tmp_path, is_turned):
    """A split's own file may have none that tells."""
    portrait = [p for p in photos_of(is_turned) if p[3] in (1, 6)]
    as_transforms(tmp_path, portrait, "transforms_train.json")
    written = as_transforms(tmp_path, [("half.png", WIDE, WIDE, 3)], "transforms_test.json")
    stored, turned = written["half.png"]
    image = load_dataset(tmp_path, "test").image(0)[..., :3]
    np.testing.assert_array_equal(image, turned if is_turned else stored)


def test_each_image_alone_is_turned_as_the_set_is(tmp_path):
    """As the viewer reads them."""
    written = as_colmap(tmp_path, photos_of(True))
    images = list_images(tmp_path, "train").images
    for image in images:
        expected = written[image.path.name][1]
        assert size_of(image) == expected.shape[1::-1]
        np.testing.assert_array_equal(read_image(image, *size_of(image))[..., :3], expected)


@WRITERS
def test_sizes_that_contradict_each_other_are_refused(tmp_path, write):
    photos = [("a.png", WIDE, TALL, 6), ("b.png", WIDE, WIDE, 8), ("c.png", WIDE, WIDE, 1)]
    write(tmp_path, photos)
    sentence = r"size of .*a\.png as its EXIF.*that of .*b\.png as it is stored \(1 and 1"
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(tmp_path, "train")
    assert "\n" not in str(caught.value)


@WRITERS
def test_where_nothing_tells_images_are_read_as_stored_and_that_is_said(tmp_path, write):
    photos = [("a.png", WIDE, WIDE, 1), ("b.png", WIDE, WIDE, 3), ("c.png", WIDE, WIDE, 1)]
    written = write(tmp_path, photos)
    dataset = load_dataset(tmp_path, "train")
    np.testing.assert_array_equal(dataset.image(0)[..., :3], written["b.png"][0])
    (line,) = dataset.said
    assert line.startswith("the EXIF orientations of 1 photographs (first ")
    assert "b.png, 3)" in line


def test_a_size_of_another_frame_tells_about_one_without(tmp_path):
    photos = [("a.png", WIDE, TALL, 6), ("b.png", WIDE, None, 3), ("c.png", WIDE, None, 1)]
    written = as_transforms(tmp_path, photos)
    np.testing.assert_array_equal(loaded(tmp_path)["b"], written["b.png"][1])


def test_what_the_file_says_comes_first(tmp_path):
    written = as_transforms(tmp_path, [("a.png", WIDE, WIDE, 3)] * 2, upright=True)
    dataset = load_dataset(tmp_path, "train")
    np.testing.assert_array_equal(dataset.image(0)[..., :3], written["a.png"][1])
    assert dataset.said == ()


def test_images_outside_the_folder_are_not_opened_to_tell(tmp_path, monkeypatch):
    photos = [("a.png", WIDE, WIDE, 1), ("b.png", WIDE, WIDE, 3), ("c.png", WIDE, TALL, 6)]
    written = as_transforms(tmp_path / "data", photos[:2], "transforms_train.json")
    save(tmp_path / "c.png", WIDE, 6)
    as_transforms(tmp_path / "data", [("../../c.png", WIDE, TALL, 6)], "transforms_test.json")
    dataset = load_dataset(tmp_path / "data", "train")
    np.testing.assert_array_equal(dataset.image(1)[..., :3], written["b.png"][0])
    assert len(dataset.said) == 1


def test_upright_photographs_are_opened_once(tmp_path, monkeypatch):
    """Nothing is looked at for what no photograph asks."""
    from deformrf.core.training.data import turning

    as_colmap(tmp_path, [(f"{i}.png", WIDE, WIDE, 1) for i in range(4)])
    monkeypatch.setattr(turning, "open_image", None)
    assert load_dataset(tmp_path, "train").view_count == 3
