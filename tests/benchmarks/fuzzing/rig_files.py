"""Rigs of other programs: glTF with shared and multiplied structure, matrices, Blender's, ours."""

import json
import struct

import numpy as np
from gltf_files import make_bar
from point_caches import write_cache

from deformrf.core.geometry import a15_grid
from deformrf.wings import rig as rigs

from .damage import Binary, json_bytes, with_structure, with_values
from .trees import Arrays, content_bytes
from .zips import with_zip

VERTICES = 7  # of our rig
HEAD = 20  # bytes of a .glb before its JSON


def glb_bytes(parts: bytes, blob: bytes) -> bytes:
    parts += b" " * (-len(parts) % 4)
    blob += b"\0" * (-len(blob) % 4)
    size = 12 + 8 + len(parts) + 8 + len(blob)
    start = struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<I4s", len(parts), b"JSON")
    return start + parts + struct.pack("<I4s", len(blob), b"BIN\0") + blob


class Gltf:
    """A skinned bar, whose nodes, channels, skins, keys and accessors are multiplied and shared."""

    errors = (ValueError,)

    def __init__(self, folder):
        self.file = make_bar(np.random.default_rng(0))[0]
        self.file.save(folder / "a.glb")
        self.data = (folder / "a.glb").read_bytes()
        length = struct.unpack_from("<I", self.data, 12)[0]
        self.parts = json.loads(self.data[HEAD : HEAD + length])
        self.blob = self.data[HEAD + length + 8 :]
        counts = ((8, "<I"), (12, "<I"), (HEAD + length, "<I"))
        self.binary = Binary(self.data, counts, (12, HEAD, HEAD + length, HEAD + length + 8))

    def original(self, folder):
        (folder / "a.glb").write_bytes(self.data)

    def mutate(self, rng, folder):
        kind = int(rng.integers(12))
        if kind == 0:
            data, what = with_structure(rng, self.binary, self.data)
            (folder / "a.glb").write_bytes(data)
            return what
        parts, blob, what = json.loads(json.dumps(self.parts)), self.blob, "values"
        if kind <= 4:
            parts = with_values(rng, parts)
        elif kind == 5:
            what = "JSON"
            text, _ = json_bytes(rng, parts)
            (folder / "a.glb").write_bytes(glb_bytes(text, blob))
            return what
        else:
            made = MULTIPLIED[rng.integers(len(MULTIPLIED))]
            blob, what = made(rng, parts, blob)
            if rng.random() < 0.2:
                parts, what = with_values(rng, parts), f"{what}, values"
        (folder / "a.glb").write_bytes(glb_bytes(json.dumps(parts).encode(), blob))
        return what

    def read(self, folder):
        found = rigs.read_gltf(folder / "a.glb")
        for clip in found.clips[:20]:
            assert np.isfinite(clip.matrices_at(found.skeleton, 0.3)).all(), clip.name
        assert all(clip.name.isprintable() for clip in found.clips)


def _accessor(parts, blob, values, kind, **more):
    """Add an accessor with its own view; returns its number and the longer blob."""
    blob += b"\0" * (-len(blob) % 4)
    view = {"buffer": 0, "byteOffset": len(blob), "byteLength": values.nbytes}
    parts["bufferViews"].append(view)
    codes = {"f": 5126, "u": {1: 5121, 2: 5123, 4: 5125}.get(values.dtype.itemsize)}
    accessor = {"bufferView": len(parts["bufferViews"]) - 1, "type": kind}
    accessor |= {"componentType": codes[values.dtype.kind], "count": len(values)}
    parts["accessors"].append(accessor | more)
    blob += values.tobytes()
    parts["buffers"][0]["byteLength"] = len(blob)
    return len(parts["accessors"]) - 1, blob


def _many_channels(rng, parts, blob):
    """Channels of all bones that share one long table of keys, in one animation or in several."""
    if rng.random() < 0.5:
        blob, _ = _many_bones(rng, parts, blob)
    keys, count = int(rng.choice([100, 10_000, 100_000])), int(rng.choice([6, 500, 1000]))
    times = np.arange(keys, dtype="f4") / 24.0
    turns = np.tile(np.float32([0, 0, 0, 1]), (keys, 1))
    first, blob = _accessor(parts, blob, times, "SCALAR", min=[0.0], max=[float(times[-1])])
    second, blob = _accessor(parts, blob, turns, "VEC4")
    third, blob = _accessor(parts, blob, np.ascontiguousarray(turns[:, :3] + 1), "VEC3")
    samplers = [{"input": first, "output": second}, {"input": first, "output": third}]
    targets = [
        {"sampler": int(path != "rotation"), "target": {"node": node, "path": path}}
        for node in parts["skins"][0]["joints"]
        for path in ("rotation", "translation", "scale")
    ]
    channels = targets[:count] if rng.random() < 0.8 else (targets * count)[:count]
    spread = int(rng.choice([1, 1, 20]))
    parts["animations"] = [{"samplers": samplers, "channels": channels}] * spread
    return blob, f"{len(channels)} channels on {keys} keys, {spread} animations"


def _chain(rng, parts, blob):
    """Nodes each of which has the next as its child, with or without a joint at the end."""
    count, joints = int(rng.choice([100, 2000, 20_000, 60_000])), parts["skins"][0]["joints"]
    first = len(parts["nodes"])
    parts["nodes"] += [{"children": [first + i + 1]} for i in range(count - 1)] + [{}]
    kind = int(rng.integers(3))
    if kind == 0:  # above the bones
        parts["nodes"][-1] = {"children": [0]}
    elif kind == 1:  # below them
        parts["nodes"][joints[0]].setdefault("children", []).append(first)
    if rng.random() < 0.5:  # all of them move
        some = range(first, first + count, max(count // 200, 1))
        channels = parts["animations"][0]["channels"]
        channels += [{"sampler": 0, "target": {"node": n, "path": "rotation"}} for n in some]
    return blob, f"a chain of {count} nodes, {kind}"


def _many_bones(rng, parts, blob):
    """A skin with many joints: a chain, a star, or the same one again and again."""
    count, first = int(rng.choice([30, 250, 600])), len(parts["nodes"])
    chain = bool(rng.random() < 0.5)
    for i in range(count):
        parts["nodes"].append({"children": [first + i + 1]} if chain and i < count - 1 else {})
    if not chain:
        parts["nodes"][3].setdefault("children", []).extend(range(first, first + count))
    matrices = np.tile(np.eye(4, dtype="f4").reshape(1, 16), (count + 2, 1))
    number, blob = _accessor(parts, blob, matrices, "MAT4")
    skin = {"joints": [1, 3, *range(first, first + count)], "inverseBindMatrices": number}
    parts["skins"][0] = skin
    return blob, f"{count} joints, chain: {chain}"


def _many_parts(rng, parts, blob):
    """The same skin, mesh, primitive, node or animation, again and again."""
    count = int(rng.choice([2, 30, 3000]))
    kind = int(rng.integers(5))
    if kind == 0:
        parts["skins"] *= count
    elif kind == 1:
        parts["meshes"] *= min(count, 300)
    elif kind == 2:
        parts["meshes"][0]["primitives"] *= count
    elif kind == 3:
        parts["nodes"] += [{"mesh": 0, "skin": 0}] * count
    else:
        parts["animations"] *= count
    return blob, f"{count} times {('skins', 'meshes', 'primitives', 'nodes', 'animations')[kind]}"


def _sparse(rng, parts, blob):
    """An accessor that is stored sparsely, with good or bad indices, with a base or without."""
    target = int(rng.integers(len(parts["accessors"])))
    accessor = parts["accessors"][target]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
    kind = {5126: "f4", 5123: "u2", 5121: "u1"}[accessor["componentType"]]
    count = int(rng.integers(1, accessor["count"] + 1))
    places = np.sort(rng.choice(accessor["count"], count, replace=False)).astype("u2")
    if rng.random() < 0.3:
        places = rng.integers(0, 2**16, count).astype("u2")
    first, blob = _accessor(parts, blob, places, "SCALAR")
    second, blob = _accessor(parts, blob, np.zeros((count, width), kind), accessor["type"])
    views = [parts["accessors"][n]["bufferView"] for n in (first, second)]
    accessor["sparse"] = {
        "count": int(rng.choice([count, count, count + 1, 2**30])),
        "indices": {"bufferView": views[0], "componentType": int(rng.choice([5123, 5125, 5121]))},
        "values": {"bufferView": views[1]},
    }
    if rng.random() < 0.4:
        accessor.pop("bufferView")
        accessor["count"] = int(rng.choice([accessor["count"], 2**20, 2**27]))
    return blob, f"accessor {target} is sparse"


def _huge(rng, parts, blob):
    """An accessor that declares more than there is, or the same bytes for every value."""
    accessor = parts["accessors"][rng.integers(len(parts["accessors"]))]
    accessor["count"] = int(rng.choice([2**20, 2**27, 2**31 - 1, 0]))
    view = parts["bufferViews"][accessor["bufferView"]]
    if rng.random() < 0.5:
        view["byteStride"] = int(rng.choice([0, 1, 4, 252]))
        view["byteLength"] = int(rng.choice([view["byteLength"], 2**31 - 1]))
    return blob, f"an accessor of {accessor['count']}"


def _morphs(rng, parts, blob):
    """Morph targets, and a clip of their weights."""
    primitive, count = parts["meshes"][0]["primitives"][0], int(rng.choice([1, 4, 500]))
    primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}] * count
    parts["meshes"][0]["weights"] = [0.5] * count
    channels = parts["animations"][0]["channels"]
    channels.append({"sampler": 3, "target": {"node": 4, "path": "weights"}})
    return blob, f"{count} morph targets"


MULTIPLIED = [_many_channels, _chain, _many_bones, _many_parts, _sparse, _huge, _morphs]
MULTIPLIED += [_many_channels, _chain]  # twice as often


class Rigs:
    """The matrices of a script, and our own rig.npz."""

    errors = (ValueError,)

    def __init__(self, folder):
        rng = np.random.default_rng(0)
        turns = np.tile(np.eye(4), (2, 1, 1))
        samples = [{"time": t, "skinning_matrices": dict(zip("ab", turns.tolist(), strict=True))}
                   for t in (0.0, 0.5)]  # fmt: skip
        bones = [{"name": "a", "parent": None, "head": [0, 0, 0], "tail": [0, 0, 1]}]
        bones += [{"name": "b", "parent": "a", "head": [0, 0, 1], "tail": [0, 0, 2]}]
        self.value = {"bones": bones, "clips": {"c": {"duration": 1.0, "samples": samples}}}
        skeleton = rigs.make_skeleton(["a", "b"], [-1, 0], np.eye(3)[:2], np.eye(3)[1:])
        away = rng.normal(size=(VERTICES, 1, 3))
        offsets = np.concatenate([away, -away], axis=1).astype(np.float32)
        times, weights = np.arange(2) / 24.0, np.full((VERTICES, 2), 0.5, np.float32)
        frames = rng.normal(size=(2, VERTICES, 3)).astype(np.float32)
        turn = rigs.Channel(1, "rotation", "LINEAR", times, np.eye(4)[2:])
        clips = rigs.Clip("turn", 1.0, (turn,)), rigs.VertexClip("v", times, frames)
        np.savez(folder / "a.npz", **rigs.arrays_of(rigs.Rig(skeleton, weights, clips, offsets)))
        with np.load(folder / "a.npz") as archive:
            self.arrays = Arrays(archive)

    def original(self, folder):
        (folder / "a.npz").write_bytes(content_bytes(self.arrays))

    def mutate(self, rng, folder):
        kind = int(rng.integers(4))
        if kind <= 1:
            value = self.value
            if rng.random() < 0.2:  # a long chain of bones, each the parent of the next
                count = int(rng.choice([250, 600, 5000]))
                more = [{"name": f"c{i}", "parent": f"c{i - 1}" if i else "b", "head": [0, 0, i],
                         "tail": [0, 0, i + 1]} for i in range(count)]  # fmt: skip
                value = value | {"bones": value["bones"] + more}
            data, what = json_bytes(rng, value)
            (folder / "a.json").write_bytes(data)
            return what
        if kind == 2:
            data, what = with_zip(rng, content_bytes(self.arrays), self.arrays)
        else:
            meta = with_values(rng, json.loads(self.arrays["rig_meta"].tobytes()))
            text = np.frombuffer(json.dumps(meta).encode(), "u1")
            data, what = content_bytes(Arrays(self.arrays | {"rig_meta": text})), "rig_meta"
        (folder / "a.npz").write_bytes(data)
        return what

    def read(self, folder):
        if (folder / "a.npz").exists():
            rigs.load_rig(folder / "a.npz", VERTICES)
            return
        found = rigs.read_matrices(folder / "a.json")
        for clip in found.clips[:20]:
            clip.matrices_at(found.skeleton, 0.3)


class Blender:
    """What comes back from Blender: the add-on's file, and point caches."""

    errors = (ValueError,)

    def __init__(self, folder):
        self.mesh = a15_grid(0.25)
        count = self.mesh.vertex_count
        vertices = np.repeat(self.mesh.rest_vertices[None].astype(np.float32), 3, axis=0)
        clip = rigs.VertexClip("a", np.arange(3) / 24.0, vertices)
        bones = rigs.make_skeleton(["a", "b"], [-1, 0], np.eye(3)[:2], np.eye(3)[1:])
        self.meta = {"format": "deformrf-blender", "format_version": 1, "blender": "5.0.1"}
        self.meta |= {"bones": ["a", "b"], "clips": ["c"], "shape_keys": ["s"]}
        self.arrays = Arrays(
            rest_vertices=vertices[0],
            weights=np.full((count, 2), 0.5, np.float32),
            bone_parents=bones.parents,
            bone_rest=bones.rest,
            bone_tails=bones.tails,
            shape_keys=np.zeros((1, count, 3), np.float32),
            times_0=clip.times,
            matrices_0=np.tile(np.eye(4), (3, 2, 1, 1)),
            shape_values_0=np.zeros((3, 1), np.float32),
            vertices_0=vertices,
        )
        self.caches = {}
        for name in ("a.pc2", "a.mdd", "a.npz"):
            write_cache(clip, folder / name)
            data = (folder / name).read_bytes()
            order = ">" if name == "a.mdd" else "<"
            counts = tuple((at, f"{order}I") for at in range(0, 32, 4))
            self.caches[name] = Binary(data, counts, (12, 32, len(data) // 2))

    def _with_meta(self, meta):
        text = np.frombuffer(json.dumps(meta).encode(), np.uint8)
        return Arrays(self.arrays | {"meta": text})

    def original(self, folder):
        (folder / "rig.npz").write_bytes(content_bytes(self._with_meta(self.meta)))

    def mutate(self, rng, folder):
        kind, whole = int(rng.integers(4)), self._with_meta(self.meta)
        if kind == 0:
            data, name, what = (
                content_bytes(self._with_meta(with_values(rng, self.meta))),
                "rig.npz",
                "meta",
            )
        elif kind == 1:
            (data, what), name = with_zip(rng, content_bytes(whole), whole), "rig.npz"
        else:
            name = list(self.caches)[rng.integers(3)]
            data, what = with_structure(rng, self.caches[name], content_bytes(whole)[:400])
        (folder / name).write_bytes(data)
        return f"{name}: {what}"

    def read(self, folder):
        path = next(folder.iterdir())
        if path.name == "rig.npz":
            rigs.rig_of(rigs.read_blender(path, self.mesh), self.mesh)
        else:
            rigs.read_cache(path, self.mesh.vertex_count)
