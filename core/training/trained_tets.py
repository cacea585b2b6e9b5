"""The tets that a stage trains: first those in the scene box, then those near occupied ones."""

from dataclasses import replace

import numpy as np

from ..field import TetField, pack_mask, reduced, subtet_colors, subtet_middles, unpack_mask
from ..geometry import (
    Plane,
    TetMesh,
    extract,
    face_components,
    fill_enclosed,
    located,
    signed_volumes,
    tet_neighbours,
)
from .data.errors import DatasetError
from .run.training_field import TrainingField

SMALLEST_COMPONENT = 0.005  # of the occupied tets; smaller ones are floaters
SMALLEST_PART = 0.01  # of the object's matter
FOG = 0.1  # optical depth across a sub-tet; a tet without more is fog
# SPUR: the fewest tets of a spur.  CORNER: the most occupied sub-tets of a tet that matter only
# touches; what goes through a tet takes four.
SPUR, CORNER = 16, 2
POINTS = 2  # of surfaces, in a tet that is kept for them
# Edges of a sub-tet: what is lower over the ground is the ground's; what is lower than LOW is the
# object's only if something thick is ABOVE it, up to ASIDE beside it.
CLEARANCE, LOW, ABOVE, ASIDE = 0.6, 2.2, 4.4, 1.5
# Edges, too: what lies less than DEEP below the ground, and less than UNDER beside what is above,
# may be a foot's; what is farther than BESIDE from all that is above is the ground's.
DEEP, UNDER, BESIDE = 0.35, 0.3, 2.0
# A foot's color is more than TELL (of 1) away from the mean of the nearest GROUND sub-tets of the
# ground, and less than NEARER times as far from that of the nearest FOOT ones of the object.
FOOT, GROUND, NEARER, TELL = 4, 12, 0.25, 0.05


def boxed(mesh: TetMesh, box, spacing) -> TetMesh:
    """The tets of a grid that lie in a box or at its border."""
    centers = mesh.rest_vertices[mesh.tets].mean(axis=1)
    inside = ((centers > box[0] - spacing) & (centers < box[1] + spacing)).all(axis=1)
    return mesh if inside.all() else extract(mesh, inside)[0]


def kept_mesh(
    field: TrainingField, ground: Plane | None = None, points: np.ndarray | None = None
) -> TetMesh:
    """The tets of stage 2: occupied, their neighbours, enclosed; no floaters.

    Few steps before busy surroundings don't show all that is thin.  Tets that hold points of
    surfaces count as occupied.

    Args:
        ground: What the object stands on, if that was found.  It closes the object, whose
            underside no image shows.
        points: Of surfaces, in model space, which were found with the cameras.  [n, 3]

    Raises:
        DatasetError: Nothing is occupied.
    """
    mesh, neighbours = field.mesh, tet_neighbours(field.mesh.tets)
    occupied = field.occupied.any(dim=1).cpu().numpy()
    if not occupied.any():
        raise DatasetError(
            "stage 1 found nothing: it had too few --steps, or the object doesn't lie in the "
            "scene box (--scene-radius is half the box's edge)"
        )
    if points is not None:
        occupied |= points_in(mesh, neighbours, points) >= POINTS
    keep = solid(occupied, neighbours, closed_by(mesh, ground))
    labels = face_components(neighbours, keep)
    sizes = np.bincount(labels[occupied])  # neighbours would make six times as much of a speck
    keep[keep] = sizes[labels[keep]] >= SMALLEST_COMPONENT * occupied.sum()
    return extract(mesh, keep)[0]


def points_in(mesh: TetMesh, neighbours, points: np.ndarray) -> np.ndarray:
    """How many of some points [n, 3] each tet holds.  [T]"""
    from scipy.spatial import cKDTree

    points = np.asarray(points, float)
    low, high = mesh.rest_vertices.min(axis=0), mesh.rest_vertices.max(axis=0)
    points = points[((points >= low) & (points <= high)).all(axis=1)]  # none that isn't finite
    nearest = cKDTree(mesh.rest_vertices[mesh.tets].mean(axis=1)).query(points)[1]
    tets, weights = located(mesh, neighbours, nearest, points)
    return np.bincount(tets[weights.min(axis=1) > -1e-6], minlength=mesh.tet_count)


def closed_by(mesh: TetMesh, ground: Plane | None):
    """The tets through which nothing leads out of the object: up to half a tet above ground.  [T]

    They close it below, where no image shows a surface.
    """
    if ground is None:
        return np.zeros(mesh.tet_count, bool)
    heights = ground.height(mesh.rest_vertices[mesh.tets].mean(axis=1))
    return heights < 0.5 * regular_edge(mesh)


def solid(occupied, neighbours, closed):
    """Occupied tets and their neighbours, what these and the closed ones enclose, and closed ones
    next to that.  [T] bool
    """
    keep, beside = occupied.copy(), neighbours[occupied]
    keep[beside[beside >= 0]] = True
    filled = fill_enclosed(keep, neighbours, closed)
    beside = neighbours[filled & ~keep]
    filled[beside[beside >= 0]] = True
    return filled


def object_alone(field: TetField, densities, box, ground: Plane | None) -> TetField:
    """What stands on the ground in the middle of a box, without the ground and what is beside it.

    Tets that are fog throughout go: photographs leave some in the air, and it joins things.
    Matter is counted in occupied sub-tets.  The largest connected part is the object; parts of
    less than 1 % go, and so do those at the box's sides, which go on outside of it.

    Args:
        densities: Of all sub-tets.  [T, 64]
        box: The object's, in model space.  [2, 3]
        ground: In model space; None if the object stands on nothing.
    """
    mesh, neighbours = field.mesh, field.neighbours
    edge = 0.25 * regular_edge(mesh)  # of a sub-tet
    matter = unpack_mask(field.occupancy)
    thick = matter & (densities * edge >= FOG)
    matter &= thick.any(axis=1)[:, None]
    is_ground = np.zeros(mesh.tet_count, bool)
    if ground is not None:
        places = subtet_middles(mesh)
        heights = ground.height(places)
        low = thick & (heights > -DEEP * edge) & (heights <= CLEARANCE * edge)
        matter &= heights > CLEARANCE * edge
        matter[matter] = carried(places[matter], thick[matter], ground, edge)
        above = matter & thick & (heights < LOW * edge)
        matter[low] = feet(field, places, low, above, ground, edge)
        is_ground = (heights < CLEARANCE * edge).all(axis=1) & ~matter.any(axis=1)
    occupied = matter.any(axis=1)
    if not occupied.any():
        return field
    labels = face_components(neighbours, occupied)
    sizes = np.bincount(labels[occupied], matter.sum(axis=1)[occupied])
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1)
    reach = 0.5 * regular_edge(mesh)
    sides = [0, 1] if ground is None else np.flatnonzero(abs(ground.normal) < 0.5)
    at_side = ((middles < box[0] + reach) | (middles > box[1] - reach))[:, sides].any(axis=1)
    touches = np.bincount(labels[occupied], at_side[occupied]) > 0
    stays = (sizes >= SMALLEST_PART * sizes.sum()) & ~touches
    stays[sizes.argmax()] = True
    occupied &= stays[labels]
    keep = solid(occupied, neighbours, closed_by(mesh, ground)) & ~is_ground
    matter &= occupied[:, None]
    return reduced(replace(field, occupancy=pack_mask(matter)), keep)


def without_spurs(field: TetField) -> TetField:
    """The field without long thin chains in which there is hardly anything.

    Stage 1 finds some fog far from an object.  Where it is joined to the object, `kept_mesh` has a
    chain of tets there.  It shows nothing, but it is a pendulum: it swings for seconds, and bends
    far under its weight.  A chain that joins two parts with matter stays, and so does what the
    object encloses, where nothing is occupied either.
    """
    mesh, neighbours = field.mesh, field.neighbours
    counts = unpack_mask(field.occupancy).sum(axis=1)
    near = np.zeros(mesh.vertex_count, bool)
    near[mesh.tets[counts > CORNER]] = True
    if not near.any():
        return field
    labels = face_components(neighbours, ~near[mesh.tets].any(axis=1))
    is_outside = (neighbours < 0).any(axis=1)
    reach_out = np.unique(labels[is_outside & (labels >= 0)])
    keep = np.ones(mesh.tet_count, bool)

    def with_matter(tets):
        """How many connected parts of these tets have matter, and the tets of these parts."""
        parts = face_components(neighbours, tets)
        full = np.unique(parts[tets & (counts > 0)])
        return len(full), np.isin(parts, full)

    for label in reach_out[np.bincount(labels[labels >= 0])[reach_out] >= SPUR]:
        part_count, rest = with_matter(keep & (labels != label))
        if part_count <= with_matter(keep)[0]:
            keep = rest
    return field if keep.all() else reduced(field, keep)


def carried(places, thick, ground: Plane, edge):
    """Whether sub-tets are more than a layer of the ground: high, or below thick ones.  [n] bool

    Args:
        places: Their middles.  [n, 3]
        thick: Which are more than fog, of which some hangs over the ground.  [n] bool
        edge: Their edges' length.
    """
    from scipy.spatial import cKDTree

    heights = ground.height(places)
    flat = places - heights[:, None] * ground.normal
    low = heights < LOW * edge
    above = thick & ~low & (heights < ABOVE * edge)
    stays = ~low
    if low.any() and above.any():
        distances = cKDTree(flat[above]).query(flat[low], distance_upper_bound=ASIDE * edge)[0]
        stays[low] = np.isfinite(distances)
    return stays


def feet(field: TetField, places, low, above, ground: Plane, edge) -> np.ndarray:
    """Which of the n sub-tets at the ground have the color of what stands there.  [n] bool

    Training learns the ground's surface about a sub-tet thick, and the end of a foot lies in it.

    Args:
        places: The middles of all sub-tets.  [T, 64, 3]
        low: Which n lie at the ground, and are more than fog.  [T, 64] bool
        above: Which lie just above, are the object's, and more than fog.  [T, 64] bool
        edge: The length of a sub-tet's edges.
    """
    from scipy.spatial import cKDTree

    def colors(mask, some):
        return subtet_colors(field, *(ids[some] for ids in np.nonzero(mask)))

    own, objects = places[low], places[above]
    is_foot = np.zeros(len(own), bool)
    if not len(own) or not len(objects):
        return is_foot
    flat, over = (p - ground.height(p)[:, None] * ground.normal for p in (own, objects))
    aside = cKDTree(over).query(flat)[0]
    under, beside = np.flatnonzero(aside < UNDER * edge), aside > BESIDE * edge
    if not len(under) or np.count_nonzero(beside) < GROUND:
        return is_foot
    count = min(FOOT, len(objects))
    near = cKDTree(objects).query(own[under], k=[*range(1, count + 1)])[1]
    around = cKDTree(own[beside]).query(own[under], k=GROUND)[1]
    of_object = colors(above, slice(None))[near].mean(axis=1)
    of_ground = colors(low, beside)[around].mean(axis=1)
    color = colors(low, under)
    away, other = (np.linalg.norm(color - c, axis=1) for c in (of_object, of_ground))
    is_foot[under] = (other > TELL) & (away < NEARER * other)
    return is_foot


def regular_edge(mesh: TetMesh) -> float:
    """The edge of a regular tet of the mesh's mean volume."""
    volume = signed_volumes(mesh.rest_vertices, mesh.tets).mean()
    return float(np.cbrt(6.0 * np.sqrt(2.0) * volume))
