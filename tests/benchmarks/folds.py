"""A camera inside a threefold fold, against the same mesh unfolded.

    python tests/benchmarks/folds.py [model.npz ...] [--size 64] [--repeats 5]
        [--device cpu|cuda:0]

Prints for a dense and a thin block of 500 tets, and for models, the time of both frames, the
samples, and how far the folded frame is from the same in conformance mode.  On a CPU the time is
the processor's, of all threads together, which says little of what other programs do meanwhile;
on a GPU it is the time until the frame is drawn.
"""

import argparse
import time
from dataclasses import replace

import numpy as np
import warp as wp

from deformrf.core.base.device import start_warp
from deformrf.core.field import FieldOptions, modelfile, random_field
from deformrf.core.geometry import a15_grid, extract, tet_neighbours
from deformrf.core.render import Renderer, RenderOptions, from_field_of_view, look_at
from deformrf.wings.lab.rendering.pictures import image_error

OPTIONS = FieldOptions(level_count=6, table_size=2**12, march_step=1.3e-3)


def ball(log_density):
    """A ball of tets that are occupied everywhere, with random contents."""
    grid = a15_grid(0.04)
    middles = grid.rest_vertices[grid.tets].mean(axis=1) - 0.5
    mesh, _ = extract(grid, np.linalg.norm(middles, axis=1) < 0.3)
    field = random_field(mesh, tet_neighbours(mesh.tets), OPTIONS, seed=0)
    weights, bias = field.density_layers[-1]
    bias = bias + np.float32([log_density] + [0.0] * (len(bias) - 1))
    occupancy = np.full_like(field.occupancy, 2**64 - 1)
    layers = (*field.density_layers[:-1], (weights, bias))
    return replace(field, density_layers=layers, occupancy=occupancy)


def folded(vertices):
    """Folded three times along x, one sheet a little behind the other."""
    low, high = vertices[:, 0].min(), vertices[:, 0].max()
    thirds = 3.0 * (vertices[:, 0] - low) / (high - low)
    moved = vertices.copy()
    moved[:, 0] = low + (np.abs((thirds + 1) % 2 - 1) + 0.02 * thirds) * (high - low) / 3
    return moved


def frame(renderer, vertices, size, repeats):
    """The shortest time [s], the samples, and the error [dB]."""
    on_gpu = renderer.device.is_cuda
    clock = time.perf_counter if on_gpu else time.process_time
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    camera = from_field_of_view(
        look_at(middle, middle + np.array([0.1, 0.5, 0.2])), 0.9, size, size
    )
    seconds = []
    for _ in range(repeats + 1):  # the first one compiles
        begin = clock()
        renderer.set_vertices(vertices)
        image = renderer.render(camera)
        if on_gpu:
            wp.synchronize_device(renderer.device)
        seconds.append(clock() - begin)
    exact = renderer.render(camera, RenderOptions(conformance=True))
    colors = [one.color_array()[..., :3] / 255.0 for one in (image, exact)]
    return min(seconds[1:]), image.sample_count, image_error(*colors).psnr


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="*")
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    start_warp()
    fields = {"dense ball": ball(6.5), "thin ball": ball(2.5)}
    fields |= {path: modelfile.load(path) for path in arguments.models}
    print("field                 flat [ms]  samples    folded [ms]  samples     dB   ratio")
    for name, field in fields.items():
        renderer = Renderer(field, arguments.device)
        rest = field.mesh.rest_vertices
        flat, flat_count, _ = frame(renderer, rest, arguments.size, arguments.repeats)
        fold, count, error = frame(renderer, folded(rest), arguments.size, arguments.repeats)
        print(
            f"{name[-20:]:20s} {1e3 * flat:10.1f} {flat_count:8d} {1e3 * fold:14.1f} {count:8d}"
            f" {error:6.1f} {fold / flat:7.2f}"
        )


if __name__ == "__main__":
    main()
