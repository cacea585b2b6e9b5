"""Masks of photographs: where they lie, what they say, and that they become alpha."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deformrf.core.training import DatasetError, load_dataset
from deformrf.core.training.data.masks import mask_path, read_mask


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
