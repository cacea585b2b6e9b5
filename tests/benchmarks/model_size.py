"""How large a model file is, whole and its mesh part, and what each way to store it costs.

    python tests/benchmarks/model_size.py DATA [--model M] [--device cpu|cuda:0]
        [--size 200] [--views 6]

PSNR is that of all pixels against the renders of the first row, then the mean over the
views against DATA's test images.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from deformrf.core.base import paths
from deformrf.core.base.device import start_warp
from deformrf.core.field import modelfile, reached_entries
from deformrf.core.field.packing import pack_tables
from deformrf.core.render import Camera, Renderer, in_space
from deformrf.core.training import load_dataset, white_composite
from deformrf.core.training.metrics import psnr

MESH_ARRAYS = ("rest_vertices", "addresses", "tets", "occupancy")


def write_files(field, folder):
    """Yield the name of each way to store a field, and the file."""
    path = folder / "model.npz"
    modelfile.save(field, path)
    with np.load(path) as archive:
        others = {k: a for k, a in archive.items() if not k.startswith(("table", "reached"))}
    everything = np.ones(len(field.table), bool)
    np.savez(path, **others, **pack_tables(field.table, field.layout, everything))
    yield "fp16, all entries", path
    for entry_bits, name in ((16, "fp16"), (8, "int8")):
        np.savez(path, **modelfile.pack(field, entry_bits=entry_bits))
        yield f"{name}, reached only", path
        modelfile.save(field, path, entry_bits=entry_bits)
        yield f"{name}, deflated", path


def byte_counts(path):
    """Of the whole file, and of what describes its mesh."""
    with np.load(path) as archive:
        mesh = sum(archive[name].nbytes for name in MESH_ARRAYS if name in archive)
    return path.stat().st_size, mesh


def render_all(field, dataset, device):
    """A list of [H, W, 3] in 0..1, over white."""
    renderer = Renderer(field, device)
    poses = in_space(dataset.poses, field.world_to_model)
    views = (Camera(pose, lens) for pose, lens in zip(poses, dataset.lenses, strict=True))
    return [renderer.render(view).color_array()[..., :3] / 255.0 for view in views]


def print_reached(field):
    start = time.perf_counter()
    reached = reached_entries(field.mesh, field.layout, field.occupancy)
    seconds = time.perf_counter() - start
    parts = np.split(reached, field.layout.offsets[1:-1])
    shares = ", ".join(f"{part.sum()} of {len(part)}" for part in parts)
    print(f"reached, by level: {shares}; {seconds:.2f} s on the CPU")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("--model", default=paths.DEFAULT_MODEL)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--size", type=int, default=200)
    parser.add_argument("--views", type=int, default=6)
    arguments = parser.parse_args()
    start_warp()
    field = modelfile.load(arguments.model)
    dataset = load_dataset(arguments.data, "test", arguments.size, arguments.views)
    images = [dataset.image(view) for view in range(dataset.view_count)]
    truth = [white_composite(image).astype(np.float64) for image in images]
    headings = ("MB", "mesh KB", "load ms", "dB to fp16", "dB to images")
    print(f"{'':20}" + "".join(f"{heading:>14}" for heading in headings))
    first = None
    with tempfile.TemporaryDirectory() as folder:
        for name, path in write_files(field, Path(folder)):
            size, mesh_size = byte_counts(path)
            start = time.perf_counter()
            loaded = modelfile.load(path)
            milliseconds = 1e3 * (time.perf_counter() - start)
            renders = render_all(loaded, dataset, arguments.device)
            first = renders if first is None else first
            scores = (
                psnr(np.concatenate(renders, axis=None), np.concatenate(first, axis=None)),
                np.mean([psnr(a, b) for a, b in zip(renders, truth, strict=True)]),
            )
            cells = (size / 1e6, mesh_size / 1e3, milliseconds, *scores)
            print(f"{name:20}" + "".join(f"{cell:14.2f}" for cell in cells))
    print_reached(field)  # its kernel is compiled by now


if __name__ == "__main__":
    main()
