"""Milliseconds per frame by stage, with the error against conformance mode beside them.

    python tests/benchmarks/render_speed.py [--model M] [--device cpu|cuda:0] [--sizes 400 800]

The camera moves from frame to frame and the vertices are set anew each time, as in a drag.
`total` is measured without waiting between stages; the stages are measured one by one, so
on CUDA their sum is larger than the total.
"""

import argparse
import time

import numpy as np
import warp as wp

from deformrf.core import paths
from deformrf.core.device import start_warp
from deformrf.core.field import modelfile
from deformrf.core.render.camera import from_field_of_view, look_at
from deformrf.core.render.render import Renderer, RenderOptions
from deformrf.core.training.metrics import psnr


def cameras(count, size):
    """`count` cameras on a circle around the unit cube, at the training distance."""
    for angle in np.linspace(0.0, 2.0 * np.pi, count, endpoint=False):
        eye = 0.5 + 1.344 * np.array([np.cos(angle) * 0.9, np.sin(angle) * 0.9, 0.43])
        yield from_field_of_view(look_at(eye, (0.5, 0.5, 0.5)), 0.691, size, size)


def measure(renderer, size, frame_count):
    """Median total and mean stages in ms, samples per pixel, PSNR against conformance."""
    views = list(cameras(frame_count, size))
    vertices = wp.clone(renderer.pose.vertices)
    device = renderer.device
    for view in views:  # kernels compile, allocators find their sizes
        renderer.render(view)
    totals, sample_count = [], 0
    for view in views:
        wp.synchronize_device(device)
        start = time.perf_counter()
        renderer.set_vertices(vertices)
        sample_count += renderer.render(view).sample_count
        wp.synchronize_device(device)
        totals.append(time.perf_counter() - start)

    stages = renderer.stage_seconds = {}
    pose_seconds = 0.0
    for view in views:
        start = time.perf_counter()
        renderer.set_vertices(vertices)
        wp.synchronize_device(device)
        pose_seconds += time.perf_counter() - start
        renderer.render(view)
    renderer.stage_seconds = None
    default = renderer.render(views[0]).color_array()[..., :3] / 255.0
    exact = renderer.render(views[0], RenderOptions(conformance=True)).color_array()[..., :3]
    return {
        "size": f"{size}x{size}",
        "total": 1e3 * float(np.median(totals)),
        "pose": 1e3 * pose_seconds / frame_count,
        **{name: 1e3 * seconds / frame_count for name, seconds in stages.items()},
        "samples/px": sample_count / frame_count / size**2,
        "dB": psnr(default, exact / 255.0),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", default=paths.DEFAULT_MODEL)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--sizes", type=int, nargs="+", default=[400, 800])
    parser.add_argument("--frames", type=int, default=8)
    arguments = parser.parse_args()
    start_warp()
    renderer = Renderer(modelfile.load(arguments.model), arguments.device)
    rows = [measure(renderer, size, arguments.frames) for size in arguments.sizes]
    print(f"{renderer.device.name}, {arguments.frames} frames, ms per frame")
    print("".join(f"{name:>12}" for name in rows[0]))
    for row in rows:
        cells = (v if isinstance(v, str) else f"{v:.2f}" for v in row.values())
        print("".join(f"{cell:>12}" for cell in cells))


if __name__ == "__main__":
    main()
