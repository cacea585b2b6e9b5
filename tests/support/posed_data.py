"""Data sets of random pixels in the layouts that are read, for tests of cameras and paths."""

import json

import numpy as np
from PIL import Image

from deformrf.core.render import look_at

PHONE = {
    "fl_x": 40.0, "fl_y": 41.0, "cx": 15.5, "cy": 21.0, "w": 30, "h": 40,
    "k1": 0.05, "k2": -0.08, "p1": -1e-3, "p2": 2e-4,
}  # fmt: skip
SIZE = 30, 40


def circle(count):
    """Poses around the origin that look at it, z up.  [count, 4, 4]"""
    angles, heights = 2 * np.pi * np.arange(count) / count, np.linspace(0.2, 2.0, count)
    places = np.stack([4 * np.cos(angles), 4 * np.sin(angles), heights], axis=1)
    return np.array([look_at(place, (0, 0, 0)) for place in places])


def put(path, size=SIZE, mode="RGB"):
    """Write an image of random pixels; returns its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    shape = (size[1], size[0], len(mode))
    pixels = np.random.default_rng().integers(0, 256, shape, np.uint8)
    Image.fromarray(pixels, mode).save(path)
    return path


def write_frames(folder, frames, name="transforms.json", **scene):
    """Write a transforms.json of frames; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(json.dumps({**scene, "frames": frames}))
    return folder


def transforms(folder, count=9, offset=(0, 0, 0), per_frame=None, sizes=(SIZE,), **scene):
    """A transforms.json with its images in images/; `per_frame` goes to each frame."""
    frames = []
    for i, pose in enumerate(circle(count)):
        pose[:3, 3] += offset
        put(folder / f"images/{i:04d}.png", sizes[i % len(sizes)])
        frame = {"file_path": f"images/{i:04d}.png", "transform_matrix": pose.tolist()}
        frames.append(frame | (per_frame(i) if per_frame else {}))
    return write_frames(folder, frames, **scene)


def nsvf(folder, count=9):
    """NSVF's layout, all of the training split."""
    for i, pose in enumerate(circle(count)):
        put(folder / f"rgb/0_{i:05d}.png")
        (folder / "pose").mkdir(exist_ok=True)
        np.savetxt(folder / f"pose/0_{i:05d}.txt", pose * [1, -1, -1, 1])
    matrix = np.array([[40.0, 0, 15.5, 0], [0, 41.0, 21.0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    np.savetxt(folder / "intrinsics.txt", matrix)
    return folder


TO_Y_UP = np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])


def polycam(folder, count=9, names=("images", "cameras"), size=SIZE):
    """Polycam's raw data; its world is the one of `circle`, with y up."""
    for i, pose in enumerate(TO_Y_UP @ circle(count)):
        put(folder / f"keyframes/{names[0]}/{1000 + i}.jpg", size)
        camera = {f"t_{row}{column}": pose[row, column] for row in range(3) for column in range(4)}
        camera |= {"fx": 40.0, "fy": 41.0, "cx": 15.5, "cy": 21.0, "width": size[0]}
        camera |= {"height": size[1], "blur_score": 90.0, "timestamp": 1000 + i}
        (folder / f"keyframes/{names[1]}").mkdir(exist_ok=True)
        (folder / f"keyframes/{names[1]}/{1000 + i}.json").write_text(json.dumps(camera))
    (folder / "mesh_info.json").write_text(json.dumps({"alignmentTransform": [0.0] * 16}))
    return folder


def record3d(folder, count=9, names=("rgb", "metadata.json"), **changes):
    """Record3D's export; its world is the one of `circle`, with y up."""
    poses = []
    for i, pose in enumerate(TO_Y_UP @ circle(count)):
        put(folder / f"{names[0]}/{i}.jpg")
        poses.append([*quaternion(pose[:3, :3]), *pose[:3, 3]])
    values = {"w": 30, "h": 40, "K": [40.0, 0, 0, 0, 41.0, 0, 15.5, 21.0, 1], "poses": poses}
    (folder / names[1]).write_text(json.dumps({**values, **changes}))
    return folder


def quaternion(rotation):
    """(x, y, z, w) of a matrix: the eigenvector of Bar-Itzhack's matrix."""
    r = rotation
    matrix = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] - r[1, 2]],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], np.trace(r)],
        ]
    )
    return np.linalg.eigh(matrix)[1][:, -1].tolist()


def colmap(folder, count=9):
    """COLMAP's text files."""
    lines = []
    for i, pose in enumerate(circle(count)):
        put(folder / f"images/{i:04d}.png")
        inverse = np.linalg.inv(pose * [1, -1, -1, 1])
        x, y, z, w = quaternion(inverse[:3, :3])
        numbers = " ".join(repr(float(v)) for v in (w, x, y, z, *inverse[:3, 3]))
        lines += [f"{i + 1} {numbers} 1 {i:04d}.png", ""]
    sparse = folder / "sparse/0"
    sparse.mkdir(parents=True)
    (sparse / "images.txt").write_text("\n".join(lines) + "\n")
    (sparse / "points3D.txt").write_text("")
    (sparse / "cameras.txt").write_text("1 OPENCV 30 40 40 41 15.5 21 0.05 -0.08 -0.001 0.0002\n")
    return folder
