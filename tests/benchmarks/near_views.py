"""Default mode from nearby and from inside, where the reports, which see all of it, don't look.

    python tests/benchmarks/near_views.py chair.npz foxrig.npz [--count 100] [--device cpu]

Prints, for ends of rays at T < 0.02 and 0.03, the worst view's PSNR to conformance mode and the
largest difference of any pixel.
"""

import argparse

import numpy as np

from deformrf.core.field import modelfile
from deformrf.core.render import Renderer, RenderOptions, from_field_of_view, look_at
from deformrf.wings.lab.rendering.pictures import image_error

SIZE = 96  # pixels
STOPS = (0.02, 0.03)
NEAR, INSIDE = 0.5, 0.2  # from a vertex, from the middle: half diagonals of the box


def cameras(points, count):
    """Random views of vertices nearby, and as many of what is around from inside."""
    rng = np.random.default_rng(0)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low)
    directions = rng.normal(size=(2, count, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    targets = rng.choice(points, count)
    near, inside = directions
    return {
        "nearby": [
            _camera(t + NEAR * radius * d, t, 0.3) for t, d in zip(targets, near, strict=True)
        ],
        "inside": [_camera(middle + INSIDE * radius * d, middle - d, 0.6) for d in inside],
    }


def _camera(eye, target, field_of_view):
    return from_field_of_view(look_at(eye, target), field_of_view, SIZE, SIZE)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    for path in arguments.models:
        field = modelfile.load(path)
        renderer = Renderer(field, arguments.device)
        renderer.set_vertices(field.mesh.rest_vertices)

        def colors(camera, options, renderer=renderer):
            return renderer.render(camera, options).color_array()[..., :3] / 255.0

        points = field.mesh.rest_vertices[np.unique(field.mesh.tets[field.occupancy != 0])]
        for where, views in cameras(points, arguments.count).items():
            exact = [colors(camera, RenderOptions(conformance=True)) for camera in views]
            for stop in STOPS:
                options = RenderOptions(termination=stop)
                errors = [
                    image_error([colors(camera, options)], [image])
                    for camera, image in zip(views, exact, strict=True)
                ]
                print(
                    f"{path} {where}, T < {stop}: worst view {min(e.psnr for e in errors):.1f} dB,"
                    f" at most {max(e.largest for e in errors):.0f}/255"
                )


if __name__ == "__main__":
    main()
