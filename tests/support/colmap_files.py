"""COLMAP models that a test makes: the same cameras, images and points, binary or as text."""

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from deformrf.core.render import look_at

MODELS = {  # of cameras, by name: COLMAP's number, and how many parameters
    "SIMPLE_PINHOLE": (0, 3), "PINHOLE": (1, 4), "SIMPLE_RADIAL": (2, 4), "RADIAL": (3, 5),
    "OPENCV": (4, 8), "OPENCV_FISHEYE": (5, 8), "FULL_OPENCV": (6, 12), "FOV": (7, 5),
    "SIMPLE_RADIAL_FISHEYE": (8, 4), "RADIAL_FISHEYE": (9, 5), "THIN_PRISM_FISHEYE": (10, 12),
}  # fmt: skip
NO_POINT = 2**64 - 1  # of a feature that no point was made of


@dataclass
class Sparse:
    """A COLMAP model.

    Attributes:
        cameras: number: (model, width, height, parameters)
        images: (number, quaternion and translation, camera's number, name, features), where
            features are (x, y, point's number).
        points: (number, xyz, rgb, error, track), where a track is a list of (image's number,
            index of its feature).
    """

    cameras: dict = field(default_factory=dict)
    images: list = field(default_factory=list)
    points: list = field(default_factory=list)


def quaternion(r):
    """(w, x, y, z) of a rotation matrix, by its largest component."""
    w = np.sqrt(max(0.0, 1 + np.trace(r))) / 2
    skew = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    if w > 0.1:
        return w, *(skew / (4 * w))
    _, vectors = np.linalg.eigh(r + r.T)
    v = vectors[:, -1] * np.sqrt(max(0.0, 1 - w * w))  # a turn by almost 180 degrees around it
    return w, *(v if v @ skew >= 0 else -v)


def rigid(camera_to_world):
    """Quaternion and translation, world to camera, of a pose with OpenGL's axes."""
    inverse = np.linalg.inv(camera_to_world * [1, -1, -1, 1])
    return tuple(map(float, (*quaternion(inverse[:3, :3]), *inverse[:3, 3])))


def circle(count):
    """Poses around the origin, z up.  [count, 4, 4]"""
    angles = 2 * np.pi * np.arange(count) / count
    return np.array([look_at((4 * np.cos(a), 4 * np.sin(a), 1.0), (0, 0, 0)) for a in angles])


def some_sparse(names, cameras=None, point_count=20, poses=None) -> Sparse:
    """Images of these names around the origin, with features and points.

    Args:
        cameras: As in Sparse; the images take them in turn.
        poses: Camera to world, OpenGL's axes; `circle` without any.  [n, 4, 4]
    """
    rng = np.random.default_rng()
    cameras = cameras or {1: ("PINHOLE", 16, 12, (20.0, 21.0, 8.0, 6.0))}
    poses = circle(len(names)) if poses is None else poses
    sparse, keys = Sparse(cameras), list(cameras)
    tracks = [[] for _ in range(point_count)]
    for index, (name, pose) in enumerate(zip(names, poses, strict=True)):
        seen = rng.permutation(point_count)[: int(rng.integers(0, point_count + 1))]
        features = [
            (float(x), float(y), int(p) + 1)
            for p, (x, y) in zip(seen, rng.random((len(seen), 2)) * 12, strict=True)
        ]
        features += [(1.5, 2.5, NO_POINT)] * (index % 3)
        for place, point in enumerate(seen):
            tracks[point].append((index + 1, place))
        key = keys[index % len(keys)]
        sparse.images.append((index + 1, rigid(pose), key, name, features))
    for number, (xyz, rgb) in enumerate(
        zip(rng.normal(size=(point_count, 3)), rng.integers(0, 256, (point_count, 3)), strict=True)
    ):
        row = (number + 1, tuple(map(float, xyz)), tuple(map(int, rgb)), 0.5, tracks[number])
        sparse.points.append(row)
    return sparse


def cameras_bytes(sparse: Sparse) -> bytes:
    parts = [struct.pack("<Q", len(sparse.cameras))]
    for key, (model, width, height, parameters) in sparse.cameras.items():
        parts.append(struct.pack("<IiQQ", key, MODELS[model][0], width, height))
        parts.append(struct.pack(f"<{len(parameters)}d", *parameters))
    return b"".join(parts)


def images_bytes(sparse: Sparse) -> bytes:
    parts = [struct.pack("<Q", len(sparse.images))]
    for number, pose, camera, name, features in sparse.images:
        parts.append(struct.pack("<I7dI", number, *pose, camera) + name.encode() + b"\0")
        parts.append(struct.pack("<Q", len(features)))
        parts += [struct.pack("<ddQ", *feature) for feature in features]
    return b"".join(parts)


def points_bytes(sparse: Sparse) -> bytes:
    parts = [struct.pack("<Q", len(sparse.points))]
    for number, xyz, rgb, error, track in sparse.points:
        parts.append(struct.pack("<Q3d3BdQ", number, *xyz, *rgb, error, len(track)))
        parts += [struct.pack("<II", *element) for element in track]
    return b"".join(parts)


def write_binary(sparse: Sparse, folder: Path):
    """cameras.bin, images.bin and points3D.bin; a model without points has no such file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.bin").write_bytes(cameras_bytes(sparse))
    (folder / "images.bin").write_bytes(images_bytes(sparse))
    if sparse.points:
        (folder / "points3D.bin").write_bytes(points_bytes(sparse))


def _numbers(values) -> str:
    return " ".join(map(repr, values))


def cameras_text(sparse: Sparse) -> str:
    return "# Camera list with one line of data per camera:\n" + "".join(
        f"{key} {model} {width} {height} {_numbers(parameters)}\n"
        for key, (model, width, height, parameters) in sparse.cameras.items()
    )


def images_text(sparse: Sparse) -> str:
    """An image without features has an empty second line, as COLMAP writes it."""
    text = "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, ...\n"
    for number, pose, camera, name, features in sparse.images:
        rows = " ".join(f"{x} {y} {-1 if p == NO_POINT else p}" for x, y, p in features)
        text += f"{number} {_numbers(pose)} {camera} {name}\n{rows}\n"
    return text


def points_text(sparse: Sparse) -> str:
    return "# 3D point list with one line of data per point:\n" + "".join(
        f"{number} {_numbers(xyz)} {_numbers(rgb)} {error} "
        + " ".join(f"{image} {index}" for image, index in track)
        + "\n"
        for number, xyz, rgb, error, track in sparse.points
    )


def write_text(sparse: Sparse, folder: Path):
    """cameras.txt, images.txt and points3D.txt; a model without points has no such file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text(cameras_text(sparse), encoding="utf-8")
    (folder / "images.txt").write_text(images_text(sparse), encoding="utf-8")
    if sparse.points:
        (folder / "points3D.txt").write_text(points_text(sparse), encoding="utf-8")


WRITERS = {"bin": write_binary, "txt": write_text}


def write_images(sparse: Sparse, folder: Path):
    """Random pixels under the images' names, in the sizes of their cameras."""
    rng = np.random.default_rng()
    for _, _, camera, name, _ in sparse.images:
        _, width, height, _ = sparse.cameras[camera]
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(rng.integers(0, 256, (height, width, 3), np.uint8)).save(path)


def write_capture(folder: Path, ending="bin", names=None, place="sparse/0", **options) -> Sparse:
    """A data set: images/, and a model in `place` that registers all of them."""
    sparse = some_sparse(names or [f"r_{i}.png" for i in range(9)], **options)
    write_images(sparse, folder / "images")
    WRITERS[ending](sparse, folder / place)
    return sparse
