"""COLMAP's folders, binary and text, one model and several, with points."""

import struct

import numpy as np
import pycolmap

from deformrf.core.training import DatasetError

from .damage import Binary
from .datasets import FOCAL, HEIGHT, VIEWS, WIDTH, image_bytes, poses, read_all
from .trees import Tree

MODELS = [("SIMPLE_PINHOLE", 0, 3), ("PINHOLE", 1, 4), ("SIMPLE_RADIAL", 2, 4), ("RADIAL", 3, 5)]
MODELS += [("OPENCV", 4, 8)]
POINTS = 12


def parameters(number):
    """Of a camera of MODELS."""
    focal = [FOCAL] if number in (0, 2, 3) else [FOCAL, FOCAL]
    return [*focal, 8.0, 6.0, 0.01, 0.001, 1e-4, 1e-4][: MODELS[number][2]]


class Writer:
    """A binary file in the making: its counts and parts are noted."""

    def __init__(self):
        self.data, self.counts, self.parts = b"", [], []

    def add(self, form, *values):
        self.data += struct.pack("<" + form, *values)

    def count(self, form, value):
        self.counts.append((len(self.data), "<" + form))
        self.add(form, value)

    def part(self):
        self.parts.append(len(self.data))

    def done(self):
        return Binary(self.data, tuple(self.counts), tuple(self.parts))


def quaternion(turn):
    """w, x, y, z of a rotation matrix: an eigenvector."""
    m = turn
    table = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], 0, 0, 0],
            [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0, 0],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], 0],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m)],
        ]
    )
    _, vectors = np.linalg.eigh(table)
    x, y, z, w = vectors[:, -1]
    return w, x, y, z


def views(count=VIEWS):
    """(quaternion, translation, camera, name, features) of each image."""
    rng = np.random.default_rng(5)
    for i, pose in enumerate(poses(count)):
        inverse = np.linalg.inv(pose * [1, -1, -1, 1])
        features = [
            (*rng.uniform(0, 12, 2), 1 + k if k < POINTS else -1) for k in range(POINTS + 1)
        ]
        yield quaternion(inverse[:3, :3]), inverse[:3, 3], 1 + i % 5, f"a b/r ({i}).png", features


def binary_cameras():
    file = Writer()
    file.count("Q", len(MODELS))
    for number, (_, model, _) in enumerate(MODELS):
        file.part()
        file.add("I", number + 1)
        file.count("i", model)
        file.count("Q", WIDTH)
        file.count("Q", HEIGHT)
        file.add(f"{len(parameters(number))}d", *parameters(number))
    return file.done()


def binary_images(count=VIEWS):
    file = Writer()
    file.count("Q", count)
    for i, (turn, shift, camera, name, features) in enumerate(views(count)):
        file.part()
        file.count("I", i + 1)
        file.add("7d", *turn, *shift)
        file.count("I", camera)
        file.add(f"{len(name) + 1}s", name.encode())
        file.part()
        file.count("Q", len(features))
        for x, y, point in features:
            file.add("2d", x, y)
            file.count("q", point)
    return file.done()


def binary_points(count=VIEWS):
    file, rng = Writer(), np.random.default_rng(6)
    file.count("Q", POINTS)
    for k in range(POINTS):
        file.part()
        file.count("Q", k + 1)
        file.add("3d3Bd", *rng.normal(size=3), 9, 8, 7, 0.5)
        file.part()
        file.count("Q", count)
        for i in range(count):
            file.count("I", i + 1)
            file.count("I", k)
    return file.done()


def text_files(count=VIEWS):
    cameras = "# Camera list with one line of data per camera:\n"
    for number, (model, _, _) in enumerate(MODELS):
        values = " ".join(map(str, parameters(number)))
        cameras += f"{number + 1} {model} {WIDTH} {HEIGHT} {values}\n"
    images = "# Image list with two lines of data per image:\n"
    for i, (turn, shift, camera, name, features) in enumerate(views(count)):
        numbers = " ".join(map(repr, map(float, (*turn, *shift))))
        name = name.replace(" ", "_")
        images += f"{i + 1} {numbers} {camera} {name}\n"
        images += " ".join(f"{x} {y} {p}" for x, y, p in features) + "\n"
    rng, points = np.random.default_rng(6), "# 3D point list\n"
    for k in range(POINTS):
        track = " ".join(f"{i + 1} {k}" for i in range(count))
        points += f"{k + 1} {' '.join(map(repr, rng.normal(size=3).tolist()))} 9 8 7 0.5 {track}\n"
    return {"cameras.txt": cameras, "images.txt": images, "points3D.txt": points}


def binary_files(count=VIEWS):
    return {
        "cameras.bin": binary_cameras(),
        "images.bin": binary_images(count),
        "points3D.bin": binary_points(count),
    }


class Colmap(Tree):
    """sparse/0 in each form; pycolmap's own of today, with rigs and frames; two models."""

    errors = (DatasetError,)
    often = ("sparse",)

    def __init__(self, folder):
        pictures = {f"images/a b/r ({i}).png": image_bytes(i) for i in range(VIEWS)}
        for i in range(VIEWS):
            pictures[f"images/a_b/r_({i}).png"] = image_bytes(i)
        binary, text = binary_files(), text_files()
        few = binary_files(2)

        def below(place, files):
            return {f"{place}/{name}": content for name, content in files.items()}

        self.variants = [
            pictures | below("sparse/0", binary),
            pictures | below("sparse/0", text),
            pictures | below("sparse/0", _modern(folder, binary)),
            pictures | below("sparse/0", few) | below("sparse/1", binary),
            pictures | below("colmap/sparse", text),
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
