"""What tests share: one hook that skips by marker, devices, and the optional development data."""

import json
from pathlib import Path

import numpy as np
import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"  # beside the checkout, if at all


def cuda_is_available():
    import warp as wp  # late: most tests of most files need no Warp

    return wp.is_cuda_available()


def pytest_collection_modifyitems(items):
    """Skip what is marked gpu where there is no CUDA device: the only place that decides it."""
    gpu_items = [item for item in items if item.get_closest_marker("gpu")]
    if gpu_items and not cuda_is_available():
        for item in gpu_items:
            item.add_marker(pytest.mark.skip(reason="needs a CUDA device"))


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request):
    """Each device in turn, by Warp's name; the CUDA one skips itself."""
    return request.param


@pytest.fixture
def shared_data():
    """Path of a development data set by name; the test is skipped where it isn't."""

    def folder(name):
        if not (DATA / name).is_dir():
            pytest.skip(f"needs the development data set {name} in {DATA}")
        return DATA / name

    return folder


@pytest.fixture
def write_dataset():
    """Write images as a data set in the Blender layout; see test_datasets.py."""
    return _write_dataset


def _write_dataset(folder, images, split="test", names=None, paths=None, **scene):
    """The folder, with one view per image: `names` are the files, `paths` what the JSON says.

    View i is at (i, 2, 3) unless `poses` says otherwise; further keywords go to the JSON,
    and None removes a key.
    """
    (folder / split).mkdir(parents=True, exist_ok=True)
    names = names or [f"r_{i}.png" for i in range(len(images))]
    for image, name in zip(images, names, strict=True):
        image.save(folder / split / name, lossless=True, exact=True)  # WebP's options
    paths = paths or [f"./{split}/{name}" for name in names]
    poses = np.tile(np.eye(4), (len(paths), 1, 1))
    poses[:, 0, 3], poses[:, 1:3, 3] = range(len(paths)), (2.0, 3.0)
    poses = scene.pop("poses", poses)
    frames = [
        {"file_path": path, "transform_matrix": np.asarray(pose).tolist()}
        for path, pose in zip(paths, poses, strict=True)
    ]
    scene = {"camera_angle_x": 0.7, "frames": frames, **scene}
    scene = {key: value for key, value in scene.items() if value is not None}
    (folder / f"transforms_{split}.json").write_text(json.dumps(scene))
    return folder
