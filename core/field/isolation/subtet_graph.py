"""The matter of a field: its occupied sub-tets, how they look, and which touch each other.

    depth    optical depth across a sub-tet: its density times its edge
    color    as seen in the mean over all directions, of what is dense in it
    area     of the face that two sub-tets share, over the mean of all

Shapes: N occupied sub-tets, E pairs of them with a common face.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...definition.networks import geometry, mlp, sigma_from, sigmoid
from ...geometry import TetMesh, path_corners, tet_neighbours
from ..field import TetField
from ..networks.basis import CONSTANT_BASIS
from ..occupancy import LEVELS, SUBTET_COUNT, pack_mask, subtet_corners, unpack_mask

AT_ONCE = 1 << 16  # sub-tets, that the networks are asked about
# Where a sub-tet is looked at: its middle, and half the way from there to each corner.
LOOKS = 0.5 * np.concatenate([np.full((1, 4), 0.5), np.eye(4) + 0.25])
LOOKS /= LOOKS.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class SubtetGraph:
    """Occupied sub-tets as a graph.

    Lengths are model units.
    """

    tets: np.ndarray  # [N] int, that hold them
    subtets: np.ndarray  # [N] int, 0..63
    middles: np.ndarray  # [N, 3] float64, at rest
    volumes: np.ndarray  # [N]
    depths: np.ndarray  # [N]
    colors: np.ndarray  # [N, 3], 0..1
    nodes: np.ndarray  # [N, 4] int: their corners, numbered
    pairs: np.ndarray  # [E, 2] int
    areas: np.ndarray  # [E]
    tet_count: int

    @property
    def edge(self) -> float:
        """The edge of a regular tet of the mean volume."""
        return float(np.cbrt(6.0 * np.sqrt(2.0) * self.volumes.mean()))

    def masks(self, chosen: np.ndarray) -> np.ndarray:
        """Some of them [N] bool as masks of the field's tets.  [T] uint64"""
        occupied = np.zeros((self.tet_count, SUBTET_COUNT), bool)
        occupied[self.tets[chosen], self.subtets[chosen]] = True
        return pack_mask(occupied)

    @cached_property
    def tree(self):
        """A cKDTree of SciPy over the middles."""
        from scipy.spatial import cKDTree

        return cKDTree(self.middles)


def graph_of(field: TetField) -> SubtetGraph:
    """The matter of a field."""
    mesh = field.mesh
    tets, subtets = np.nonzero(unpack_mask(field.occupancy))
    own = corners_of(mesh, tets, subtets)
    sides = own[:, 1:] - own[:, :1]
    volumes = np.abs(np.linalg.det(sides)) / 6.0
    sigma, colors = _looks(field, tets, subtets)
    edges = np.cbrt(6.0 * np.sqrt(2.0) * volumes)
    nodes = numbered_corners(mesh, tets, subtets)
    pairs, areas = touching(nodes, own)
    middles = own.mean(axis=1)
    return SubtetGraph(
        tets=tets,
        subtets=subtets,
        middles=middles,
        volumes=volumes,
        depths=sigma * edges,
        colors=colors,
        nodes=nodes,
        pairs=pairs,
        areas=areas,
        tet_count=mesh.tet_count,
    )


def _looks(field, tets, subtets):
    """Mean density [N] of sub-tets, and the color [N, 3] of what is dense in them."""
    places = np.einsum("lc,sck->slk", LOOKS, subtet_corners())  # [64, look, 4]
    single = replace(field.definition, encoding=_in_single(field.definition.encoding))
    sigma, colors = np.zeros(len(tets)), np.zeros((len(tets), 3))
    for first in range(0, len(tets), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        count = len(tets[some])
        alpha = places[subtets[some]].reshape(-1, 4)
        h = geometry(single, np.repeat(tets[some], len(LOOKS)), alpha)
        density = sigma_from(h).reshape(count, -1)
        sigma[some] = density.mean(axis=1)
        shares = density / density.sum(axis=1, keepdims=True)
        means = np.einsum("nl,nlh->nh", shares, h.reshape(count, len(LOOKS), -1))
        basis = np.tile(CONSTANT_BASIS, (count, 1))
        colors[some] = sigmoid(mlp(np.concatenate([means, basis], axis=1), field.color_layers))
    return sigma, colors


def _in_single(encoding):
    """The same features in float32."""
    return replace(encoding, tables=tuple(t.astype(np.float32) for t in encoding.tables))


def corners_of(mesh, tets, subtets):
    """Corners of sub-tets at rest.  [N, 4, 3]"""
    corners = mesh.rest_vertices[mesh.tets]  # [T, 4, 3]
    return np.einsum("nck,nkx->ncx", subtet_corners()[subtets], corners[tets])


def numbered_corners(mesh: TetMesh, tets: np.ndarray, subtets: np.ndarray) -> np.ndarray:
    """Numbers of the corners of sub-tets, the same in all that share one.  [N, 4] int

    Args:
        tets, subtets: The tet that holds each [N], and its number in it [N].
    """
    corners = mesh.addresses[mesh.tets].astype(int)[tets]
    addresses = np.einsum("nck,nkx->ncx", path_corners(LEVELS)[subtets], corners)
    x, y, z = (addresses - addresses.min(axis=(0, 1), initial=0)).transpose(2, 0, 1)
    keys = (x << 42) | (y << 21) | z
    return np.unique(keys, return_inverse=True)[1].reshape(keys.shape)


def touching(nodes: np.ndarray, corners: np.ndarray):
    """Pairs of sub-tets with a common face [E, 2], and its area over the mean [E].

    Args:
        nodes: As `numbered_corners` gives them.  [N, 4]
        corners: Where they are.  [N, 4, 3]
    """
    neighbours = tet_neighbours(nodes)
    one, face = np.nonzero(neighbours > np.arange(len(nodes))[:, None])
    rest = np.array([[j for j in range(4) if j != i] for i in range(4)])[face]
    a, b, c = np.moveaxis(corners[one[:, None], rest], 1, 0)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    mean = areas.mean() if len(areas) else 1.0
    return np.stack([one, neighbours[one, face]], axis=1), areas / mean
