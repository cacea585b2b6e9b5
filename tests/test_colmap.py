"""COLMAP's reconstructions, written as text files; reading them needs pycolmap."""

import sys

import numpy as np
import pytest
from PIL import Image

from deformrf.core.capture import upright
from deformrf.core.commands import train
from deformrf.core.render import look_at
from deformrf.core.training import DatasetError, load_dataset

CAMERAS = {
    1: ("SIMPLE_PINHOLE", 16, 12, (20, 8, 6)),
    2: ("PINHOLE", 16, 12, (20, 21, 8, 6)),
    3: ("SIMPLE_RADIAL", 16, 12, (20, 8, 6, 0.1)),
    4: ("RADIAL", 16, 12, (20, 8, 6, 0.1, -0.05)),
    5: ("OPENCV", 16, 12, (20, 21, 8, 6, 0.1, -0.05, 1e-3, -2e-3)),
}


def quaternion(r):
    """(w, x, y, z) of a rotation matrix, by its largest component."""
    w = np.sqrt(max(0.0, 1 + np.trace(r))) / 2
    if w > 0.1:
        return w, *(np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (4 * w))
    _, vectors = np.linalg.eigh(r + r.T)
    x, y, z = vectors[:, -1]  # a turn by almost 180 degrees around that axis
    v = np.array([x, y, z]) * np.sqrt(max(0.0, 1 - w * w))
    skew = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    return w, *(v if v @ skew >= 0 else -v)


def write(folder, count=9, cameras=None):
    """Cameras around the origin, z up; every one of `cameras` in turn."""
    cameras = cameras or CAMERAS
    (folder / "sparse/0").mkdir(parents=True)
    (folder / "images").mkdir()
    rng = np.random.default_rng()
    lines, poses = [], []
    for i in range(count):
        angle = 2 * np.pi * i / count
        pose = look_at((4 * np.cos(angle), 4 * np.sin(angle), 1.0), (0, 0, 0))
        poses.append(pose)
        world_to_camera = np.linalg.inv(pose * [1, -1, -1, 1])
        q, t = quaternion(world_to_camera[:3, :3]), world_to_camera[:3, 3]
        camera = list(cameras)[i % len(cameras)]
        lines += [f"{i + 1} {' '.join(map(repr, map(float, (*q, *t))))} {camera} r_{i}.png", ""]
        pixels = rng.integers(0, 256, (12, 16, 3), np.uint8)
        Image.fromarray(pixels).save(folder / f"images/r_{i}.png")
    (folder / "sparse/0/images.txt").write_text("\n".join(lines) + "\n")
    (folder / "sparse/0/points3D.txt").write_text("")
    (folder / "sparse/0/cameras.txt").write_text(
        "".join(
            f"{key} {model} {w} {h} {' '.join(map(str, p))}\n"
            for key, (model, w, h, p) in cameras.items()
        )
    )
    return folder, np.array(poses)


def test_poses_and_lenses(tmp_path):
    pytest.importorskip("pycolmap")
    folder, poses = write(tmp_path)
    train, test = load_dataset(folder, "train"), load_dataset(folder, "test")
    assert test.names == ("r_0", "r_8")
    assert len(train.names) == 7
    # The cameras stand upright around z, so nothing was turned.
    np.testing.assert_allclose(train.poses, poses[1:8], atol=1e-6)
    second, third, fourth, fifth = train.lenses[:4]
    assert (second.focal, second.center) == ((20.0, 21.0), (8.0, 6.0))
    assert third.radial == (0.1, 0.0, 0.0, 0.0)
    assert fourth.radial == (0.1, -0.05, 0.0, 0.0)
    assert fifth.tangential == (1e-3, -2e-3)


def test_missing_images_are_counted(tmp_path):
    pytest.importorskip("pycolmap")
    folder, _ = write(tmp_path)
    (folder / "images/r_3.png").unlink()
    assert load_dataset(folder, "train").missing == ("images/r_3.png",)


def test_another_model_is_named(tmp_path):
    pytest.importorskip("pycolmap")
    fisheye = {1: ("OPENCV_FISHEYE", 16, 12, (20, 21, 8, 6, 0, 0, 0, 0))}
    with pytest.raises(DatasetError, match="camera model OPENCV_FISHEYE"):
        load_dataset(write(tmp_path, cameras=fisheye)[0], "train")


def test_without_pycolmap_the_command_says_what_to_install(call, tmp_path, monkeypatch, refused):
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    result = call(train.main, write(tmp_path)[0], "-o", tmp_path / "m.npz", "--device", "cpu")
    sentence = "photographs and reads COLMAP's, is not installed: pip install 'deformrf[colmap]'"
    assert sentence in refused(result)


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
        ("images", " 1 r_0.png", " 7 r_0.png", "sparse/0"),
        ("images", " 1 r_0.png", " 1 \udcff.png", "sparse/0"),
        ("cameras", "1 SIMPLE_PINHOLE 16 12", "1 SIMPLE_PINHOLE 0 12", "0x12"),
        ("cameras", "1 SIMPLE_PINHOLE 16 12", "1 SIMPLE_PINHOLE 99999 12", "99999x12"),
        ("cameras", "1 SIMPLE_PINHOLE 16 12 20 8 6", "1 SIMPLE_PINHOLE 16 12 20", "sparse/0"),
    ],
)
def test_unusable_reconstructions_are_refused_in_one_sentence(tmp_path, file, old, new, sentence):
    pytest.importorskip("pycolmap")
    folder, _ = write(tmp_path, count=1)
    path = folder / f"sparse/0/{file}.txt"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new), errors="surrogateescape")
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(folder, "train")
    assert "\n" not in str(caught.value)
