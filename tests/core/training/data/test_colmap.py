"""COLMAP's reconstructions as data sets; test_colmap_files.py has their files alone."""

import json
import sys

import numpy as np
import pytest
from colmap_files import circle, some_sparse, write_binary, write_capture, write_images, write_text
from PIL import Image
from posed_data import PHONE, transforms

from deformrf.commands import running, train
from deformrf.core.training import DatasetError, has_cameras, load_dataset, upright

CAMERAS = {
    1: ("SIMPLE_PINHOLE", 16, 12, (20, 8, 6)),
    2: ("PINHOLE", 16, 12, (20, 21, 8, 6)),
    3: ("SIMPLE_RADIAL", 16, 12, (20, 8, 6, 0.1)),
    4: ("RADIAL", 16, 12, (20, 8, 6, 0.1, -0.05)),
    5: ("OPENCV", 16, 12, (20, 21, 8, 6, 0.1, -0.05, 1e-3, -2e-3)),
}
ENDINGS = pytest.mark.parametrize("ending", ["bin", "txt"])


@ENDINGS
def test_poses_and_lenses(tmp_path, ending):
    write_capture(tmp_path, ending, cameras=CAMERAS)
    train, test = load_dataset(tmp_path, "train"), load_dataset(tmp_path, "test")
    assert test.names == ("r_0", "r_8")
    assert len(train.names) == 7
    # The cameras stand upright around z, so nothing was turned.
    np.testing.assert_allclose(train.poses, circle(9)[1:8], atol=1e-6)
    second, third, fourth, fifth = train.lenses[:4]
    assert (second.focal, second.center) == ((20.0, 21.0), (8.0, 6.0))
    assert third.radial == (0.1, 0.0, 0.0, 0.0)
    assert fourth.radial == (0.1, -0.05, 0.0, 0.0)
    assert fifth.tangential == (1e-3, -2e-3)
    assert train.said == ()


@ENDINGS
def test_points_are_turned_as_cameras_are(tmp_path, ending):
    turn = upright(np.random.default_rng().normal(size=3))
    poses = circle(9)
    poses[:, :3] = turn @ poses[:, :3]
    sparse = write_capture(tmp_path, ending, poses=poses)
    dataset = load_dataset(tmp_path, "train", for_training=True)
    world = np.array([xyz for _, xyz, *_ in sparse.points])
    back = dataset.poses[0, :3, :3] @ poses[1, :3, :3].T  # as one camera was turned
    np.testing.assert_allclose(dataset.points, world @ back.T, atol=1e-6)
    np.testing.assert_allclose(dataset.poses[:, :3, 1].mean(axis=0)[:2], 0.0, atol=0.1)


@ENDINGS
@pytest.mark.parametrize("count", [None, 0])
def test_a_reconstruction_without_points_is_read_without_them(tmp_path, ending, count):
    write_capture(tmp_path, ending, point_count=0)
    if count == 0:
        empty = {"bin": bytes(8), "txt": b"# none\n"}[ending]
        (tmp_path / f"sparse/0/points3D.{ending}").write_bytes(empty)
    assert load_dataset(tmp_path, "train", for_training=True).points is None


@ENDINGS
def test_damaged_points_are_named_with_a_way_out(tmp_path, ending):
    write_capture(tmp_path, ending)
    path = tmp_path / f"sparse/0/points3D.{ending}"
    path.write_bytes(path.read_bytes()[:-3] if ending == "bin" else b"1 0 0 nan\n")
    with pytest.raises(DatasetError, match=r"points3D.*remove it to train without points"):
        load_dataset(tmp_path, "train", for_training=True)
    path.unlink()
    assert load_dataset(tmp_path, "train", for_training=True).view_count == 7


def test_missing_images_are_counted(tmp_path):
    write_capture(tmp_path)
    (tmp_path / "images/r_3.png").unlink()
    assert load_dataset(tmp_path, "train").missing == ("images/r_3.png",)


@pytest.mark.parametrize("model", ["OPENCV_FISHEYE", "FULL_OPENCV", "FOV"])
def test_another_model_is_named(tmp_path, model):
    count = {"OPENCV_FISHEYE": 8, "FULL_OPENCV": 12, "FOV": 5}[model]
    write_capture(tmp_path, cameras={1: (model, 16, 12, (20, 21, 8, 6) + (0,) * (count - 4))})
    with pytest.raises(DatasetError, match=f"camera model {model}, which is not read"):
        load_dataset(tmp_path, "train")


def test_pycolmap_is_not_needed(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    write_capture(tmp_path)
    assert load_dataset(tmp_path, "train", for_training=True).points.shape == (20, 3)


def test_upright_turns_the_mean_up_to_z():
    rng = np.random.default_rng()
    for up in [*rng.normal(size=(20, 3)), np.array([0, 0, -2.0]), np.array([0, 0, 3.0])]:
        turn = upright(up)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)
        np.testing.assert_allclose(turn @ up / np.linalg.norm(up), [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize(
    "file, old, new, sentence",
    [
        ("images", " 1 r_0.png", " 7 r_0.png", "sparse/0 has no camera 7"),
        ("images", " 1 r_0.png", " 1 \udcff.png", "sparse/0/images.txt has the name .*not UTF-8"),
        ("cameras", "1 PINHOLE 16 12", "1 PINHOLE 0 12", "0x12"),
        ("cameras", "1 PINHOLE 16 12", "1 PINHOLE 99999 12", "99999x12"),
        ("cameras", "20.0 21.0 8.0 6.0", "20.0 8.0 6.0", "sparse/0/cameras.txt has 3 parameters"),
    ],
)
def test_unusable_reconstructions_are_refused_in_one_sentence(tmp_path, file, old, new, sentence):
    write_capture(tmp_path, "txt", names=["r_0.png"])
    path = tmp_path / f"sparse/0/{file}.txt"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new), errors="surrogateescape")
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(tmp_path, "train")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
@pytest.mark.parametrize("damage", ["counts too many", "cut off"])
def test_training_refuses_files_that_hold_less_than_they_count(
    call, tmp_path, refused, name, damage
):
    write_capture(tmp_path / "data")
    path = tmp_path / f"data/sparse/0/{name}.bin"
    whole = path.read_bytes()
    counted = (2**40).to_bytes(8, "little") + whole[8:]
    path.write_bytes(counted if damage == "counts too many" else whole[: len(whole) * 2 // 3])
    output = tmp_path / "m.npz"
    sentence = refused(call(train.main, tmp_path / "data", "-o", output, "--device", "cpu"))
    assert str(path) in sentence and "is cut off" in sentence
    assert not output.exists()


# -- several models ------------------------------------------------------------------------------


def write_models(folder, counts, total=9):
    """Photographs, and models in the named folders of so many of them, the last ones first."""
    names = [f"r_{i}.png" for i in range(total)]
    whole = some_sparse(names)
    write_images(whole, folder / "images")
    for number, (place, count) in enumerate(counts.items()):
        chosen = names[-count:] if number % 2 else names[:count]
        part = some_sparse(chosen, poses=circle(total)[[names.index(n) for n in chosen]])
        (write_text if number % 2 else write_binary)(part, folder / place)


@pytest.mark.parametrize(
    "counts, chosen",
    [
        ({"sparse/0": 2, "sparse/1": 7}, "sparse/1"),
        ({"sparse/0": 4, "sparse/1": 4}, "sparse/0"),
        ({"sparse/2": 5, "sparse/10": 5, "sparse/0": 1}, "sparse/2"),
        ({"sparse": 3, "sparse/aligned": 6}, "sparse/aligned"),
        ({"sparse/0": 2, "colmap/sparse/0": 8}, "colmap/sparse/0"),
        ({"colmap/sparse": 2, "colmap/sparse/1": 3}, "colmap/sparse/1"),
    ],
    ids=str,
)
def test_the_largest_of_several_models_is_used_and_all_counts_are_told(tmp_path, counts, chosen):
    write_models(tmp_path, counts)
    dataset = load_dataset(tmp_path, "train")
    assert dataset.view_count + load_dataset(tmp_path, "test").view_count == counts[chosen]
    (line,) = dataset.said
    assert f"of {len(counts)} COLMAP models {chosen} is used" in line
    for place, count in counts.items():
        assert f"{place} has {count} of its {count} photographs" in line


@pytest.mark.parametrize("place", ["sparse/0", "sparse", "colmap/sparse/0", "colmap/sparse", "."])
def test_a_single_model_is_read_where_programs_put_it(tmp_path, place):
    write_models(tmp_path, {place: 5})
    assert load_dataset(tmp_path, "train").view_count == 4
    assert load_dataset(tmp_path, "train").said == ()


def test_photographs_that_are_not_there_do_not_count(tmp_path):
    write_models(tmp_path, {"sparse/0": 6, "sparse/1": 4})
    for i in range(4):
        (tmp_path / f"images/r_{i}.png").unlink()
    dataset = load_dataset(tmp_path, "train")
    assert "sparse/1 is used: sparse/0 has 2 of its 6" in dataset.said[0]
    assert (dataset.view_count, dataset.missing) == (3, ())


def test_a_damaged_model_hides_no_good_one_and_is_told(tmp_path):
    write_models(tmp_path, {"sparse/0": 8, "sparse/1": 4})
    path = tmp_path / "sparse/0/images.bin"
    path.write_bytes(path.read_bytes()[:200])
    (line,) = load_dataset(tmp_path, "train").said
    assert "of 2 COLMAP models sparse/1 is used: sparse/0 can't be read" in line
    assert "images.bin is cut off" in line
    (tmp_path / "sparse/1/cameras.txt").unlink()
    with pytest.raises(DatasetError, match=r"sparse/0/images\.bin is cut off"):
        load_dataset(tmp_path, "train")


@ENDINGS
@pytest.mark.parametrize("name", ["cameras", "images"])
def test_half_a_model_is_named_and_not_passed_over(tmp_path, ending, name):
    write_capture(tmp_path, ending)
    (tmp_path / f"sparse/0/{name}.{ending}").unlink()
    assert has_cameras(tmp_path)
    with pytest.raises(DatasetError, match=r"sparse/0 has to hold cameras\.bin and images\.bin"):
        load_dataset(tmp_path, "train")


def test_commands_say_it_once_of_both_splits(tmp_path, capsys):
    write_models(tmp_path, {"sparse/0": 2, "sparse/1": 7})
    for split in ("train", "test"):
        assert running.load_views(tmp_path, split).said
    assert capsys.readouterr().err.count("sparse/1 is used: sparse/0 has 2 of its 2") == 1


def test_the_check_of_photographs_says_it_too(call, tmp_path):
    write_models(tmp_path / "data", {"sparse/0": 2, "sparse/1": 6})
    result = call(train.main, tmp_path / "data", "-o", tmp_path / "m.npz", "--check")
    assert result.code == 0, result.err
    assert result.err.count("sparse/1 is used: sparse/0 has 2 of its 2") == 1


def test_the_check_refuses_what_training_refuses(call, tmp_path, refused):
    write_capture(tmp_path / "data")
    Image.new("RGB", (12, 16)).save(tmp_path / "data/images/r_3.png")
    for flags in (["--check"], []):
        sentence = refused(call(train.main, tmp_path / "data", "-o", tmp_path / "m.npz", *flags))
        assert "turned or cropped images need intrinsics of their own" in sentence


def test_the_check_says_that_cameras_look_into_one_direction(call, tmp_path):
    transforms(tmp_path / "data", **PHONE)
    path = tmp_path / "data/transforms.json"
    scene = json.loads(path.read_text())
    for frame in scene["frames"]:
        frame["transform_matrix"] = scene["frames"][0]["transform_matrix"]
    path.write_text(json.dumps(scene))
    result = call(train.main, tmp_path / "data", "-o", tmp_path / "m.npz", "--check")
    assert result.code == 0 and "the cameras look into about the same direction" in result.out


def test_the_check_says_which_orientations_are_guessed(call, tmp_path):
    write_capture(tmp_path / "data")
    exif = Image.Exif()
    exif[0x0112] = 3
    path = tmp_path / "data/images/r_3.png"
    Image.open(path).save(path, exif=exif)
    result = call(train.main, tmp_path / "data", "-o", tmp_path / "m.npz", "--check")
    assert result.code == 0 and "the EXIF orientations of 1 photographs" in result.err
