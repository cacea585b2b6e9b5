"""Drag a model and draw it with the functions of this folder alone: slowly and exactly.

Vertices in the lowest 5 % of its height are held.  There is no gravity; a unit is a meter.  The
dragged vertex moves to its target in a second and stays for another.  The view is along +y.
"""

from ..base.children import forget_current_folder

forget_current_folder()  # before anything is imported that could lie there
# ruff: noqa: E402
import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from ..base.paths import whole_file
from ..field import load
from .image import render_rays
from .solver import System, edge_constraints, inverse_masses, substep, volume_constraints

SHEAR, BULK, DENSITY, DAMPING = 1e6 / 2.7, 0.4 / 0.3 * 1e6 / 2.7, 1000.0, 3.0  # E = 1 MPa, ν = 0.35
SUBSTEPS = 24 * 60  # a second
THETA, FLOOR = 0.54, 1.25  # of a substep, and of a (solver.py)
DISTANCE, SLOPE = 2.0, 0.32  # of the eye, in longest sides of the object; of the outermost rays


def lowest(rest):
    """The vertices that are held.  [V] bool"""
    return rest[:, 2] <= rest[:, 2].min() + 0.05 * np.ptp(rest[:, 2])


def dragged(field, vertex, offset):
    """Vertices after the drag of one of them by an offset [3].  [V, 3]"""
    rest, tets, h = field.rest_vertices, field.tets, 1.0 / SUBSTEPS
    held = lowest(rest)
    held[vertex] = True
    w = inverse_masses(rest, tets, DENSITY, held)
    of_a = THETA * h, FLOOR
    edges = edge_constraints(rest, tets, SHEAR, w, *of_a)
    volumes = volume_constraints(rest, tets, BULK, w, *of_a)
    fastest = 20.0 * np.ptp(rest, axis=0).max()
    decay = np.exp(-DAMPING * h)
    system = System(w, edges, volumes, h, decay, np.zeros(3), fastest, theta=THETA)
    x, v, targets = rest, np.zeros_like(rest), rest.copy()
    for step in range(1, 2 * SUBSTEPS + 1):
        out = min(step / SUBSTEPS, 1.0)
        targets[vertex] = rest[vertex] + out * out * (3.0 - 2.0 * out) * offset
        x, v = substep(system, x, v, targets)
        tell("dragging", step, 2 * SUBSTEPS)
    return x


def drawn(field, vertices, size):
    """The picture of a pose, one row of pixels after another.  [size, size, 3] uint8"""
    low, high = field.rest_vertices.min(axis=0), field.rest_vertices.max(axis=0)
    eye = 0.5 * (low + high) - [0.0, DISTANCE * (high - low).max(), 0.0]
    across = SLOPE * ((np.arange(size) + 0.5) / (0.5 * size) - 1.0)
    picture = np.empty((size, size, 3))
    for row, down in enumerate(across):
        directions = np.column_stack([across, np.ones(size), np.full(size, -down)])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        eyes = np.broadcast_to(eye, directions.shape)
        picture[row], *_ = render_rays(field, vertices, eyes, directions, background=np.ones(3))
        tell("drawing", row + 1, size)
    return np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8)


def tell(what, done, total):
    print(f"\r{what} {100 * done // total} %", end="\n" * (done == total), file=sys.stderr)


def drag_of(text, rest):
    """ "12:0.1,0,0" -> 12 and (0.1, 0, 0).  "top" is the highest vertex."""
    name, _, numbers = text.partition(":")
    try:
        vertex = int(rest[:, 2].argmax()) if name == "top" else int(name)
        x, y, z = map(float, numbers.split(","))
    except ValueError:
        raise ValueError(f"--drag is '{text}'; write VERTEX:DX,DY,DZ, as in top:0.1,0,0") from None
    if not 0 <= vertex < len(rest) or lowest(rest)[vertex] or not abs(x) + abs(y) + abs(z) <= 100.0:
        raise ValueError(f"--drag is '{text}'; name a free vertex that exists, at most 100 units")
    return vertex, np.array([x, y, z])


def main(words=None) -> None:
    parser = argparse.ArgumentParser("python -m deformrf.core.definition", description=__doc__)
    parser.error = lambda message: parser.exit(2, f"{parser.prog}: {message}\n")
    parser.add_argument("model", help="model file, .npz")
    parser.add_argument("-o", "--output", required=True, type=Path, help="picture to write, .png")
    parser.add_argument("--drag", metavar="VERTEX:DX,DY,DZ", help="an id or top, and model units")
    parser.add_argument("--size", default=128, type=int, help="pixels along a side; 128")
    given = parser.parse_args(words)
    try:
        if given.output.suffix != ".png" or not given.output.parent.is_dir() or given.size < 1:
            raise ValueError("write a .png to a folder that exists, with 1 pixel or more a side")
        field = load(given.model).definition
        x = field.rest_vertices
        x = x if given.drag is None else dragged(field, *drag_of(given.drag, x))
        picture = Image.fromarray(drawn(field, x, given.size))
        with whole_file(given.output) as path:
            picture.save(path)
    except (ValueError, OSError, MemoryError) as error:
        parser.error(str(error) or "the memory is too small")
    except KeyboardInterrupt:
        parser.exit(130, f"\n{parser.prog}: interrupted\n")


if __name__ == "__main__":
    main()
