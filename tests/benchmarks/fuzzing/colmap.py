"""COLMAP's folders, binary and text, one model and several, with points."""

import struct

import numpy as np
import pycolmap
from colmap_files import (
    Sparse,
    cameras_bytes,
    cameras_text,
    images_bytes,
    images_text,
    points_bytes,
    points_text,
    rigid,
)

from deformrf.core.training import DatasetError

from .damage import Binary
from .datasets import FOCAL, HEIGHT, VIEWS, WIDTH, image_bytes, poses, read_all
from .trees import Tree

CAMERAS = {  # one of each model that is read
    1: ("SIMPLE_PINHOLE", WIDTH, HEIGHT, (FOCAL, 8.0, 6.0)),
    2: ("PINHOLE", WIDTH, HEIGHT, (FOCAL, FOCAL, 8.0, 6.0)),
    3: ("SIMPLE_RADIAL", WIDTH, HEIGHT, (FOCAL, 8.0, 6.0, 0.01)),
    4: ("RADIAL", WIDTH, HEIGHT, (FOCAL, 8.0, 6.0, 0.01, 0.001)),
    5: ("OPENCV", WIDTH, HEIGHT, (FOCAL, FOCAL, 8.0, 6.0, 0.01, 0.001, 1e-4, 1e-4)),
}
POINTS = 12


def sparse_of(name: str, count=VIEWS) -> Sparse:
    """A model whose images see all points.

    Args:
        name: Of an image, with braces for its number.
    """
    rng = np.random.default_rng(5)
    images = [
        (i + 1, rigid(pose), 1 + i % 5, name.format(i),
         [(*rng.uniform(0, 12, 2).tolist(), k + 1) for k in range(POINTS)])
        for i, pose in enumerate(poses(count))
    ]  # fmt: skip
    tracks = [[(i + 1, k) for i in range(count)] for k in range(POINTS)]
    points = [
        (k + 1, tuple(rng.normal(size=3).tolist()), (9, 8, 7), 0.5, track)
        for k, track in enumerate(tracks)
    ]
    return Sparse(CAMERAS, images, points)


def text_files(count=VIEWS, name="a_b/r_({}).png"):
    sparse = sparse_of(name, count)
    return {
        "cameras.txt": cameras_text(sparse),
        "images.txt": images_text(sparse),
        "points3D.txt": points_text(sparse),
    }


def binary_files(count=VIEWS, name="a b/r ({}).png"):
    sparse = sparse_of(name, count)
    return {
        "cameras.bin": counted_cameras(cameras_bytes(sparse)),
        "images.bin": counted_images(images_bytes(sparse)),
        "points3D.bin": counted_points(points_bytes(sparse)),
    }


def counted_cameras(data) -> Binary:
    counts, parts, at = [(0, "<Q")], [], 8
    for _, _, _, parameters in CAMERAS.values():
        parts.append(at)
        counts += [(at + 4, "<i"), (at + 8, "<Q"), (at + 16, "<Q")]
        at += 24 + 8 * len(parameters)
    return Binary(data, tuple(counts), tuple(parts))


def counted_images(data) -> Binary:
    counts, parts, at = [(0, "<Q")], [], 8
    while at < len(data):
        features = data.index(b"\0", at + 64) + 1
        count = struct.unpack_from("<Q", data, features)[0]
        counts += [(features, "<Q"), (at, "<I"), (at + 60, "<I")]
        counts += [(features + 8 + 24 * k + 16, "<q") for k in range(count)]
        parts += [at, features, features + 8]
        at = features + 8 + 24 * count
    return Binary(data, tuple(counts), tuple(parts))


def counted_points(data) -> Binary:
    counts, parts, at = [(0, "<Q")], [], 8
    while at < len(data):
        length = struct.unpack_from("<Q", data, at + 43)[0]
        counts += [(at + 43, "<Q"), (at, "<Q"), (at + 51, "<I"), (at + 55, "<I")]
        parts += [at, at + 43, at + 51]
        at += 51 + 8 * length
    return Binary(data, tuple(counts), tuple(parts))


class Colmap(Tree):
    """sparse/0 in each form; pycolmap's own of today, with rigs and frames; two models; EXIF."""

    errors = (DatasetError,)
    often = ("sparse",)

    def __init__(self, folder):
        pictures = {f"images/a b/r ({i}).png": image_bytes(i) for i in range(VIEWS)}
        for i in range(VIEWS):
            pictures[f"images/a_b/r_({i}).png"] = image_bytes(i)
        binary, text = binary_files(), text_files()
        few = binary_files(2)
        turned = {f"images/t/{i}.jpg": image_bytes(i, "jpg", 1 + i % 8) for i in range(VIEWS)}

        def below(place, files):
            return {f"{place}/{name}": content for name, content in files.items()}

        self.variants = [
            pictures | below("sparse/0", binary),
            pictures | below("sparse/0", text),
            pictures | below("sparse/0", _modern(folder, binary)),
            pictures | below("sparse/0", few) | below("sparse/1", binary),
            pictures | below("colmap/sparse", text),
            turned | below("sparse", binary_files(name="t/{}.jpg")),
        ]

    def read(self, folder):
        read_all(folder)


def _modern(folder, files):
    """The same as the installed pycolmap writes it."""
    for name, content in files.items():
        (folder / name).write_bytes(content.data)
    reconstruction = pycolmap.Reconstruction(str(folder))
    (folder / "modern").mkdir()
    reconstruction.write_binary(str(folder / "modern"))
    found = {}
    for path in (folder / "modern").iterdir():
        data = path.read_bytes()
        counts = tuple((at, "<Q") for at in range(0, min(len(data) - 7, 64), 4))
        parts = tuple(range(8, len(data), 8))
        found[path.name] = Binary(data, counts, parts)
    return found
