"""Weights of a mesh from those of a skinned surface inside it.

The mesh of a field is coarse and lies around the object's surface, so a vertex may be near two
legs at once, and its nearest surface point says little.  What counts is what points *on* the
surface do: a point p in a tet moves by the weights Σ_c b_c w_c, b its barycentric coordinates.
So the weights w [V, B] minimize

    Σ_p a_p |Σ_c b_pc w_c − s_p|² · FIT / l + Σ_edges k_ij |w_i − w_j|²

over samples p of the surface: a_p their area, s_p their weights, l the mesh's mean edge; the
second sum is that of the Laplacian (laplacian.py).  Away from the surface w is harmonic.

Shapes: V vertices, T tets, B bones, S points and M triangles of the surface, N samples on it.
"""

import numpy as np

from ..geometry import TetMesh, components, edges
from .laplacian import laplacian, solved_with

FIT = 100.0
SPACING = 0.34  # of samples, in mean edges of the mesh
MOST_SAMPLES = 200_000
MOST_PARTS = 16  # of a triangle's side
INSIDE = -1e-9  # barycentric coordinates of a point in a tet are not below


def fitted_weights(mesh: TetMesh, points, triangles, point_weights, fit=FIT) -> np.ndarray:
    """Weights under which the surface moves as its own weights say.  [V, B] float32

    Args:
        points: Of the skinned surface [S, 3], in the space of the mesh.
        triangles: Ids of points [M, 3].
        point_weights: [S, B]
        fit: How much the surface counts against smoothness.

    Raises:
        ValueError: The surface does not lie in the mesh.
    """
    from .weights import cleaned, copied_to_lone_parts

    pairs = edges(mesh.tets)
    lengths = np.linalg.norm(np.subtract(*mesh.rest_vertices[pairs.T]), axis=1)
    places, areas, weights = surface_samples(points, triangles, point_weights, lengths.mean())
    tet, bary = located(mesh, places)
    found = tet >= 0
    if found.mean() < 0.25:
        raise ValueError(
            f"only {found.mean():.0%} of the rig's surface lies inside the model: the rig is of "
            "another object, or --transform does not place it"
        )
    tet, bary, weights = tet[found], bary[found], weights[found]
    strength = fit * areas[found] / lengths.mean()
    corners = mesh.tets[tet]  # [N, 4]
    shares = strength[:, None] * bary

    def scattered(values):
        """Σ_p a_p b_pc v_p at the vertices.  [V, B]"""
        result = np.empty((mesh.vertex_count, values.shape[1]))
        for column in range(values.shape[1]):
            parts = (shares * values[:, column : column + 1]).ravel()
            result[:, column] = np.bincount(corners.ravel(), parts, minlength=mesh.vertex_count)
        return result

    def pulled(w):
        return scattered(np.einsum("nc,ncb->nb", bary, w[corners]))

    diagonal = np.bincount(corners.ravel(), (shares * bary).ravel(), minlength=mesh.vertex_count)
    w = solved_with(laplacian(mesh), pulled, diagonal, scattered(weights))
    labels = components(mesh.vertex_count, mesh.tets)
    alone = ~np.isin(labels, labels[corners])
    return cleaned(copied_to_lone_parts(mesh, np.maximum(w, 0.0), alone))


def surface_samples(points, triangles, point_weights, edge: float):
    """Places spread over triangles, at most a third of a mesh's edge apart.

    A triangle is cut into n² equal ones; their middles are the samples.

    Returns:
        Places [N, 3], areas [N], weights [N, B].
    """
    corners = np.asarray(points, float)[triangles]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(crossed, axis=1)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(longest / (SPACING * edge)), 1, MOST_PARTS).astype(int)
    while (parts**2).sum() > MOST_SAMPLES and parts.max() > 1:
        parts = np.maximum(1, parts // 2)
    places, shares, weights = [], [], []
    for count in np.unique(parts):
        chosen = parts == count
        inner = _middles(count)  # [n², 3]
        places.append(np.einsum("kc,mci->mki", inner, corners[chosen]).reshape(-1, 3))
        shares.append(np.repeat(areas[chosen] / count**2, count**2))
        theirs = np.einsum("kc,mcb->mkb", inner, point_weights[triangles[chosen]])
        weights.append(theirs.reshape(-1, point_weights.shape[1]))
    return np.concatenate(places), np.concatenate(shares), np.concatenate(weights)


def _middles(count: int):
    """Barycentric coordinates of the middles of a triangle's count² equal parts."""
    rows = []
    for i in range(count):
        for j in range(count - i):
            rows.append((i + 1 / 3, j + 1 / 3))
            if i + j < count - 1:
                rows.append((i + 2 / 3, j + 2 / 3))
    u, v = np.array(rows).T / count
    return np.stack([1.0 - u - v, u, v], axis=1)


def located(mesh: TetMesh, places):
    """The tet that each place lies in at rest, -1 outside, and its barycentric coordinates there.

    Tets are listed in the cells of a grid that their boxes touch.

    Returns:
        Tets [N], barycentric coordinates [N, 4].
    """
    x = mesh.rest_vertices
    corners = x[mesh.tets]
    low, high = corners.min(axis=1), corners.max(axis=1)
    origin, cell = x.min(axis=0), np.median(high - low)
    first = np.floor((low - origin) / cell).astype(np.int64)
    last = np.floor((high - origin) / cell).astype(np.int64)
    counts = last.max(axis=0) + 1
    tets, keys = [], []
    reach = (last - first).max(axis=0) + 1
    for step in np.ndindex(*reach):
        inside = (first + step <= last).all(axis=1)
        tets.append(np.flatnonzero(inside))
        keys.append(np.ravel_multi_index((first[inside] + step).T, counts))
    tets, keys = np.concatenate(tets), np.concatenate(keys)
    order = np.argsort(keys, kind="stable")
    tets, keys = tets[order], keys[order]
    inverse = np.linalg.inv(np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2))
    found, bary = np.full(len(places), -1), np.zeros((len(places), 4))
    place = np.floor((places - origin) / cell).astype(np.int64)
    open_ = np.flatnonzero(((place >= 0) & (place < counts)).all(axis=1))
    key = np.ravel_multi_index(place[open_].T, counts)
    entry, end = np.searchsorted(keys, key), np.searchsorted(keys, key, side="right")
    while len(open_):
        going = entry < end
        open_, entry, end = open_[going], entry[going], end[going]
        if not len(open_):
            break
        tet = tets[entry]
        rest = np.einsum("nij,nj->ni", inverse[tet], places[open_] - corners[tet, 0])
        all_ = np.concatenate([1.0 - rest.sum(axis=1, keepdims=True), rest], axis=1)
        hit = (all_ >= INSIDE).all(axis=1)
        found[open_[hit]], bary[open_[hit]] = tet[hit], all_[hit]
        open_, entry, end = open_[~hit], entry[~hit] + 1, end[~hit]
    return found, bary
