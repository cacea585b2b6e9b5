"""Which flat parts are surroundings, and which matter goes with them.

A flat part goes on beyond the object if it reaches the border of the mesh's box along at least
half of its own width: a floor, a wall.  What stands on such a part along at least half of its own
width, as the sides of a furniture do, may go on as well.  Both need to be told from the sides of an
object that is a box itself.  A part that strokes call "this" is the object's, and so are parts
that end where it ends, at an edge of both.  What reaches the border goes; other parts go if a cut
shows that only little hangs together there (isolating.py).

Matter goes with a part if it is in its shell.  What lies on it in a low layer, with nothing higher
above, may go.

Shapes: N occupied sub-tets, n points, F flat parts.
"""

from dataclasses import dataclass

import numpy as np

from .flats import FOG, Flat, flats_of
from .subtet_graph import SubtetGraph

WIDE = 0.5  # of a part's width, along which it reaches the border or stands on another
ENDS = 0.15  # of a part's area that may lie behind an edge at which it ends
CLEAR = 1.5  # of what is on a plane, to its front [edges]
LOW, ABOVE, ASIDE = 3.0, 6.0, 1.5  # of a layer; where something carries it; beside it [edges]
NONE, BORDER, STANDING = 0, 1, 2  # why a part goes on


@dataclass(frozen=True, eq=False)
class FlatPart:
    """A flat part and what it has to do with the rest.

    Attributes:
        over: What lies over or under its hull.  [N] bool
        reason: Why it goes on beyond the object, or NONE.
    """

    flat: Flat
    over: np.ndarray
    reason: int

    def shell(self, matter: SubtetGraph) -> np.ndarray:
        """Which matter is in its shell.  [N] bool"""
        heights = self.flat.plane.height(matter.middles)
        return self.over & (abs(heights) < CLEAR * matter.edge)


def flat_parts_of(matter: SubtetGraph, box: np.ndarray, seed: int) -> list[FlatPart]:
    """Those of matter in a box [2, 3]; seed: of `flats_of`."""
    flats = flats_of(matter, seed)
    return [
        FlatPart(flat, in_hull(flat, matter.middles), int(reason))
        for flat, reason in zip(flats, goes_on(flats, box), strict=True)
    ]


def what_goes(parts: list[FlatPart], matter: SubtetGraph, strokes):
    """The parts that go, since they reach the border or a stroke says so, and those that may."""
    ours, others = set(), set()
    for stroke in strokes:
        on_it = {p for p in parts if on_flat(p.flat, matter, stroke.points).mean() > 0.5}
        (ours if stroke.this else others).update(on_it)
    while True:  # sides of a box
        more = {
            part
            for part in set(parts) - ours - others
            if part.reason != BORDER and any(share_an_edge(part.flat, k.flat) for k in ours)
        }
        if not more:
            break
        ours |= more
    goes = [p for p in parts if p not in ours and (p in others or p.reason == BORDER)]
    return goes, [p for p in parts if p not in ours and p not in goes]


def goes_on(flats: list[Flat], box: np.ndarray) -> np.ndarray:
    """Why each part goes on beyond what is in the middle of a box [2, 3], or NONE.  [F] int"""
    reasons = np.zeros(len(flats), int)
    for number, flat in enumerate(flats):
        places = flat.corners()
        reach = 1.5 * flat.cell
        at_border = ((places < box[0] + reach) | (places > box[1] - reach)).any(axis=1)
        reasons[number] = BORDER if is_wide(flat, at_border) else NONE
    while True:
        more = [
            number
            for number in np.flatnonzero(reasons == NONE)
            if any(stands_on(flats[number], flats[k]) for k in np.flatnonzero(reasons))
        ]
        if not more:
            return reasons
        reasons[more] = STANDING


def is_wide(flat: Flat, cells: np.ndarray) -> bool:
    """Whether some of a part's cells [cells] bool, in a row or two, reach over half its width."""
    places = flat.corners()[cells] @ flat.axes.T
    if len(places) < 3:
        return False
    spread = np.linalg.eigvalsh(np.cov(places.T))[1]  # of a line of length l: l² / 12
    return np.sqrt(12.0 * max(spread, 0.0)) >= WIDE * np.sqrt(flat.area)


def stands_on(flat: Flat, ground: Flat) -> bool:
    """Whether a part's rim lies on another one, along half of the part's width."""
    heights = ground.plane.height(flat.corners())
    near = abs(heights) < 1.5 * max(flat.cell, ground.cell)
    if abs(flat.plane.normal @ ground.plane.normal) > 0.9 or near.mean() > 0.7:
        return False
    return ends_at(flat, ground) and is_wide(flat, near & near_hull(ground, flat.corners()))


def ends_at(flat: Flat, other: Flat) -> bool:
    """Whether hardly anything of a part lies on one of the sides of another's plane."""
    heights = other.plane.height(flat.corners())
    clear = 1.5 * max(flat.cell, other.cell)
    low, high = (heights < -clear).mean(), (heights > clear).mean()
    return min(low, high) < ENDS


def share_an_edge(flat: Flat, other: Flat) -> bool:
    """Whether two parts meet and both end there, as two sides of a box do."""
    if not (ends_at(flat, other) and ends_at(other, flat)):
        return False
    near = abs(other.plane.height(flat.corners())) < 1.5 * max(flat.cell, other.cell)
    return is_wide(flat, near & near_hull(other, flat.corners()))


def near_hull(flat: Flat, points: np.ndarray) -> np.ndarray:
    """Whether points [n, 3] lie over or under a part, or one and a half cells beside it.  [n]"""
    return in_hull(flat, points, 1.5 * flat.cell)


def in_hull(flat: Flat, points: np.ndarray, slack: float = 0.0) -> np.ndarray:
    """Whether points [n, 3] lie over or under the convex hull of a part, where the object hides
    the part, too; or not farther beside it than `slack`.  [n] bool
    """
    from scipy.spatial import ConvexHull, QhullError

    own = flat.corners() @ flat.axes.T
    try:
        equations = ConvexHull(own).equations  # [m, 3]: a x + b y + c <= 0 inside
    except (QhullError, ValueError):
        return flat.covers(points)
    places = points @ flat.axes.T
    return (places @ equations[:, :2].T + equations[:, 2] < slack + 0.5 * flat.cell).all(axis=1)


def on_flat(flat: Flat, matter: SubtetGraph, points: np.ndarray) -> np.ndarray:
    """Whether points [n, 3] lie on a part itself.  [n] bool"""
    return (abs(flat.plane.height(points)) < CLEAR * matter.edge) & flat.covers(points)


def layer_on(flat: Flat, matter: SubtetGraph, over: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Which matter lies on the part in a low layer.  [N] bool

    Args:
        over: What lies over or under the part's hull.  [N] bool
        place: A point of the object, which says which side of the part is its front.  [3]
    """
    from scipy.spatial import cKDTree

    plane = flat.plane if flat.plane.height(place) > 0.0 else flat.plane.turned()
    heights = plane.height(matter.middles) / matter.edge
    low = over & (heights >= CLEAR) & (heights < LOW)
    thick = matter.depths >= FOG
    above = thick & (heights >= LOW) & (heights < ABOVE)
    if low.any() and above.any():
        across, higher = (matter.middles[some] @ flat.axes.T / matter.edge for some in (low, above))
        first, last = across.min(axis=0) - ASIDE, across.max(axis=0) + ASIDE
        higher = higher[((higher >= first) & (higher <= last)).all(axis=1)]
        tree = cKDTree(higher, balanced_tree=False, compact_nodes=False)
        low[low] = ~np.isfinite(tree.query(across, distance_upper_bound=ASIDE)[0])
    return low
