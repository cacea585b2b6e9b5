"""The matter of a field: its occupied sub-tets, how they look, and which touch each other.

    depth    optical depth across a sub-tet: its density times its edge
    color    as seen in the mean over all directions, of what is dense in it
    area     of the face that two sub-tets share, over the mean of all

Of a large field the nodes are the eight children of each tet instead, with what is in their
sub-tets: a stroke has to be answered in a second.

Shapes: N occupied sub-tets, or children that have some; E pairs of them with a common face.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...definition.networks import GEOMETRY_FEATURES, geometry, mlp, sigma_from, sigmoid
from ...geometry import TetMesh, path_corners, tet_neighbours
from ..field import TetField
from ..networks.basis import CONSTANT_BASIS
from ..occupancy import LEVELS, SUBTET_COUNT, pack_mask, subtet_corners, unpack_mask

AT_ONCE = 1 << 16  # sub-tets, that the networks are asked about
MANY = 300_000  # sub-tets: with more, children are taken instead
# Where a sub-tet is looked at: its middle, and half the way from there to each corner.
LOOKS = 0.5 * np.concatenate([np.full((1, 4), 0.5), np.eye(4) + 0.25])
LOOKS /= LOOKS.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class SubtetGraph:
    """Occupied sub-tets as a graph.

    Lengths are model units.
    """

    tets: np.ndarray  # [N] int, that hold them
    subtets: np.ndarray  # [N] int, which of a tet's 8^levels they are
    middles: np.ndarray  # [N, 3] float64, at rest
    volumes: np.ndarray  # [N]
    depths: np.ndarray  # [N]
    colors: np.ndarray  # [N, 3], 0..1
    nodes: np.ndarray  # [N, 4] int: their corners, numbered
    pairs: np.ndarray  # [E, 2] int
    areas: np.ndarray  # [E]
    tet_count: int
    levels: int = LEVELS  # of subdivision; 1 if children are taken

    @property
    def edge(self) -> float:
        """The edge of a regular tet of the mean volume."""
        return float(np.cbrt(6.0 * np.sqrt(2.0) * self.volumes.mean()))

    @cached_property
    def groups(self) -> tuple[np.ndarray, ...]:
        """A number for each, the same in all of a tet; then, unless nodes are children, of a child.

        [N] int each
        """
        return tuple(
            8**k * self.tets + self.subtets // 8 ** (self.levels - k) for k in range(self.levels)
        )

    def masks(self, chosen: np.ndarray) -> np.ndarray:
        """Some of them [N] bool as masks of the field's tets, empty sub-tets of a child as well.

        [T] uint64
        """
        occupied = np.zeros((self.tet_count, 8**self.levels), bool)
        occupied[self.tets[chosen], self.subtets[chosen]] = True
        return pack_mask(np.repeat(occupied, SUBTET_COUNT // 8**self.levels, axis=1))

    @property
    def weights(self) -> np.ndarray:
        """Where the middle of each lies in its tet, barycentric.  [N, 4]"""
        return path_corners(self.levels).mean(axis=1)[self.subtets] / 2**self.levels

    @cached_property
    def tree(self):
        """A cKDTree of SciPy over the middles."""
        from scipy.spatial import cKDTree

        return cKDTree(self.middles)


def graph_of(field: TetField, many: int = MANY) -> SubtetGraph:
    """The matter of a field; of one with more than `many` sub-tets, by children."""
    mesh = field.mesh
    tets, subtets = np.nonzero(unpack_mask(field.occupancy))
    volumes = volumes_of(corners_of(mesh, tets, subtets))
    edges = np.cbrt(6.0 * np.sqrt(2.0) * volumes)
    is_large = len(tets) > many
    sigma, seen = _looks(field, tets, subtets, LOOKS[:1] if is_large else LOOKS)
    depths, levels = sigma * edges, LEVELS
    if is_large:
        tets, subtets, depths, seen = _by_children(tets, subtets, depths, seen)
        levels = LEVELS - 1
    own = corners_of(mesh, tets, subtets, levels)
    nodes = numbered_corners(mesh, tets, subtets, levels)
    pairs, areas = touching(nodes, own)
    return SubtetGraph(
        tets=tets,
        subtets=subtets,
        middles=own.mean(axis=1),
        volumes=volumes_of(own),
        depths=depths,
        colors=_colors(field, seen),
        nodes=nodes,
        pairs=pairs,
        areas=areas,
        tet_count=mesh.tet_count,
        levels=levels,
    )


def subtet_colors(field: TetField, tets: np.ndarray, subtets: np.ndarray) -> np.ndarray:
    """What color sub-tets have in their middles, in the mean over all directions.  [n, 3], 0..1

    Args:
        tets: That hold them.  [n] int
        subtets: Which of a tet's sub-tets they are.  [n] int
    """
    return _colors(field, _looks(field, tets, subtets, LOOKS[:1])[1])


def _by_children(tets, subtets, depths, seen):
    """Children instead of their sub-tets: the mean opacity, and the mean h of what is opaque."""
    keys, child = np.unique(8 * tets + subtets // 8, return_inverse=True)
    opacity = np.maximum(1.0 - np.exp(-depths), 1e-12)
    sums = np.bincount(child, opacity)
    means = [np.bincount(child, opacity * column) / sums for column in seen.T]
    depths = -np.log1p(-np.minimum(sums / 8.0, 1.0 - 1e-6))
    return keys // 8, keys % 8, depths, np.stack(means, axis=1)


def _looks(field, tets, subtets, looks):
    """Mean density [N] of sub-tets, and the mean h [N, 16] of what is dense in them.

    Args:
        looks: Where each is looked at, by its corners.  [n, 4]
    """
    places = np.einsum("lc,sck->slk", looks, subtet_corners())  # [64, look, 4]
    single = replace(field.definition, encoding=_in_single(field.definition.encoding))
    sigma, seen = np.zeros(len(tets)), np.zeros((len(tets), GEOMETRY_FEATURES))
    for first in range(0, len(tets), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        count = len(tets[some])
        alpha = places[subtets[some]].reshape(-1, 4)
        h = geometry(single, np.repeat(tets[some], len(looks)), alpha)
        density = sigma_from(h).reshape(count, -1)
        sigma[some] = density.mean(axis=1)
        shares = density / density.sum(axis=1, keepdims=True)
        seen[some] = np.einsum("nl,nlh->nh", shares, h.reshape(count, len(looks), -1))
    return sigma, seen


def _colors(field, seen):
    """Colors for h [N, 16], in the mean over all directions.  [N, 3]"""
    colors = np.zeros((len(seen), 3))
    for first in range(0, len(seen), AT_ONCE):
        h = seen[first : first + AT_ONCE]
        x = np.concatenate([h, np.tile(CONSTANT_BASIS, (len(h), 1))], axis=1, dtype=np.float32)
        colors[first : first + AT_ONCE] = sigmoid(mlp(x, field.color_layers))
    return colors


def _in_single(encoding):
    """The same features in float32."""
    return replace(encoding, tables=tuple(t.astype(np.float32) for t in encoding.tables))


def corners_of(mesh, tets, subtets, levels=LEVELS):
    """Corners of sub-tets, or children, at rest.  [N, 4, 3]"""
    corners = mesh.rest_vertices[mesh.tets]  # [T, 4, 3]
    weights = path_corners(levels)[subtets] / 2**levels
    return np.einsum("nck,nkx->ncx", weights, corners[tets])


def volumes_of(corners):
    """Of tets by their corners.  [N, 4, 3] -> [N]"""
    return np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6.0


def numbered_corners(mesh: TetMesh, tets: np.ndarray, subtets: np.ndarray, levels=LEVELS):
    """Numbers of the corners of sub-tets, the same in all that share one.  [N, 4] int

    Args:
        tets, subtets: The tet that holds each [N], and its number in it [N].
        levels: 1 of children.
    """
    corners = mesh.addresses[mesh.tets].astype(int)[tets]
    addresses = np.einsum("nck,nkx->ncx", path_corners(levels)[subtets], corners)
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
    return np.stack([one, neighbours[one, face]]).T, areas / mean  # cuts read column by column
