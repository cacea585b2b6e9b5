"""Small skinned meshes as .glb files, made here, and what glTF says about their points."""

import json
import struct

import numpy as np

from deformrf.wings.rig import rotations

TIMES = np.array([0.25, 0.75, 1.5], np.float32)
TYPES = {"<f4": 5126, "<u2": 5123, "|u1": 5121}


class GlbFile:
    """A .glb in the making: `parts` is its JSON."""

    def __init__(self):
        self.blob = b""
        self.parts = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}

    def add(self, values, kind) -> int:
        """The number of an accessor for these values."""
        values = np.ascontiguousarray(values)
        self.blob += b"\0" * (-len(self.blob) % 4)
        view = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": values.nbytes}
        self.blob += values.tobytes()
        self.parts["bufferViews"].append(view)
        accessor = {
            "bufferView": len(self.parts["bufferViews"]) - 1,
            "componentType": TYPES[values.dtype.str],
            "count": len(values),
            "type": kind,
        }
        self.parts["accessors"].append(accessor)
        return len(self.parts["accessors"]) - 1

    def save(self, path):
        self.parts.setdefault("buffers", [{"byteLength": len(self.blob)}])
        text = json.dumps(self.parts).encode()
        text += b" " * (-len(text) % 4)
        blob = self.blob + b"\0" * (-len(self.blob) % 4)
        size = 12 + 8 + len(text) + 8 + len(blob)
        with open(path, "wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, size))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", len(blob), b"BIN\0") + blob)


def make_bar(rng):
    """A bar of 12 points on joints 3 (its root) and 1, and one clip with each interpolation.

    Node 0 scales and turns everything; node 2, no joint, lies between the joints; the bones' rest
    differs from the bind pose at joint 1.  Joints are listed child first.
    """
    file = GlbFile()
    half = np.sqrt(0.5)
    file.parts["nodes"] = [
        {"children": [3], "scale": [0.01] * 3, "rotation": [half, 0, 0, half], "name": "Armature"},
        {"name": "upper", "translation": [0, 30, 0], "rotation": [0, 0, 0.1, 0.995]},
        {"children": [1], "translation": [0, 70, 0], "scale": [2.0] * 3},
        {"children": [2], "name": "lower", "translation": [1, 2, 3]},
        {"mesh": 0, "skin": 0},
    ]
    points = rng.uniform([-20, 0, -20], [20, 200, 20], (12, 3)).astype("<f4")
    weights = rng.uniform(size=(12, 4)) * [1, 1, 0, 0]
    weights = (weights / weights.sum(axis=1, keepdims=True)).astype("<f4")
    joints = np.tile([0, 1, 0, 0], (12, 1)).astype("<u2")
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[0, :3, 3], inverse[1, :3, 3] = [-1, -130, -3], [-1, -2, -3]
    inverse[0, :3] *= 0.5  # joint 1 is scaled by 2 in the bind pose, as node 2 has it
    turns = rotations.unit(rng.normal(size=(3, 4))).astype("<f4")
    attributes = {
        "POSITION": file.add(points, "VEC3"),
        "JOINTS_0": file.add(joints, "VEC4"),
        "WEIGHTS_0": file.add(weights, "VEC4"),
    }
    indices = file.add(np.arange(12, dtype="<u2"), "SCALAR")
    binds = file.add(np.swapaxes(inverse, 1, 2).reshape(2, 16).astype("<f4"), "MAT4")
    file.parts |= {
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
        "skins": [{"joints": [1, 3], "inverseBindMatrices": binds}],
        "animations": [wave(file, rng, turns)],
    }
    return file, points, weights, inverse


def wave(file, rng, turns):
    """The clip of the bar."""
    shifts = rng.normal(size=(9, 3)).astype("<f4")
    sizes = rng.uniform(0.5, 2.0, (3, 1)).astype("<f4").repeat(3, axis=1)
    times = file.add(TIMES, "SCALAR")
    values = [
        (1, "rotation", "LINEAR", file.add(turns, "VEC4")),
        (3, "rotation", "STEP", file.add(turns[::-1], "VEC4")),
        (3, "translation", "CUBICSPLINE", file.add(shifts, "VEC3")),
        (3, "scale", "LINEAR", file.add(sizes, "VEC3")),
    ]
    return {
        "name": "Wave",
        "channels": [
            {"sampler": i, "target": {"node": node, "path": path}}
            for i, (node, path, _, _) in enumerate(values)
        ],
        "samplers": [
            {"input": times, "interpolation": kind, "output": output}
            for _, _, kind, output in values
        ],
    }


def make_skin(points, triangles):
    """A surface [S, 3], z up, that two bones move: one below its middle, one above."""
    file = GlbFile()
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)
    turned = np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)  # y up
    upper = (points[:, 2] > middle[2]).astype("<u2")
    joints = np.stack([upper, *[0 * upper] * 3], axis=1)
    weights = np.tile(np.array([1, 0, 0, 0], "<f4"), (len(points), 1))
    heads = [[middle[0], low[2], -middle[1]], [middle[0], middle[2], -middle[1]]]
    inverse = np.tile(np.eye(4), (2, 1, 1))
    inverse[:, :3, 3] = -np.array(heads)
    attributes = {
        "POSITION": file.add(turned.astype("<f4"), "VEC3"),
        "JOINTS_0": file.add(joints, "VEC4"),
        "WEIGHTS_0": file.add(weights, "VEC4"),
    }
    indices = file.add(triangles.astype("<u2").ravel(), "SCALAR")
    binds = file.add(np.swapaxes(inverse, 1, 2).reshape(2, 16).astype("<f4"), "MAT4")
    file.parts |= {
        "nodes": [
            {"name": "lower", "translation": heads[0], "children": [1]},
            {"name": "upper", "translation": [0, heads[1][1] - heads[0][1], 0]},
            {"mesh": 0, "skin": 0},
        ],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
        "skins": [{"joints": [0, 1], "inverseBindMatrices": binds, "name": "Skin"}],
    }
    return file


def ellipsoid(sizes):
    """Points and triangles of an ellipsoid about the origin with these half axes."""
    rows = np.linspace(0.02, np.pi - 0.02, 24)
    columns = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    a, b = np.meshgrid(rows, columns, indexing="ij")
    points = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=-1)
    ids = np.arange(points[..., 0].size).reshape(a.shape)
    corner = ids[:-1], np.roll(ids, -1, 1)[:-1], ids[1:], np.roll(ids, -1, 1)[1:]
    triangles = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in (corner[:3], corner[1:])])
    return points.reshape(-1, 3) * sizes, triangles
