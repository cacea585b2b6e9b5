"""Convert a field to a colored triangle mesh for other programs.

`seen_from_outside` finds the color of points on a surface: for each point it casts a ray from just
outside, inwards along the normal.  `preview` makes the surface: it takes the boundary of the
sub-tets that may have density, and moves its points inwards to where the field is opaque.  Each
point is fixed in a tet, so the surface bends with the field.

Shapes: N points, F triangles.
"""

import numpy as np

from ..field import TetField, subtet_corners, unpack_mask
from ..geometry import (
    EmbeddedSurface,
    boundary_faces,
    components,
    located,
    path_corners,
    tet_neighbours,
)
from .render import Renderer
from .render_options import RenderOptions

GRAY = 128
FEWEST_OPAQUE = 0.5  # opacity that a color needs
SUBTET_LEVELS = 2
DEEPEST = 3.0  # sub-tet edges that a point is drawn in at most
SMALLEST_PART = 0.01  # of all triangles: smaller parts are left out
ROUNDS = 3  # of smoothing


def seen_from_outside(
    renderer: Renderer, points: np.ndarray, normals: np.ndarray, distance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a Renderer, which has the pose, sees of each point along its normal.

    Args:
        points: [N, 3]; normals: unit vectors outwards [N, 3].
        distance: From a point to where its ray starts.

    Returns:
        Colors [N, 3] uint8, gray where nothing is; whether something is [N]; how far inwards of
        the point it lies [N].
    """
    origins = (points + distance * normals).astype(np.float32)
    options = RenderOptions(background=(0.0, 0.0, 0.0))
    color, opacity, depth = renderer.render_rays(origins, -normals.astype(np.float32), options)
    own = color / np.maximum(opacity, 1e-3)[:, None]
    colors = np.clip(255.0 * own + 0.5, 0.0, 255.0).astype(np.uint8)
    colors[opacity < FEWEST_OPAQUE] = GRAY
    return colors, opacity >= FEWEST_OPAQUE, depth - distance


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals outwards, means of those of the faces by area.  [N, 3] float64"""
    a, b, c = np.asarray(vertices, float)[faces].transpose(1, 0, 2)
    normals = np.zeros(vertices.shape)
    for corner in faces.T:
        np.add.at(normals, corner, np.cross(b - a, c - a))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    upright = np.array([0.0, 0.0, 1.0])  # where faces cancel each other out
    return np.where(lengths > 0.0, normals / np.maximum(lengths, 1e-30), upright)


def preview(field: TetField, renderer: Renderer) -> EmbeddedSurface:
    """The field's surface at rest, in the colors that its normals see.

    Args:
        renderer: One of the field, at rest.
    """
    mesh = field.mesh
    tets, weights, faces = _boundary(field)
    points = np.einsum("nk,nkx->nx", weights, mesh.rest_vertices[mesh.tets[tets]])
    sides = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    edge = float(np.median(np.linalg.norm(points[sides[:, 0]] - points[sides[:, 1]], axis=1)))
    normals = vertex_normals(_smoothed(points, sides), faces)
    colors, opaque, depth = seen_from_outside(renderer, points, normals, 0.5 * edge)
    inwards = np.where(opaque, np.clip(depth, 0.0, DEEPEST * edge), 0.0)
    points = _smoothed(points - inwards[:, None] * normals, sides)
    tets, weights = located(mesh, field.neighbours, tets, points)
    colors = _spread(colors, opaque, sides)
    return EmbeddedSurface(
        mesh.tets[tets], weights.astype(np.float32), faces.astype(np.int32), colors
    )


def _boundary(field):
    """The boundary of the occupied sub-tets without specks: tets [N], weights [N, 4], faces."""
    tet, path = np.nonzero(unpack_mask(field.occupancy))
    if len(tet) == 0:
        raise ValueError("the model is empty: it has no preview")
    corners = path_corners(SUBTET_LEVELS)[path]  # [S, 4, 4]
    addresses = field.mesh.addresses[field.mesh.tets[tet]].astype(np.int64)
    nodes = np.einsum("skt,stx->skx", corners, addresses).reshape(-1, 3)
    _, first, ids = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
    subtets = ids.reshape(-1, 4)
    faces, _ = boundary_faces(subtets, tet_neighbours(subtets))
    label = components(len(first), faces)[faces[:, 0]]
    faces = faces[np.bincount(label)[label] >= SMALLEST_PART * len(faces)]
    used, faces = np.unique(faces, return_inverse=True)
    corner = first[used]  # of all sub-tets' corners, one at that node
    weights = subtet_corners()[path].reshape(-1, 4)[corner]
    return tet[corner // 4], weights, faces.reshape(-1, 3)


def _means(values, sides):
    """The mean of each point's neighbors along the edges.  [N, ...]"""
    sums, counts = np.zeros(values.shape), np.zeros(len(values))
    for here, there in (sides.T, sides.T[::-1]):
        np.add.at(sums, here, values[there])
        np.add.at(counts, here, 1.0)
    return sums / np.maximum(counts, 1.0)[:, None]


def _smoothed(points, sides):
    for _ in range(ROUNDS):
        points = 0.5 * (points + _means(points, sides))
    return points


def _spread(colors, known, sides):
    """Colors [N, 3] uint8; those that aren't known are means of neighbors that are."""
    values, share = colors * known[:, None].astype(float), known[:, None].astype(float)
    for _ in range(32):
        near, there = _means(values, sides), _means(share, sides)
        fill = (share[:, 0] == 0.0) & (there[:, 0] > 0.0)
        if not fill.any():
            break
        values[fill], share[fill] = near[fill] / there[fill], 1.0
    values[share[:, 0] == 0.0] = GRAY
    return np.round(values).astype(np.uint8)
