"""Masks of photographs: where they lie, what they say, and that they become alpha."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from posed_data import PHONE, put, transforms

from deformrf.core.training import UNTOLD, DatasetError, load_dataset, mask_paths, read_mask
from deformrf.core.training.data.masks import mask_path


@pytest.fixture
def captured(tmp_path, write_dataset):
    """Three photographs without alpha, and their masks' folder, empty."""
    rng = np.random.default_rng()
    images = [Image.fromarray(rng.integers(0, 256, (12, 16, 3), np.uint8)) for _ in range(3)]
    write_dataset(tmp_path, images, "train")
    (tmp_path / "masks").mkdir()
    return tmp_path, images


def half_mask():
    mask = np.zeros((12, 16), np.uint8)
    mask[:, :8] = 255
    return mask


@pytest.mark.parametrize(
    "name", ["{}.png", "{}_mask.png", "{}-mask.PNG", "{}.jpg.png", "sub/{}.webp"]
)
def test_common_names_are_found(tmp_path, name):
    image = Path("sub/0007.jpg")
    path = tmp_path / name.format("0007")
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"-")
    assert mask_path(tmp_path, image) == path
    assert mask_path(tmp_path, Path("sub/0008.jpg")) is None


def test_a_photograph_is_not_its_own_mask(tmp_path):
    photograph = tmp_path / "a.png"
    photograph.write_bytes(b"-")
    assert mask_path(tmp_path, photograph) is None


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "1"])
def test_white_or_opaque_is_the_object(tmp_path, mode):
    mask = Image.fromarray(half_mask())
    if mode == "RGBA":
        stored = Image.new("RGBA", mask.size, (90, 10, 40, 255))
        stored.putalpha(mask)
    else:
        stored = mask.convert(mode)
    stored.save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 16, 12), half_mask())
    assert read_mask(tmp_path / "m.png", 8, 6).tolist() == half_mask()[::2, ::2].tolist()


def class_mask(kind):
    """A mask whose left half is an object's, as programs that segment images write them."""
    inside = half_mask() > 0
    if kind in ("red", "blue"):
        return Image.fromarray(inside[..., None] * np.uint8([255 * (kind == c) for c in CHANNELS]))
    number = int(kind.split()[-1])
    image = Image.fromarray((inside * number).astype(np.uint8))
    if "palette" in kind:
        image = Image.fromarray(np.asarray(image), "P")
        image.putpalette([0, 0, 0] * number + [192, 128, 0])
    return image


CHANNELS = "red", "green", "blue"


@pytest.mark.parametrize(
    "kind", ["class 1", "class 15", "class 128", "palette 1", "palette 15", "red", "blue"]
)
def test_numbers_and_colors_of_classes_are_the_object_in_full(tmp_path, kind):
    class_mask(kind).save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 16, 12), half_mask())


def test_what_is_soft_stays_soft(tmp_path):
    soft = np.linspace(0, 250, 192).astype(np.uint8).reshape(12, 16)
    Image.fromarray(soft).save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 16, 12), soft)


def test_another_shape_is_refused(tmp_path):
    Image.fromarray(half_mask()).save(tmp_path / "m.png")
    with pytest.raises(DatasetError, match="16x12 pixels, which is another shape"):
        read_mask(tmp_path / "m.png", 12, 16)


def test_masks_become_alpha(captured):
    folder, images = captured
    plain = load_dataset(folder, "train")
    assert not plain.has_alpha and not plain.masked
    for name in plain.names:
        Image.fromarray(half_mask()).save(folder / "masks" / f"{name}.png")
    masked = load_dataset(folder, "train", for_training=True, masks=folder / "masks")
    assert masked.masked and masked.has_alpha
    np.testing.assert_array_equal(masked.pixels[:, :3], plain.pixels[:, :3])
    for view in range(3):
        np.testing.assert_array_equal(masked.image(view)[..., 3], half_mask())
    assert len(images) == masked.view_count


def test_what_is_wrong_with_masks_is_said(captured):
    folder, _ = captured
    names = load_dataset(folder, "train").names

    def load(masks="masks", for_training=True):
        return load_dataset(folder, "train", for_training=for_training, masks=folder / masks)

    with pytest.raises(DatasetError, match="is not a folder"):
        load("nothing")
    for name in names[1:]:
        Image.fromarray(0 * half_mask()).save(folder / "masks" / f"{name}.png")
    with pytest.raises(DatasetError, match=f"1 of 3 photographs have no mask .* first {names[0]}"):
        load()
    assert (load(for_training=False).image(0)[..., 3] == 255).all()
    Image.fromarray(0 * half_mask()).save(folder / "masks" / f"{names[0]}.png")
    with pytest.raises(DatasetError, match="black everywhere"):
        load()
    (folder / "masks" / f"{names[0]}.png").write_bytes(b"no image")
    with pytest.raises(DatasetError, match="can't be read as an image"):
        load()


def test_a_mask_is_turned_as_its_photograph(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(half_mask()).save(tmp_path / "m.png", exif=exif)
    turned = read_mask(tmp_path / "m.png", 12, 16, upright=True)
    assert turned.shape == (16, 12) and (turned[:8] == 255).all() and (turned[8:] == 0).all()


# -- masks that the data set's files name ---------------------------------------------------------


@pytest.fixture
def named(tmp_path):
    """A transforms.json whose frames name masks, half white, and the masks."""
    for i in range(9):
        (tmp_path / "masks").mkdir(exist_ok=True)
        half = Image.fromarray(np.pad(half_mask(), ((0, 28), (0, 14)), mode="edge"))
        half.save(tmp_path / f"masks/{i}.png")
    return transforms(tmp_path, per_frame=lambda i: {"mask_path": f"masks/{i}.png"}, **PHONE)


def rewrite(folder, change):
    """Apply a function to each frame of a transforms.json."""
    scene = json.loads((folder / "transforms.json").read_text())
    for i, frame in enumerate(scene["frames"]):
        change(i, frame)
    (folder / "transforms.json").write_text(json.dumps(scene))


SAID = "the masks that mask_path names are used: white is the object, black is left out"


@pytest.mark.parametrize("split", ["train", "test"])
def test_masks_that_the_files_name_become_alpha(named, split):
    data = load_dataset(named, split, for_training=split == "train")
    assert data.masked and data.said == (SAID,)
    for view in range(data.view_count):
        alpha = data.image(view)[..., 3]
        assert (alpha[:, :8] == 255).all() and not alpha[:, 8:].any()


@pytest.mark.parametrize(
    "name", ["/home/x/toy/masks/{}.PNG", "masks\\{}.png", ".\\masks\\{}", "C:\\x\\masks\\{}.jpeg"]
)
def test_their_paths_follow_the_rule_of_images(named, name):
    rewrite(named, lambda i, frame: frame.update(mask_path=name.format(i)))
    data = load_dataset(named, "train", for_training=True)
    assert data.masked and data.image(0)[0, :, 3].tolist() == 8 * [255] + 22 * [0]
    assert "9 of 9 paths in transforms.json do not exist: files of" in data.said[0]


def test_a_folder_of_masks_stands_over_those_that_the_files_name(named):
    (named / "other").mkdir()
    for i in range(9):
        Image.new("L", (30, 40), 255).save(named / f"other/{i:04d}.png")
    data = load_dataset(named, "train", for_training=True, masks=named / "other")
    assert (data.pixels[:, 3] == 255).all() and data.masked and SAID not in data.said


def test_masks_of_which_none_is_there_are_told_of(named):
    for path in (named / "masks").iterdir():
        path.unlink()
    data = load_dataset(named, "train", for_training=True)
    assert not data.masked and not data.has_alpha
    assert "none of the masks that mask_path names is there" in data.said[0]


@pytest.mark.parametrize("way", ["missing", "unnamed"])
def test_masks_of_some_photographs_alone_are_refused(named, way):
    if way == "missing":
        (named / "masks/3.png").unlink()
    else:
        rewrite(named, lambda i, frame: frame.pop("mask_path") if i == 3 else None)
    mask = "masks/3.png" if way == "missing" else "none"
    with pytest.raises(DatasetError, match=f"1 of 7 .* first 0003.png, mask {mask}: add") as caught:
        load_dataset(named, "train", for_training=True)
    assert "\n" not in str(caught.value)
    assert load_dataset(named, "train").image(2)[..., 3].all()  # where it isn't for training


@pytest.mark.parametrize("size", [(60, 80), (15, 20)])
def test_a_mask_of_another_size_is_resized(named, size):
    for path in (named / "masks").iterdir():
        half = Image.fromarray(half_mask()).resize((30, 40), Image.Resampling.NEAREST)
        half.resize(size, Image.Resampling.NEAREST).save(path)
    alpha = load_dataset(named, "train", for_training=True).image(0)[..., 3]
    assert (alpha[:, :14] == 255).all() and not alpha[:, 17:].any()


def test_a_mask_of_another_shape_or_of_black_alone_is_refused(named):
    Image.new("L", (40, 30), 255).save(named / "masks/1.png")
    with pytest.raises(DatasetError, match=r"the mask .*1\.png has 40x30 pixels"):
        load_dataset(named, "train", for_training=True)
    for path in (named / "masks").iterdir():
        Image.new("L", (30, 40), 0).save(path)
    with pytest.raises(DatasetError, match="the masks that mask_path names are black everywhere"):
        load_dataset(named, "train", for_training=True)


def test_a_mask_that_is_not_there_is_quoted_in_one_line(named):
    rewrite(
        named,
        lambda i, frame: frame.update(mask_path="a\n\x1b[31m" if i == 3 else f"masks/{i}.png"),
    )
    with pytest.raises(DatasetError, match=r"1 of .* photographs have no mask") as caught:
        load_dataset(named, "train", for_training=True)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("value", [5, True, ["a"], {"a": 1}])
def test_a_mask_path_that_is_no_name_is_refused(named, value):
    rewrite(named, lambda i, frame: frame.update(mask_path=value))
    with pytest.raises(DatasetError, match=r"mask_path = .*: it has to be a name"):
        load_dataset(named, "train")


def test_a_mask_outside_the_folder_is_refused_unless_asked_for(named, tmp_path_factory):
    other = tmp_path_factory.mktemp("other") / "m.png"
    Image.new("L", (30, 40), 255).save(other)
    rewrite(named, lambda i, frame: frame.update(mask_path=str(other)))
    with pytest.raises(DatasetError, match=r"m\.png lies outside the data set's folder"):
        load_dataset(named, "train")
    assert load_dataset(named, "train", outside=True).masked


@pytest.mark.parametrize("mode", ["L", "P"])
def test_numbers_of_classes_are_white(tmp_path, mode):
    """Masks with 0 and 1 are nearly black; 0 is the background."""
    classes = Image.fromarray(half_mask() // 255)
    if mode == "P":
        classes.putpalette([0, 0, 0, 1, 1, 1])
    classes.save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 16, 12), half_mask())


def test_two_photographs_of_one_name_need_folders_of_masks(tmp_path):
    images = [put(tmp_path / f"images/{place}/1.jpg") for place in ("a", "b")]
    put(tmp_path / "masks/1.png")
    posed = [SimpleNamespace(path=path) for path in images]
    with pytest.raises(DatasetError, match=r"1\.jpg and .*1\.jpg have one mask, .*1\.png: put"):
        mask_paths(tmp_path / "masks", posed)
    for place in "ab":
        put(tmp_path / f"masks/{place}/1.png")
    found = mask_paths(tmp_path / "masks", posed)
    assert [path.parent.name for path in found] == ["a", "b"]


def test_pixels_of_which_nothing_tells_stay_such_when_shrunk(tmp_path):
    """Where masks are shrunk, what is untold in part is untold: no mean of it says anything."""
    mask = half_mask()
    mask[2:5, 3:6] = UNTOLD
    Image.fromarray(mask).save(tmp_path / "m.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "m.png", 16, 12), mask)
    small = read_mask(tmp_path / "m.png", 8, 6)
    expected = (mask == UNTOLD).reshape(6, 2, 8, 2).any(axis=(1, 3))
    np.testing.assert_array_equal(small == UNTOLD, expected)
    assert (small[~expected] == half_mask()[::2, ::2][~expected]).all()
