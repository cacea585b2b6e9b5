"""A tetrahedral mesh and the tables that follow from its connectivity.

Face i of a tet is opposite corner i.  FACES[i] lists the face's corners in the order in which its
normal points out of a positively oriented tet.  Every function that makes a mesh orients its tets:
all rest volumes are positive.

Shapes: V vertices, T tets, E edges, B boundary faces.
"""

from dataclasses import dataclass

import numpy as np

from ..definition.solver import EDGES as EDGES
from ..definition.solver import signed_volumes as signed_volumes

FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])  # [4, 3], outward
KEY_BITS = 21  # of a vertex id in the number of a face: three ids fit 63 bits


@dataclass(frozen=True)
class TetMesh:
    """Rest geometry and topology; deformation changes neither."""

    rest_vertices: np.ndarray  # [V, 3] float64: undeformed positions, model space
    addresses: np.ndarray  # [V, 3] int32: lattice coordinates of the vertices at level 0
    tets: np.ndarray  # [T, 4] int32: vertex ids, positive rest volume

    def __post_init__(self):
        assert self.rest_vertices.shape == (self.vertex_count, 3), self.rest_vertices.shape
        assert self.addresses.shape == (self.vertex_count, 3), self.addresses.shape
        assert self.tets.shape == (self.tet_count, 4), self.tets.shape

    @property
    def vertex_count(self) -> int:
        return len(self.rest_vertices)

    @property
    def tet_count(self) -> int:
        return len(self.tets)


def tet_neighbours(tets: np.ndarray) -> np.ndarray:
    """The tet across face i of each tet, -1 where there is none.  [T, 4] int32

    Raises:
        ValueError: A face belongs to more than two tets, or there are more than 2^21 vertices.
    """
    if tets.max(initial=0) >= 1 << KEY_BITS:
        raise ValueError(f"the mesh has more than {1 << KEY_BITS} vertices")
    keys = np.empty((len(tets), 4), np.int64)  # a face is one number: its sorted vertex ids
    for face, corners in enumerate(FACES):
        a, b, c = np.sort(tets[:, corners], axis=1).T.astype(np.int64)
        keys[:, face] = (a << 2 * KEY_BITS) | (b << KEY_BITS) | c
    keys = keys.ravel()
    order = np.argsort(keys)
    same = keys[order[1:]] == keys[order[:-1]]
    if (same[1:] & same[:-1]).any():
        raise ValueError("the mesh is not a manifold: a face belongs to more than two tets")
    neighbours = np.full(len(keys), -1, np.int32)
    first, second = order[:-1][same], order[1:][same]
    neighbours[first], neighbours[second] = second // 4, first // 4
    return neighbours.reshape(-1, 4)


def boundary_faces(tets: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces of one tet only, normals outward: vertex ids [B, 3] and their tets [B], int32."""
    tet, face = np.nonzero(neighbours < 0)
    return tets[tet[:, None], FACES[face]].astype(np.int32), tet.astype(np.int32)


def edges(tets: np.ndarray) -> np.ndarray:
    """Every edge once, lower vertex id first.  [E, 2] int32"""
    ends = np.sort(tets[:, EDGES].reshape(-1, 2).astype(np.int64), axis=1)
    count = int(ends.max(initial=0)) + 1
    keys = np.unique(ends[:, 0] * count + ends[:, 1])  # of rows, it takes ten times as long
    return np.stack([keys // count, keys % count], axis=1).astype(np.int32)


def components(vertex_count: int, tets: np.ndarray) -> np.ndarray:
    """A label 0..C-1 per vertex; vertices that share a tet have the same one.  [V] int32

    Labels rise with the lowest vertex of each component.  `tets` are vertex ids, or other groups
    of ids that belong together [T, n].  Not by scipy.sparse.csgraph, because the viewer calls
    this, and viewing is installed without scipy.
    """
    labels = np.arange(vertex_count)
    while True:  # each round halves the longest chain of labels, so there are few
        lowest = labels[tets].min(axis=1)
        new = labels.copy()
        for corner in tets.T:
            np.minimum.at(new, corner, lowest)
        new = new[new]
        if (new == labels).all():
            return np.unique(labels, return_inverse=True)[1].astype(np.int32)
        labels = new


def face_components(neighbours: np.ndarray, keep: np.ndarray | None = None) -> np.ndarray:
    """A label 0..C-1 per tet; tets that are joined through faces have the same one.  [T] int32

    Tets that touch only along an edge or at a vertex get different labels: they would swing
    like on a hinge.  Tets that are not in `keep` [T] have the label -1.
    """
    keep = np.ones(len(neighbours), bool) if keep is None else keep
    new_ids = np.cumsum(keep) - 1
    tet, face = np.nonzero((neighbours >= 0) & keep[neighbours] & keep[:, None])
    pairs = new_ids[np.stack([tet, neighbours[tet, face]], axis=1)]
    labels = np.full(len(neighbours), -1, np.int32)
    labels[keep] = components(int(keep.sum()), pairs)
    return labels


def fill_enclosed(
    occupied: np.ndarray, neighbours: np.ndarray, closed: np.ndarray | bool = False
) -> np.ndarray:
    """Add the empty tets that no path through empty tets joins to the outside.

    No path leads through tets that are `closed` ([T] bool), but they aren't added for it.

    [T] bool -> [T] bool.  The result is solid, as dynamics needs it; the image does not change.
    """
    is_open = ~(occupied | closed)
    labels = face_components(neighbours, is_open)
    at_border = (neighbours < 0).any(axis=1)
    return occupied | (is_open & ~np.isin(labels, labels[at_border & is_open]))


def extract(mesh: TetMesh, keep: np.ndarray) -> tuple[TetMesh, np.ndarray]:
    """The mesh of the tets in `keep` ([T] bool), and the old id of each vertex in use [V']."""
    tets = mesh.tets[keep]
    used, new_ids = np.unique(tets, return_inverse=True)
    return TetMesh(
        mesh.rest_vertices[used],
        mesh.addresses[used],
        new_ids.reshape(-1, 4).astype(np.int32),
    ), used
