"""Matter of simple solids, as shells or filled: what Isolate's parts are tested with."""

import numpy as np

from deformrf.core.field import subtet_middles
from deformrf.core.field.isolation.subtet_graph import (
    SubtetGraph,
    corners_of,
    numbered_corners,
    touching,
)
from deformrf.core.geometry import a15_grid, signed_volumes

DEPTH = 5.0  # optical, of each sub-tet


def matter_where(inside, colors=None, spacing=0.06) -> SubtetGraph:
    """The matter of a grid in the unit cube.

    Args:
        inside: Of middles [N, 3], whether matter is there.  [N] bool
        colors: Of middles [N, 3], their colors [N, 3]; gray by default.
    """
    mesh = a15_grid(spacing)
    places = subtet_middles(mesh).astype(float)
    chosen = inside(places.reshape(-1, 3)).reshape(places.shape[:2])
    tets, subtets = np.nonzero(chosen)
    middles = places[tets, subtets]
    nodes = numbered_corners(mesh, tets, subtets)
    pairs, areas = touching(nodes, corners_of(mesh, tets, subtets))
    return SubtetGraph(
        tets=tets,
        subtets=subtets,
        middles=middles,
        volumes=signed_volumes(mesh.rest_vertices, mesh.tets)[tets] / 64.0,
        depths=np.full(len(tets), DEPTH),
        colors=np.full(middles.shape, 0.5) if colors is None else colors(middles),
        nodes=nodes,
        pairs=pairs,
        areas=areas,
        tet_count=mesh.tet_count,
    )


def ball(center, radius, thickness=None):
    """Whether points are in a ball, or in a shell of that thickness inside its surface."""

    def inside(points):
        away = np.linalg.norm(points - np.asarray(center), axis=1)
        return (away < radius) & (thickness is None or away > radius - thickness)

    return inside


def slab(low, high):
    """Whether points are in a box."""
    return lambda points: ((points > np.asarray(low)) & (points < np.asarray(high))).all(axis=1)


def any_of(*parts):
    return lambda points: np.any([part(points) for part in parts], axis=0)
