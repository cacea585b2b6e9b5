"""The renderer at its edges against the float64 reference: far vertices, flat meshes, lattice rays.

    python tests/benchmarks/edge_poses.py [--device cpu|cuda:0] [--rays 100000] [--seed 0]
        [--lattice-alone]

A ball of tets with random contents, in conformance mode.  Each row: rays, their mean error, the
share that is off by more than 2/255, and the largest error [1/255].

    far vertex   one vertex lies so many object sizes away, in random directions
    lattice      rays along the axes through vertices, points and planes of the lattice; right is
                 what the reference sees there, or on the side that they are moved to
    far camera   so many sizes away, with a lens that shows the object as large
    flat         the mesh is scaled by a factor along a random direction
"""

import argparse

import numpy as np
from folds import ball

from deformrf.core.base.device import start_warp
from deformrf.core.definition.image import render_rays
from deformrf.core.render import (
    Camera,
    Renderer,
    RenderOptions,
    camera_rays,
    from_field_of_view,
    look_at,
    pinhole,
)
from deformrf.core.render.rays.approach import ASIDE

EXACT = RenderOptions(conformance=True)
WHITE = (1.0, 1.0, 1.0)
OFF = 2.0  # 1/255
LATTICE = 0.01  # a quarter of the ball's spacing
AT_ONCE = 2000  # rays
MIDDLE = np.array([0.5, 0.5, 0.5])


def defined(field, vertices, origins, directions):
    """The reference's colors.  [R, 3], of 255"""
    parts = []
    for first in range(0, len(origins), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        parts.append(
            render_rays(field.definition, vertices, origins[part], directions[part], WHITE)[0]
        )
    return 255.0 * np.concatenate(parts)


def errors(renderer, vertices, origins, directions):
    """Of rays, the largest over the channels [R]; and the colors found."""
    renderer.set_vertices(vertices.astype(np.float32))
    found = 255.0 * renderer.render_rays(origins, directions, EXACT)[0]
    exact = vertices.astype(np.float32).astype(float)
    return np.abs(found - defined(renderer.field, exact, origins, directions)).max(axis=1), found


def tell(name, off):
    print(
        f"{name:24}{len(off):9d}{off.mean():9.4f}{(off > OFF).mean():10.4%}{off.max():9.1f}",
        flush=True,
    )


def view(rng, size):
    way = rng.normal(size=3)
    return from_field_of_view(
        look_at(MIDDLE + 1.6 * way / np.linalg.norm(way), MIDDLE), 0.5, size, size
    )


def far_vertices(renderer, rng, distance):
    found = []
    for _ in range(6):
        vertices = renderer.field.mesh.rest_vertices.copy()
        way = rng.normal(size=3)
        vertices[rng.integers(len(vertices))] += distance * way / np.linalg.norm(way)
        found.append(errors(renderer, vertices, *camera_rays(view(rng, 40)))[0])
    tell(f"far vertex {distance:g}", np.concatenate(found))


def far_cameras(renderer, rng, distance):
    found = []
    for _ in range(3):
        way = rng.normal(size=3)
        eye = MIDDLE + distance * way / np.linalg.norm(way)
        camera = Camera(look_at(eye, MIDDLE), pinhole(1.2 * 56 * distance, 56, 56))
        rest = renderer.field.mesh.rest_vertices
        found.append(errors(renderer, rest, *camera_rays(camera))[0])
    tell(f"far camera {distance:g}", np.concatenate(found))


def flat(renderer, rng, factor):
    found = []
    for _ in range(2):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        x = renderer.field.mesh.rest_vertices - MIDDLE
        vertices = MIDDLE + x + (factor - 1.0) * (x @ way)[:, None] * way
        found.append(errors(renderer, vertices, *camera_rays(view(rng, 40)))[0])
    tell(f"flat {factor:.2g}", np.concatenate(found))


def lattice_rays(field, rng, count):
    """Origins and directions, no ray twice.  [R, 3] both"""
    vertices = field.mesh.rest_vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points = vertices[rng.integers(len(vertices), size=count)]
    between = np.round(rng.uniform(low, high, (count, 3)) / LATTICE) * LATTICE
    kind = rng.integers(3, size=count)
    points = np.where((kind == 0)[:, None], points, between)
    axis, sign = rng.integers(3, size=count), rng.choice([-1.0, 1.0], count)
    directions = np.zeros((count, 3))
    directions[np.arange(count), axis] = sign
    # Half of the others begin between lattice points, in one of the planes.
    slid = (axis + 1 + rng.integers(2, size=count)) % 3
    points[np.arange(count), slid] += np.where(kind == 2, rng.uniform(0, LATTICE, count), 0.0)
    points[np.arange(count), axis] = 0.5 - 2.0 * sign
    rays = np.unique(np.concatenate([points, directions], axis=1), axis=0)
    return rays[:, :3].astype(np.float32).astype(float), rays[:, 3:]


def lattice(renderer, rng, count):
    field, rest = renderer.field, renderer.field.mesh.rest_vertices
    origins, directions = np.empty((0, 3)), np.empty((0, 3))
    while len(origins) < count:
        more = lattice_rays(field, rng, 2 * count)
        origins, directions = (
            np.concatenate(a) for a in zip((origins, directions), more, strict=True)
        )
    chosen = rng.permutation(len(origins))[:count]
    origins, directions = origins[chosen], directions[chosen]
    renderer.set_vertices(rest.astype(np.float32))
    found = 255.0 * renderer.render_rays(origins, directions, EXACT)[0]
    exact = rest.astype(np.float32).astype(float)
    beside = (origins + ASIDE).astype(np.float32).astype(float)
    off = np.abs(found - defined(field, exact, beside, directions)).max(axis=1)
    wrong = np.flatnonzero(off > OFF)
    if len(wrong):
        there = defined(field, exact, origins[wrong], directions[wrong])
        off[wrong] = np.minimum(off[wrong], np.abs(found[wrong] - there).max(axis=1))
    tell("lattice", off)
    for ray in np.flatnonzero(off > OFF):
        print(f"    off by {off[ray]:.1f}: {origins[ray].round(4)} along {directions[ray]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rays", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lattice-alone", action="store_true")
    arguments = parser.parse_args()
    start_warp()
    rng = np.random.default_rng(arguments.seed)
    renderer = Renderer(ball(4.0), arguments.device)
    print(f"{'':24}{'rays':>9}{'mean':>9}{'> 2/255':>10}{'largest':>9}")
    if not arguments.lattice_alone:
        for distance in (10.0, 1e3, 1e6, 1e9):
            far_vertices(renderer, rng, distance)
        for distance in (12.0, 1e3, 1e6):
            far_cameras(renderer, rng, distance)
        for factor in np.geomspace(1.0, 1e-6, 25):
            flat(renderer, rng, factor)
    lattice(renderer, rng, arguments.rays)


if __name__ == "__main__":
    main()
