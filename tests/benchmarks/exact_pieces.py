r"""How often a march's samples are others than the reference's, and what pixels show of it.

python tests/benchmarks/exact_pieces.py model.npz [--device cuda:0] [--rays 40000] [--views 3]

Samples: random rays of views from all around, in one round of the march, beside the pieces of the
float64 reference (a millisecond a ray).  A sample is another one if the reference has none in the
same tet within a fifth of a step, or the other way round.

Pixels, on CUDA alone: the largest difference of default mode from the rays that all search for
their entries, in whole images of 800 x 800.
"""

import argparse
from pathlib import Path

import numpy as np
import warp as wp

from deformrf.core.base.device import start_warp
from deformrf.core.definition.image import ray_pieces
from deformrf.core.field import modelfile
from deformrf.core.render import Renderer, RenderOptions, camera_rays
from deformrf.core.render.rays.entries import Entries
from deformrf.core.render.rays.marching import MIDDLE, empty_rays, empty_samples, march_kernel
from deformrf.wings.lab.rendering.pictures import views

SLOTS = 512
SIZE = 800
NEAR = 0.2  # of a step


def marched(renderer, origins, directions):
    """Tet and t of all samples of each ray.  2 lists of arrays"""
    device, count = renderer.device, len(origins)
    rays = empty_rays(count, device)
    rays.origins.assign(origins)
    rays.directions.assign(directions)
    samples = empty_samples(count * SLOTS, device)
    counts = wp.zeros(count, dtype=int, device=device)
    alive = wp.array(np.arange(count), dtype=int, device=device)
    inputs = [renderer.pose.geometry, Entries(), renderer._occupancy, rays, alive]
    inputs += [renderer.field.options.march_step, SLOTS, MIDDLE]
    wp.launch(march_kernel, count, inputs, [samples, counts], device=device)
    filled = np.arange(SLOTS) < counts.numpy()[:, None]
    ends = counts.numpy().cumsum()[:-1]
    tets = np.asarray(renderer._part_ids)[samples.tet.numpy().reshape(count, SLOTS)[filled]]
    return np.split(tets, ends), np.split(samples.t.numpy().reshape(count, SLOTS)[filled], ends)


def others(tets, t, expected_tets, expected_t, reach):
    """How many samples of a ray have no partner, on either side."""
    left, alone = np.ones(len(t), bool), 0
    for tet, at in zip(expected_tets, expected_t, strict=True):
        partners = np.flatnonzero(left & (tets == tet) & (abs(t - at) < reach))
        if len(partners):
            left[partners[0]] = False
        else:
            alone += 1
    return alone + int(left.sum())


def compare_samples(field, device, ray_count):
    vertices = field.mesh.rest_vertices.astype(np.float32)
    renderer = Renderer(field, device)
    renderer.set_vertices(vertices)
    rng, lines = np.random.default_rng(0), []
    cameras = views(field, 5, SIZE)
    for camera in cameras:
        origins, directions = (np.reshape(a, (-1, 3)) for a in camera_rays(camera))
        chosen = rng.choice(len(directions), ray_count // len(cameras), replace=False)
        lines.append((np.broadcast_to(origins, directions.shape)[chosen], directions[chosen]))
    origins, directions = (np.concatenate(a).astype(np.float32) for a in zip(*lines, strict=True))
    tets, t = marched(renderer, origins, directions)
    lines = vertices.astype(float), origins.astype(float), directions.astype(float)
    ray, expected_tets, _, t_in, t_out, *_ = ray_pieces(field.definition, *lines)
    first = np.searchsorted(ray, np.arange(len(origins) + 1))
    reach, different = NEAR * field.options.march_step, 0
    for number in range(len(origins)):
        of_ray = slice(first[number], first[number + 1])
        middles = 0.5 * (t_in + t_out)[of_ray]
        different += others(tets[number], t[number], expected_tets[of_ray], middles, reach)
    print(f"{len(ray)} samples, {different} others: {1e6 * different / len(ray):.1f} of a million")


def compare_pixels(field, device, view_count):
    default, searching = (Renderer(field, device) for _ in range(2))
    for renderer in (default, searching):
        renderer.set_vertices(field.mesh.rest_vertices)
    for number, camera in enumerate(views(field, view_count, SIZE)):
        image = default.render(camera).color_array().astype(int)
        other = searching.render(camera, RenderOptions(path="host")).color_array()
        print(f"view {number}: at most {abs(image - other).max()}/255")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rays", type=int, default=40_000)
    parser.add_argument("--views", type=int, default=3)
    arguments = parser.parse_args()
    start_warp()
    field = modelfile.load(arguments.model)
    if arguments.device != "cpu":
        compare_pixels(field, arguments.device, arguments.views)
    compare_samples(field, arguments.device, arguments.rays)


if __name__ == "__main__":
    main()
