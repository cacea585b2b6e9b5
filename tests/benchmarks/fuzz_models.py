"""Load damaged model files for a while: each is drawn, or refused with one sentence.

    python tests/benchmarks/fuzz_models.py --seconds 120 [--seed 7] [MODEL ...]

Mutants change bytes of a file, values of `meta`, or an array's values, shape or type.  What is
loaded is drawn in 8x8 pixels, which have to be finite.  A mutant that ends otherwise is kept under
the name that is printed, and the program ends with 1.  Without a MODEL it makes two small ones.
"""

import argparse
import collections
import copy
import io
import json
import resource
import sys
import tempfile
import time
import traceback
from dataclasses import replace
from pathlib import Path

import numpy as np

from deformrf.core import rig as rigs
from deformrf.core.field import FieldOptions, ModelFileError, load, random_field, save
from deformrf.core.geometry import a15_grid, extract, tet_neighbours
from deformrf.core.render import Renderer, from_field_of_view, look_at

LONGEST, MOST_MEMORY = 1.0, 200  # s of a refused load, MB beyond the program itself
NASTY = [None, True, -1, 0, 1, 2**31, 2**63, 10**400, 1e300, float("nan"), float("inf"), 0.5]
NASTY += ["", "a\n\x1b[31mb", "é" * 500, [], {}, [[]], [1] * 1000, {"a": [None]}, 1e-300, 3]
NASTY_NUMBERS = [0, 1, -1, 2**16 - 1, 2**31 - 1, 1e38, -3e38, 1e-40, np.nan, np.inf, 65504]
TYPES = ["<u2", "<i4", "<i8", "<u8", "<f2", "<f4", "<f8", ">f4", "|u1", "|i1", "|b1", "<c8", "<U4"]
VIEW = from_field_of_view(look_at((1.6, 1.2, 0.9), (0.5, 0.5, 0.5)), 0.7, 8, 8)


def small_models(folder):
    for seed, (levels, bits) in enumerate([(3, 16), (1, 8)]):
        grid = a15_grid(0.25)
        mesh, _ = extract(grid, np.arange(grid.tet_count) < 60)
        options = FieldOptions(levels, 2**6, (16,), (16,), march_step=0.01)
        field = random_field(mesh, tet_neighbours(mesh.tets), options, seed)
        if seed:
            field = replace(field, rig_arrays=rigs.arrays_of(small_rig(mesh.vertex_count)))
        training = {"history": [{"seconds": 1.0, "stage": 1, "step": 16, "psnr": 20.0}]}
        save(field, folder / f"small{seed}.npz", training | {"test_mean": {"psnr": 3.0}}, bits)
        yield folder / f"small{seed}.npz"


def small_rig(vertex_count):
    """Two bones that share all vertices, with offsets and a clip of each kind."""
    skeleton = rigs.make_skeleton(["a", "b"], [-1, 0], np.eye(3)[:2], np.eye(3)[1:])
    weights, times = np.full((vertex_count, 2), 0.5, np.float32), np.arange(2) / 24.0
    offsets = np.ones((vertex_count, 2, 3), np.float32) * np.float32([[1], [-1]])
    turns = rigs.Channel(1, "rotation", "LINEAR", times, np.eye(4)[2:])
    frames = np.zeros((2, vertex_count, 3), np.float32)
    clips = rigs.Clip("turn", 1.0, (turns,)), rigs.VertexClip("stay", times, frames)
    return rigs.Rig(skeleton, weights, clips, offsets)


def with_bytes(rng, data, arrays):
    data = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        place = rng.integers(len(data))
        kind = rng.integers(4)
        if kind == 0:
            data[place] = rng.integers(256)
        elif kind == 1:
            data[place] ^= 1 << rng.integers(8)
        elif kind == 2:
            del data[place : place + int(rng.integers(1, 100))]
        else:  # in the zip's list of entries
            data[-1 - rng.integers(min(len(data), 1500))] = rng.choice([0, 255, 127, 1])
        if not data:
            break
    return bytes(data)


def with_meta(rng, data, arrays):
    meta = json.loads(arrays["meta"].tobytes())
    for _ in range(rng.integers(1, 4)):
        place = meta
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            key = keys[rng.integers(len(keys))]
            if isinstance(place[key], (dict, list)) and place[key] and rng.random() < 0.8:
                place = place[key]
                continue
            break
        if isinstance(place, dict) and rng.random() < 0.2:
            del place[key]
        else:
            place[key] = copy.deepcopy(NASTY[rng.integers(len(NASTY))])
        if not meta:
            break
    return packed(rng, arrays | {"meta": np.frombuffer(json.dumps(meta).encode(), np.uint8)})


def with_arrays(rng, data, arrays):
    arrays = dict(arrays)
    for _ in range(rng.integers(1, 3)):
        name = list(arrays)[rng.integers(len(arrays))]
        array, kind = arrays[name].copy(), rng.integers(7)
        if kind <= 1 and array.size:
            value = NASTY_NUMBERS[rng.integers(len(NASTY_NUMBERS))]
            with np.errstate(all="ignore"):
                array.reshape(-1)[rng.integers(array.size)] = np.array(value).astype(array.dtype)
        elif kind == 2:
            array = array[: rng.integers(len(array) + 1)]
        elif kind == 3:
            array = np.concatenate([array] * int(rng.integers(2, 5)))
        elif kind == 4:
            array = rng.permutation(array)
        elif kind == 5:
            array = np.zeros(array.shape, TYPES[rng.integers(len(TYPES))])
        elif array.dtype.kind != "U":  # of a mutation before
            with np.errstate(all="ignore"):
                array = array * array.dtype.type(rng.choice([0, 2, 7]))
        arrays[name] = array
    return packed(rng, arrays)


def packed(rng, arrays):
    stream = io.BytesIO()
    (np.savez_compressed if rng.random() < 0.3 else np.savez)(stream, **arrays)
    return stream.getvalue()


def megabytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def play(arrays, vertex_count):
    """Pose the bones of a rig, unless it is refused with one sentence."""
    try:
        rig = rigs.rig_from(arrays, vertex_count)
    except ValueError as error:
        assert "\n" not in str(error), error
        return
    for clip in rig.clips:
        bones = isinstance(clip, rigs.Clip)
        found = clip.matrices_at(rig.skeleton, 0.3) if bones else clip.vertices_at(0.3)
        assert np.isfinite(found).all(), clip


def outcome(path):
    """What became of a mutant: "drawn", "refused", or a fault."""
    before, start = megabytes(), time.process_time()
    try:
        field = load(path)
    except ModelFileError as error:
        seconds, grown = time.process_time() - start, megabytes() - before
        if "\n" in str(error) or seconds > LONGEST or grown > MOST_MEMORY:
            return f"fault: {seconds:.1f} s, {grown:.0f} MB, {error!r}"
        return "refused"
    except Exception:
        return f"fault: {traceback.format_exc()}"
    try:
        start = time.process_time()
        if field.rig_arrays is not None:
            play(field.rig_arrays, field.mesh.vertex_count)
        pixels = Renderer(field, "cpu").render(VIEW).color_array()
        seconds = time.process_time() - start
    except Exception:
        return f"fault in drawing: {traceback.format_exc()}"
    if not np.isfinite(pixels).all() or seconds > 10 * LONGEST:
        return f"fault: drawn in {seconds:.1f} s, finite: {np.isfinite(pixels).all()}"
    return "drawn"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("models", nargs="*", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng, folder = np.random.default_rng(arguments.seed), Path(tempfile.mkdtemp(prefix="fuzz-"))
    bases = []
    for path in arguments.models or list(small_models(folder)):
        assert outcome(path) == "drawn", path
        with np.load(path) as archive:
            bases.append((path.read_bytes(), dict(archive)))
    counts, path, first = collections.Counter(), folder / "mutant.npz", megabytes()
    end, start = time.monotonic() + arguments.seconds, time.monotonic()
    while time.monotonic() < end:
        kind = (with_bytes, with_meta, with_arrays)[rng.integers(3)]
        path.write_bytes(kind(rng, *bases[rng.integers(len(bases))]))
        result = outcome(path)
        counts[kind.__name__, result.split(":")[0]] += 1
        if result.startswith("fault"):
            kept = folder / f"fault-{sum(counts.values())}.npz"
            kept.write_bytes(path.read_bytes())
            print(kept, result, flush=True)
        if sum(counts.values()) % 10_000 == 0:  # what is known if the process itself ends
            print(sum(counts.values()), "mutants", flush=True)
    total, seconds = sum(counts.values()), time.monotonic() - start
    print(f"{total} mutants in {seconds:.0f} s, seed {arguments.seed}, "
          f"memory {first:.0f} to {megabytes():.0f} MB")  # fmt: skip
    for (kind, result), count in sorted(counts.items()):
        print(f"{kind:12s} {result:16s} {count}")
    sys.exit(any(result.startswith("fault") for _, result in counts))


if __name__ == "__main__":
    main()
