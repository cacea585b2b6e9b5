"""Read damaged data sets, checkpoints, sessions, camera paths and rigs for a while.

    python tests/benchmarks/fuzz_inputs.py --seconds 120 [--seed 7] [--only sessions]

A mutant has other bytes, or other values of its JSON.  Each is read, or refused with one sentence
in a second and 200 MB.  One that ends otherwise is kept under the name that is printed, and the
program ends with 1.  tests/benchmarks/fuzz_models.py does the same with models.
"""

import argparse
import collections
import copy
import json
import shutil
import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np
import torch
from fuzz_models import (
    LONGEST,
    MOST_MEMORY,
    NASTY,
    megabytes,
    small_models,
    with_arrays,
    with_bytes,
)
from PIL import Image

from deformrf.core import images
from deformrf.core import rig as rigs
from deformrf.core.field import load
from deformrf.core.geometry import a15_grid
from deformrf.core.training import CheckpointError, DatasetError, load_dataset, preset
from deformrf.core.training.run import Checkpoint, load_checkpoint, save_checkpoint
from deformrf.viewer.films.camera_path import CameraPathError, load_camera_path
from deformrf.viewer.scene import Scene
from deformrf.viewer.sessions import SessionError, load_session, save_session, start_of

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from gltf_files import make_bar

VERTICES = 7  # of a rig


def with_values(rng, value):
    """JSON with some values exchanged, removed or added."""
    value = copy.deepcopy(value)
    for _ in range(rng.integers(1, 4)):
        place = value
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = keys[rng.integers(len(keys))]
            if isinstance(place[key], (dict, list)) and place[key] and rng.random() < 0.8:
                place = place[key]
                continue
            if rng.random() < 0.2:
                del place[key]
            else:
                place[key] = copy.deepcopy(NASTY[rng.integers(len(NASTY))])
            break
    return value


class Datasets:
    """Blender's layout with PNG images, whose JSON or images are damaged."""

    errors = DatasetError

    def __init__(self, folder):
        self.folder = folder / "data"
        (self.folder / "train").mkdir(parents=True)
        self.images, frames = [], []
        images.LARGE, images.AT_A_TIME = 0, 64  # the checks of large images, too
        kinds = [("png", {}), ("jpg", {}), ("webp", {}), ("tif", {"compression": "tiff_lzw"})]
        for number, (ending, options) in enumerate(kinds):
            path = self.folder / "train" / f"r_{number}.{ending}"
            pixels = np.arange(16 * 12 * 3).reshape(12, 16, 3).astype(np.uint8)
            Image.fromarray(pixels).save(path, **options)
            self.images.append((path, path.read_bytes()))
            matrix = np.eye(4)
            matrix[:3, 3] = [0.0, number, 3.0]
            name = f"train/r_{number}.{ending}"
            frames.append({"file_path": name, "transform_matrix": matrix.tolist()})
        self.scene = {"camera_angle_x": 0.7, "w": 16, "h": 12, "frames": frames}
        self.path = self.folder / "transforms_train.json"
        self.path.write_text(json.dumps(self.scene), encoding="utf-8")

    def mutate(self, rng):
        for path, content in self.images:
            path.write_bytes(content)
        text = json.dumps(self.scene)
        kind = rng.integers(3)
        if kind == 0:
            text = json.dumps(with_values(rng, self.scene))
        elif kind == 1:
            self.path.write_bytes(with_bytes(rng, text.encode(), None))
            return
        else:
            path, content = self.images[rng.integers(len(self.images))]
            path.write_bytes(with_bytes(rng, content, None))
        self.path.write_text(text, encoding="utf-8")

    def read(self):
        load_dataset(self.folder, "train", for_training=True)


class Checkpoints:
    """torch's files: bytes, or the values of what is pickled."""

    errors = CheckpointError

    def __init__(self, folder):
        self.path = folder / "a.checkpoint"
        fit = {"number": 7, "parameters": [torch.arange(30.0)]}
        mesh, report = a15_grid(0.25), {"seconds": 1.0, "view_count": 3, "image_size": [9, 9]}
        save_checkpoint(Checkpoint(preset("tiny"), 2, mesh, fit, np.eye(4), report), self.path)
        self.bytes = self.path.read_bytes()
        self.content = torch.load(self.path, weights_only=True)

    def mutate(self, rng):
        if rng.random() < 0.5:
            self.path.write_bytes(with_bytes(rng, self.bytes, None))
            return
        content = with_values(rng, {k: v for k, v in self.content.items() if k != "mesh"})
        mesh = [tensor.clone() for tensor in self.content["mesh"]]
        if rng.random() < 0.5:
            tensor = mesh[rng.integers(3)].view(-1)
            tensor[rng.integers(len(tensor))] = int(rng.choice([-1, 2**31 - 1, 0, 2**15]))
        try:
            torch.save({"mesh": mesh} | content, self.path)
        except Exception:  # torch writes no number of 400 digits
            self.path.write_bytes(b"")

    def read(self):
        load_checkpoint(self.path)


class Sessions:
    """One JSON value a line."""

    errors = SessionError

    def __init__(self, folder):
        self.field = load(next(small_models(folder)))
        scene = Scene(self.field, "small", "cpu")
        start = start_of(scene)
        vertex = int(np.flatnonzero(~scene.pins)[0])
        scene.handles.set_pin(vertex, True)
        scene.advance(1 / 30)
        scene.handles.set_pin(vertex, False)
        scene.settings.grab_radius = 0.2
        scene.handles.grab(int(scene.handles.control_ids[0]))
        for _ in range(3):
            scene.advance(1 / 30)
            scene.handles.drag_to(scene.handles.grabbed.target.place + 0.01)
        scene.handles.release()
        scene.paint(np.full(3, 0.5), 1.2)
        self.path = save_session(scene, start, folder / "a.jsonl")
        self.bytes = self.path.read_bytes()
        self.lines = [json.loads(line) for line in self.bytes.splitlines()]

    def mutate(self, rng):
        if rng.random() < 0.4:
            self.path.write_bytes(with_bytes(rng, self.bytes, None))
            return
        lines = with_values(rng, self.lines)
        self.path.write_text("\n".join(map(json.dumps, lines)), encoding="utf-8")

    def read(self):
        load_session(self.path, self.field)


class CameraPaths:
    """Our own format: keys with places."""

    errors = CameraPathError

    def __init__(self, folder):
        self.path = folder / "a.json"
        place = {"position": [1.5, -2.0, 1.0], "target": [0.5, 0.5, 0.5], "fov": 35}
        matrix = np.eye(4)
        matrix[2, 3] = 3.0
        turned = {"t": 2.0, "transform_matrix": matrix.tolist(), "fov": 35}
        self.value = {"keys": [{"t": 0.0} | place, turned]}
        self.path.write_text(json.dumps(self.value), encoding="utf-8")

    def mutate(self, rng):
        if rng.random() < 0.4:
            self.path.write_bytes(with_bytes(rng, json.dumps(self.value).encode(), None))
        else:
            self.path.write_text(json.dumps(with_values(rng, self.value)), encoding="utf-8")

    def read(self):
        load_camera_path(self.path, np.eye(4), np.full(3, 0.5))


class Blender:
    """What comes back from Blender: the add-on's file, and point caches."""

    errors = ValueError

    def __init__(self, folder):
        self.mesh = a15_grid(0.25)
        count = self.mesh.vertex_count
        vertices = np.repeat(self.mesh.rest_vertices[None].astype(np.float32), 3, axis=0)
        clip = rigs.VertexClip("a", np.arange(3) / 24.0, vertices)
        bones = rigs.make_skeleton(["a", "b"], [-1, 0], np.eye(3)[:2], np.eye(3)[1:])
        self.meta = {"format": "deformrf-blender", "format_version": 1, "blender": "5.0.1"}
        self.meta |= {"bones": ["a", "b"], "clips": ["c"], "shape_keys": ["s"]}
        self.arrays = {
            "rest_vertices": vertices[0],
            "weights": np.full((count, 2), 0.5, np.float32),
            "bone_parents": bones.parents,
            "bone_rest": bones.rest,
            "bone_tails": bones.tails,
            "shape_keys": np.zeros((1, count, 3), np.float32),
            "times_0": clip.times,
            "matrices_0": np.tile(np.eye(4), (3, 2, 1, 1)),
            "shape_values_0": np.zeros((3, 1), np.float32),
            "vertices_0": vertices,
        }
        self.paths = [folder / "rig.npz", *(folder / f"a.{end}" for end in ("pc2", "mdd", "npz"))]
        for path in self.paths[1:]:
            rigs.write_cache(clip, path)
        self.path = self.paths[0]
        self.write(self.meta)
        self.contents = [path.read_bytes() for path in self.paths]

    def write(self, meta):
        text = np.frombuffer(json.dumps(meta).encode(), np.uint8)
        np.savez(self.path, meta=text, **self.arrays)

    def mutate(self, rng):
        number = rng.integers(len(self.paths) + 2)
        if number >= len(self.paths):
            self.path = self.paths[0]
            self.write(with_values(rng, self.meta))
        else:
            self.path = self.paths[number]
            self.path.write_bytes(with_bytes(rng, self.contents[number], None))

    def read(self):
        if self.path == self.paths[0]:
            rigs.rig_of(rigs.read_blender(self.path, self.mesh), self.mesh)
        else:
            rigs.read_cache(self.path, self.mesh.vertex_count)


class Rigs:
    """The rigs that programs write: glTF, a script's matrices, and our own rig.npz."""

    errors = ValueError

    def __init__(self, folder):
        rng = np.random.default_rng(0)
        self.paths = [folder / name for name in ("a.glb", "a.json", "a.npz")]
        self.path = self.paths[0]
        make_bar(rng)[0].save(self.path)
        turns = np.tile(np.eye(4), (2, 1, 1))
        samples = [{"time": t, "skinning_matrices": dict(zip("ab", turns.tolist(), strict=True))}
                   for t in (0.0, 0.5)]  # fmt: skip
        bones = [{"name": "a", "parent": None, "head": [0, 0, 0], "tail": [0, 0, 1]}]
        bones += [{"name": "b", "parent": "a", "head": [0, 0, 1], "tail": [0, 0, 2]}]
        self.value = {"bones": bones, "clips": {"c": {"duration": 1.0, "samples": samples}}}
        self.paths[1].write_text(json.dumps(self.value), encoding="utf-8")
        found = rigs.read_gltf(self.path)
        away = rng.normal(size=(VERTICES, 1, 3))
        offsets = np.concatenate([away, -away], axis=1).astype(np.float32)
        times, weights = np.arange(2) / 24.0, np.full((VERTICES, 2), 0.5, np.float32)
        frames = rng.normal(size=(2, VERTICES, 3)).astype(np.float32)
        clips = (*found.clips, rigs.VertexClip("v", times, frames))
        rigs.save_rig(rigs.Rig(found.skeleton, weights, clips, offsets), self.paths[2])
        self.contents = [path.read_bytes() for path in self.paths]
        with np.load(self.paths[2]) as archive:
            self.arrays = dict(archive)

    def mutate(self, rng):
        number = rng.integers(3)
        self.path, content = self.paths[number], self.contents[number]
        if rng.random() < 0.3:
            self.path.write_bytes(with_bytes(rng, content, None))
        elif number == 0:  # its JSON, whose length stands before it
            length = int.from_bytes(content[12:16], "little")
            value = with_values(rng, json.loads(content[20 : 20 + length]))
            text = json.dumps(value).encode()
            text += b" " * (-len(text) % 4)
            rest = content[20 + length :]
            sizes = len(content) - length + len(text), len(text)
            start = content[:8] + sizes[0].to_bytes(4, "little") + sizes[1].to_bytes(4, "little")
            self.path.write_bytes(start + content[16:20] + text + rest)
        elif number == 1:
            self.path.write_text(json.dumps(with_values(rng, self.value)), encoding="utf-8")
        elif rng.random() < 0.5:
            self.path.write_bytes(with_arrays(rng, None, self.arrays))
        else:
            text = json.dumps(with_values(rng, json.loads(self.arrays["rig_meta"].tobytes())))
            np.savez(self.path, **self.arrays | {"rig_meta": np.frombuffer(text.encode(), "u1")})

    def read(self):
        if self.path == self.paths[2]:
            clips = rigs.load_rig(self.path, VERTICES).clips
        else:
            read = rigs.read_gltf if self.path == self.paths[0] else rigs.read_matrices
            found = read(self.path)
            clips = found.clips
            for clip in clips:
                clip.matrices_at(found.skeleton, 0.3)
        assert all(clip.name for clip in clips)


KINDS = {
    "datasets": Datasets,
    "checkpoints": Checkpoints,
    "sessions": Sessions,
    "camera_paths": CameraPaths,
    "blender": Blender,
    "rigs": Rigs,
}


def outcome(subject):
    before, start = megabytes(), time.process_time()
    try:
        subject.read()
        result = "read"
    except (subject.errors, OSError) as error:
        result = "refused"
        if "\n" in str(error):
            return f"fault: {error!r}"
    except Exception:
        return f"fault: {traceback.format_exc()}"
    seconds, grown = time.process_time() - start, megabytes() - before
    if seconds > LONGEST or grown > MOST_MEMORY:
        return f"fault: {result} in {seconds:.1f} s and {grown:.0f} MB"
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="for all kinds together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=KINDS)
    arguments = parser.parse_args()
    rng, folder = np.random.default_rng(arguments.seed), Path(tempfile.mkdtemp(prefix="fuzz-"))
    counts, chosen = collections.Counter(), [arguments.only] if arguments.only else list(KINDS)
    for name in chosen:
        (folder / name).mkdir()
        subject = KINDS[name](folder / name)
        assert (result := outcome(subject)) == "read", result
        end = time.monotonic() + arguments.seconds / len(chosen)
        while time.monotonic() < end:
            subject.mutate(rng)
            result = outcome(subject)
            counts[name, result.split(":")[0]] += 1
            if result.startswith("fault"):
                kept = folder / f"fault-{sum(counts.values())}"
                copying = shutil.copytree if name == "datasets" else shutil.copy
                copying(subject.path.parent if name == "datasets" else subject.path, kept)
                print(kept, result, flush=True)
    print(f"{sum(counts.values())} mutants, seed {arguments.seed}, {megabytes():.0f} MB at most")
    for (name, result), count in sorted(counts.items()):
        print(f"{name:14s} {result:10s} {count}")
    sys.exit(any(result.startswith("fault") for _, result in counts))


if __name__ == "__main__":
    main()
