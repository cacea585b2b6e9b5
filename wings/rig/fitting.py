"""Weights and offsets of a mesh from the weights of a skinned surface inside it.

The mesh of a field is coarse and lies around the object's surface, so a vertex may be near two
legs at once, and its nearest surface point says little.  What counts is what points *on* the
surface do: a point p in a tet moves by the weights Σ_c b_c w_c, b its barycentric coordinates.
So the weights w [V, B] minimize

    Σ_p a_p |Σ_c b_pc w_c − s_p|² · FIT / l + Σ_edges k_ij |w_i − w_j|²

among those that are ≥ 0 and sum to 1, over samples p of the surface: a_p their area, s_p their
weights, l the mesh's mean edge; the second sum is that of the Laplacian (laplacian.py).  Away from
the surface w is harmonic.

A triangle of the surface stays flat: with corners x_i, and p at the barycentric coordinates β_i,
bones move p by Σ_i β_i Σ_b w_ib M_b x_i, along chords.  Weights alone would move it along arcs,
which bulge far over a large triangle.  Tets are flat as well, so arcs of their corners become
chords inside.  What is missing on both sides is

    o_b(p) = Σ_i β_i s_ib (x_i − p) − Σ_c b_c w_cb (x_c − p),   Σ_b o_b = 0,

and offsets (skinning.py; animation space, Merry et al. 2006) that are fitted to these as weights
are to s bring it: where both fits are exact, p moves as the surface's own weights say.

Shapes: V vertices, T tets, B bones, S points and M triangles of the surface, N samples on it.
"""

import numpy as np

from ...core.geometry import TetMesh, components, edges
from .laplacian import laplacian, pulled_at, solved, solved_as_shares
from .weights import cleaned, cleaned_offsets, copied_to_lone_parts

FIT = 300.0
SPACING = 0.34  # of samples, in mean edges of the mesh
MOST_SAMPLES = 200_000
MOST_DIVISIONS = 16  # of a triangle's side
INSIDE = -1e-9  # barycentric coordinates of a point in a tet are not below


def fitted_weights(
    mesh: TetMesh,
    points: np.ndarray,
    triangles: np.ndarray,
    point_weights: np.ndarray,
    fit: float = FIT,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Weights and offsets under which the surface moves as its own weights say.

    Args:
        points: Of the skinned surface [S, 3], in the space of the mesh.
        triangles: Ids of points [M, 3].
        point_weights: [S, B]
        fit: How much the surface counts against smoothness.

    Returns:
        Weights [V, B] float32, and offsets [V, B, 3] float32 or None.

    Raises:
        ValueError: The surface does not lie in the mesh.
    """
    points = np.asarray(points, float)
    edge = np.linalg.norm(np.subtract(*mesh.rest_vertices[edges(mesh.tets).T]), axis=1).mean()
    places, areas, wanted = surface_samples(points, triangles, point_weights, edge)
    tet, bary = located(mesh, places)
    found = tet >= 0
    if found.mean() < 0.25:
        raise ValueError(
            f"only {found.mean():.0%} of the rig's surface lies inside the model: the rig is of "
            "another object, or --transform does not place it"
        )
    corners, bary = mesh.tets[tet[found]], bary[found]  # [N, 4]
    extended = _extension(mesh, corners, bary, fit * areas[found] / edge)
    weights = cleaned(extended(wanted[found], as_shares=True))
    offsets = np.zeros((*weights.shape, 3))
    for bone in np.flatnonzero(weights.any(axis=0)):
        moments = point_weights[:, bone, None] * points
        moments = surface_samples(points, triangles, moments, edge)[2]
        chords = (moments - wanted[:, bone, None] * places)[found]
        shares = bary * weights[corners, bone]
        there = np.einsum("nc,nci->ni", shares, mesh.rest_vertices[corners])
        there -= shares.sum(axis=1, keepdims=True) * places[found]
        offsets[:, bone] = extended(chords - there)
    return weights, cleaned_offsets(offsets, weights, np.ptp(points, axis=0).max())


def _extension(mesh: TetMesh, corners, bary, strength):
    """A function: values [N, B] at places, to those of all vertices [V, B] that fit them best.

    With `as_shares` they are the best of those that are ≥ 0 and sum to 1.

    Args:
        corners: Vertices of the tets that the places lie in [N, 4].
        bary: Barycentric coordinates of the places [N, 4].
        strength: How much each place counts against the Laplacian [N].
    """
    count, shares = mesh.vertex_count, strength[:, None] * bary
    operator = pulled_at(laplacian(mesh), corners, bary, strength)
    labels = components(count, mesh.tets)
    alone = ~np.isin(labels, labels[corners])

    def scattered(values):
        """Σ_p a_p b_pc v_p at the vertices.  [V, B]"""
        columns = [(shares * column[:, None]).ravel() for column in values.T]
        return np.stack([np.bincount(corners.ravel(), c, minlength=count) for c in columns], axis=1)

    def extended(values, as_shares=False):
        sources = scattered(values)
        u = copied_to_lone_parts(mesh, solved(operator, 0.0, sources), alone)
        return solved_as_shares(operator, sources, u) if as_shares else u

    return extended


def surface_samples(
    points: np.ndarray, triangles: np.ndarray, point_weights: np.ndarray, edge: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places spread over triangles, at most a third of a mesh's edge apart.

    A triangle is cut into n² equal ones; their middles are the samples.

    Returns:
        Places [N, 3], areas [N], weights [N, B].
    """
    corners = np.asarray(points, float)[triangles]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(crossed, axis=1)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    divisions = np.clip(np.ceil(longest / (SPACING * edge)), 1, MOST_DIVISIONS).astype(int)
    while (divisions**2).sum() > MOST_SAMPLES and divisions.max() > 1:
        divisions = np.maximum(1, divisions // 2)
    places, shares, weights = [], [], []
    for count in np.unique(divisions):
        chosen = divisions == count
        inner = _middles(count)  # [n², 3]
        places.append(np.einsum("kc,mci->mki", inner, corners[chosen]).reshape(-1, 3))
        shares.append(np.repeat(areas[chosen] / count**2, count**2))
        theirs = np.einsum("kc,mcb->mkb", inner, point_weights[triangles[chosen]])
        weights.append(theirs.reshape(-1, point_weights.shape[1]))
    return np.concatenate(places), np.concatenate(shares), np.concatenate(weights)


def _middles(count: int):
    """Barycentric coordinates of the middles of a triangle's count² equal triangles."""
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
