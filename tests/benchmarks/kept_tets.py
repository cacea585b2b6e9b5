"""Which of a model's tets lie outside the object's own box: their share, and a picture.

    python tests/benchmarks/kept_tets.py MODEL --box X0 Y0 Z0 X1 Y1 Z1 --out PICTURE

The box is in the data's units, as --aabb of deformrf-train.  A tet is where its centre is.
The picture shows the centres along the three axes: inside the box, outside, and in another
color where a tet is occupied at all.
"""

import argparse

import numpy as np

from deformrf.core.field import modelfile
from deformrf.core.render import in_space

AXES = "xyz"
COLORS = {"inside, occupied": "#2a6f97", "inside": "#a9d6e5", "outside": "#c1121f"}


def kinds_of(field, box):
    """The centres of the tets in the data's space, and which are of each kind."""
    mesh = field.mesh
    centers = mesh.rest_vertices[mesh.tets].mean(axis=1)
    poses = np.tile(np.eye(4), (len(centers), 1, 1))
    poses[:, :3, 3] = centers
    centers = in_space(poses, np.linalg.inv(field.world_to_model))[:, :3, 3]
    inside = ((centers >= box[0]) & (centers <= box[1])).all(axis=1)
    occupied = field.occupancy != 0
    masks = (inside & occupied, inside & ~occupied, ~inside)
    return centers, dict(zip(COLORS, masks, strict=True))


def draw(centers, kinds, box, path):
    from matplotlib import patches
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.5), layout="constrained")
    for axes, (i, j) in zip(figure.subplots(1, 3), [(0, 1), (0, 2), (1, 2)], strict=True):
        for name, which in reversed(kinds.items()):
            axes.scatter(*centers[which][:, (i, j)].T, s=1, color=COLORS[name], label=name)
        size = box[1] - box[0]
        axes.add_patch(patches.Rectangle(box[0][[i, j]], size[i], size[j], fill=False))
        axes.set(xlabel=AXES[i], ylabel=AXES[j], aspect="equal")
    axes.legend(markerscale=6)
    figure.savefig(path, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("--box", type=float, nargs=6, required=True)
    parser.add_argument("--out")
    arguments = parser.parse_args()
    box = np.reshape(arguments.box, (2, 3))
    field = modelfile.load(arguments.model)
    centers, kinds = kinds_of(field, box)
    for name, which in kinds.items():
        print(f"{name:<18}{which.sum():>8}{which.mean():>8.1%}")
    if arguments.out:
        draw(centers, kinds, box, arguments.out)


if __name__ == "__main__":
    main()
