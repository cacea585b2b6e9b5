"""The layout of Tanks and Temples, in a small folder."""

import numpy as np
import pytest
from PIL import Image

from deformrf.core.render import look_at
from deformrf.core.training import DatasetError, NoSplitError, load_dataset

MATRIX = np.array([[20.0, 0, 8, 0], [0, 21.0, 6, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def write(folder, splits="00011", intrinsics=None, bbox="-1 -2 -3 1 2 3 0.4"):
    """A view for each letter of `splits`, all looking at the origin."""
    for name in ("rgb", "pose"):
        (folder / name).mkdir(parents=True)
    rng = np.random.default_rng()
    poses = []
    for i, split in enumerate(splits):
        pixels = rng.integers(0, 256, (12, 16, 3), np.uint8)
        Image.fromarray(pixels).save(folder / f"rgb/{split}_{i:05d}.png")
        pose = look_at(rng.normal(size=3) * 3, (0, 0, 0))
        poses.append(pose)
        opencv = pose * [1, -1, -1, 1]
        np.savetxt(folder / f"pose/{split}_{i:05d}.txt", opencv)
    if isinstance(intrinsics, str):
        (folder / "intrinsics.txt").write_text(intrinsics)
    else:
        np.savetxt(folder / "intrinsics.txt", MATRIX if intrinsics is None else intrinsics)
    if bbox:
        (folder / "bbox.txt").write_text(bbox)
    return folder, np.array(poses)


def test_poses_lens_box_and_splits(tmp_path):
    folder, poses = write(tmp_path)
    train, test = load_dataset(folder, "train"), load_dataset(folder, "test")
    assert train.names == ("0_00000", "0_00001", "0_00002")
    assert test.names == ("1_00003", "1_00004")
    np.testing.assert_allclose(train.poses, poses[:3], atol=1e-9)
    assert (train.lenses[0].focal, train.lenses[0].center) == ((20.0, 21.0), (8.0, 6.0))
    np.testing.assert_array_equal(train.bounds, [[-1, -2, -3], [1, 2, 3]])


def test_with_a_third_split_the_second_is_for_validation(tmp_path):
    folder, _ = write(tmp_path, "0012")
    assert load_dataset(folder, "test").names == ("2_00003",)
    assert load_dataset(folder, "val").names == ("1_00002",)


def test_only_a_split_without_poses_is_no_test_split(tmp_path):
    folder, _ = write(tmp_path / "bad", "0012")
    (folder / "pose/2_00003.txt").write_text("nan " * 16)
    with pytest.raises(DatasetError, match=r"2_00003\.txt has to be 4 rows"):
        load_dataset(folder, "test")
    with pytest.raises(NoSplitError):
        load_dataset(write(tmp_path / "none", "000")[0], "test")


def test_an_image_may_have_any_ending_in_any_case(tmp_path):
    folder, poses = write(tmp_path)
    for i, ending in enumerate((".PNG", ".png", ".Tif")):
        path = folder / f"rgb/0_{i:05d}.png"
        Image.open(path).convert("RGB").save(path.with_suffix(".bmp"))
        path.unlink()
        path.with_suffix(".bmp").rename(path.with_suffix(ending))
    data = load_dataset(folder, "train")
    assert data.view_count == 3 and data.said == ()
    np.testing.assert_allclose(data.poses, poses[:3], atol=1e-9)


def test_the_synthetic_scenes_intrinsics(tmp_path):
    folder, _ = write(tmp_path, intrinsics="20.0 8.0 6.0 0.\n0. 0. 0.\n1.\n12 16\n")
    assert load_dataset(folder, "train").lenses[0].focal == (20.0, 20.0)


def test_missing_images_are_counted(tmp_path):
    folder, _ = write(tmp_path)
    (folder / "rgb/0_00001.png").unlink()
    dataset = load_dataset(folder, "train")
    assert dataset.missing == ("rgb/0_00001",)
    assert dataset.view_count == 2


@pytest.mark.parametrize(
    "change, sentence",
    [
        ({"intrinsics": MATRIX * [[-1], [1], [1], [1]]}, "corrupt.*Ignatius"),
        ({"intrinsics": "20000 8 6"}, "can't be those.*Ignatius"),
        ({"intrinsics": MATRIX + np.eye(4, k=2) * 90}, "lies outside.*Ignatius"),
        ({"intrinsics": "<html>"}, "intrinsics.txt has to hold numbers"),
        ({"intrinsics": "1 2"}, "4x4 matrix, or a line"),
        ({"bbox": "1 2 3"}, "six numbers of a box"),
        ({"splits": "111"}, "no poses 0_"),
    ],
)
def test_unusable_files_are_refused_in_one_sentence(tmp_path, change, sentence):
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(write(tmp_path, **change)[0], "train")
    assert "\n" not in str(caught.value)
