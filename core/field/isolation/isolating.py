"""One thing of a field alone: what a click and strokes mean, and what is cut off.

    this, not this   what the strokes say: sub-tets near their points are held on one side
    surroundings     flat parts that go on beyond the object, and what lies on them in a layer
    rest             matter that is neither; `minimum_cut` (cutting.py) parts it

The rules have no lengths but the edge of a sub-tet, and no sizes but shares.

Shapes: N occupied sub-tets (of a large field children of tets, see subtet_graph.py), E pairs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..field import TetField
from ..reduction import nearer_to_matter, reduced
from .cutting import minimum_cut
from .flats import Flat, flats_of
from .subtet_graph import SubtetGraph, graph_of
from .surroundings import BORDER, NONE, goes_on, in_hull, layer_on, on_flat, share_an_edge, shell_of

SEED = 0.75  # around a stroke's points, that is held [edges]
MISSED = 4.0  # edges from a point to matter; farther, the point names nothing
BORDER_LAYER, SOLID = 2.0, 0.1  # of a box's border [edges]; opacity there that counts
# Of the next layer's matter, that the outermost one has of what goes on; a solid cap has a third.
GOES_ON = 0.4
# What a sub-tet of opacity 1 pulls, over what it costs to part two through a mean face: by default
# to "this"; where it lies on surroundings in a layer, or is nearer to "not this", to that; where it
# has the colors of what else is there, or is OUTER times as near to the border, to that.
BY_DEFAULT, LAYER, NEAR = 0.02, 0.2, 0.1
COLOR, BORDER_NEAR, OUTER = 0.1, 0.05, 3.0
LOOKS_LIKE, TOLD = 2, 0.1  # times, that colors are counted; what they have to tell in the mean
# Cubes along red; blur [cubes]; a color without more is not counted; a ratio that is sure
CUBES, BLUR, SELDOM, SURE_OF_COLOR = 16, 0.8, 1e-4, np.e**2
FARTHER = 6.0  # times, it is between sub-tets of unlike colors than between those of one color
FARTHEST, REACHES, SURER = 1e6, 4, 0.4
UNLIKE = 0.05  # of a tie, that is left between such


@dataclass(frozen=True)
class Stroke:
    """Points of a stroke on the surface, at rest."""

    points: np.ndarray  # [n, 3]
    this: bool  # else "not this"
    radius: float = 0.0  # that it reaches to each side [model units]; at least an edge


@dataclass(frozen=True)
class Isolation:
    """What strokes need of a field, made once."""

    matter: SubtetGraph
    box: np.ndarray  # [2, 3], see `box_of`
    flats: list[Flat]
    over: list[np.ndarray]  # F x [N] bool: what lies over or under the hull of each
    reasons: np.ndarray  # [F] int, why they go on: see surroundings.py
    border: np.ndarray  # [N] bool: solid, and at the border of the box: it goes on outside
    opacity: np.ndarray  # [N] of a sub-tet, 0..1
    ties: np.ndarray  # [E] what it costs to part pairs
    lengths: np.ndarray  # [E] how far it is between them, farther through fog [edges]
    ways: np.ndarray  # [E] the same, and farther between unlike colors
    last: dict = field(default_factory=dict)  # what the last strokes came to, one by one

    @cached_property
    def weights(self) -> np.ndarray:
        """How much matter there is, over that of an opaque sub-tet.  [N]"""
        return self.opacity * self.matter.volumes / self.matter.volumes.mean()


@dataclass(frozen=True)
class Isolated:
    """What strokes single out.

    Attributes:
        kept: Which sub-tets are the object's.  [N] bool
        left_out: The flat parts that were taken for surroundings, as indices of Isolation.flats.
    """

    kept: np.ndarray
    left_out: tuple[int, ...]


def isolation_of(field: TetField) -> Isolation:
    """What strokes need of a field; takes seconds."""
    return isolation_of_graph(graph_of(field), box_of(field))


def isolations_of(field: TetField, count: int) -> list[Isolation]:
    """The same `count` times, with the flat parts of another seed each."""
    matter, box = graph_of(field), box_of(field)
    return [isolation_of_graph(matter, box, seed) for seed in range(count)]


def box_of(field: TetField) -> np.ndarray:
    """The box at whose sides what was photographed goes on.  [2, 3]

    The mesh ends at the sides of the unit cube, because training had no tets outside of it.  If it
    found the object's box, there is no matter outside of that but the ground's, which is known:
    nothing goes on at that side.  Where the mesh ends elsewhere nothing does, either: the side is
    infinitely far.
    """
    vertices = field.mesh.rest_vertices
    ends = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    if field.meta.get("object_box") is None:
        sides, border = np.array([[0.0] * 3, [1.0] * 3]), ends
    else:
        sides = np.array(field.meta["object_box"], float)
        border = sides.copy()
        if field.meta.get("object_stands"):
            border[0, 2] = -np.inf
        else:
            border[1, 1] = np.inf
    at_side = (ends - sides) * [[-1.0], [1.0]] > -1e-6
    return np.where(at_side, border, [[-np.inf], [np.inf]])


def at_border(matter: SubtetGraph, opacity: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Which sub-tets are at the border of a box [2, 3], of things that go on outside.  [N] bool

    Of such a thing there is about as much in the outermost layer as in the next one; what only
    touches the border, as the top of a head, has less there.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    depth = np.minimum(matter.middles - box[0], box[1] - matter.middles).min(axis=1)
    layer = BORDER_LAYER * matter.edge
    band = np.flatnonzero((depth < 2.0 * layer) & (opacity > SOLID))
    if not len(band):
        return np.zeros(len(depth), bool)
    numbers = np.full(len(depth), -1)
    numbers[band] = np.arange(len(band))
    pairs = numbers[matter.pairs]
    a, b = pairs[(pairs >= 0).all(axis=1)].T
    graph = csr_array((np.ones(len(a), np.int8), (a, b)), shape=(len(band),) * 2)
    labels = connected_components(graph, directed=False)[1]
    weights, is_outer = (opacity * matter.volumes)[band], depth[band] < layer
    outer, inner = (np.bincount(labels, weights * some) for some in (is_outer, ~is_outer))
    border = np.zeros(len(depth), bool)
    border[band] = is_outer & (outer >= GOES_ON * inner)[labels]
    return border


def isolation_of_graph(matter: SubtetGraph, box: np.ndarray, seed: int = 0) -> Isolation:
    """The same of matter in a box [2, 3]; `seed` is that of flats_of."""
    flats = flats_of(matter, seed)
    opacity = 1.0 - np.exp(-matter.depths)
    a, b = matter.pairs.T
    away = ((matter.colors[a] - matter.colors[b]) ** 2).sum(axis=1)
    solid = np.minimum(opacity[a], opacity[b])
    mean = float((solid * away).sum() / max(solid.sum(), 1e-30))
    likeness = np.exp(-away / (2.0 * mean)) if mean > 1e-12 else np.ones(len(away))
    lengths = np.linalg.norm(matter.middles[a] - matter.middles[b], axis=1) / matter.edge
    lengths /= np.maximum(solid, SOLID)
    return Isolation(
        matter,
        box,
        flats,
        [in_hull(flat, matter.middles) for flat in flats],
        goes_on(flats, box),
        at_border(matter, opacity, box),
        opacity,
        matter.areas * solid * (UNLIKE + likeness),
        lengths,
        lengths * (1.0 + FARTHER * (1.0 - likeness)),
    )


def isolated(scene: Isolation, strokes: Sequence[Stroke]) -> Isolated:
    """What strokes single out; at least one says "this".

    Raises:
        ValueError: No stroke says "this", or one lies far from all matter.
    """
    check(scene.matter, strokes)
    matter = scene.matter
    near = [ids_near(matter, stroke) for stroke in strokes]
    told = np.zeros(len(matter.tets), int)  # the last stroke counts
    for stroke, ids in zip(strokes, near, strict=True):
        told[ids] = 1 if stroke.this else -1
    left_out = surroundings_of(scene, strokes)
    place = np.concatenate([s.points for s in strokes if s.this]).mean(axis=0)
    follows_from = np.packbits(told > 0).tobytes(), place.tobytes(), tuple(left_out)
    if scene.last.get("from") != follows_from:  # the same for each stroke "not this"
        scene.last["kept"] = {(): without_surroundings(scene, place, told > 0, left_out)}
        scene.last["from"] = follows_from
    kept, done, held = scene.last["kept"], (), np.maximum(told, 0)
    for stroke, ids in zip(strokes, near, strict=True):
        if stroke.this:
            continue
        held[ids[told[ids] < 0]] = -1
        points = np.asarray(stroke.points, float)
        before, done = done, (*done, (points.tobytes(), stroke.radius))
        if done not in kept:  # what earlier strokes took away is known
            kept[done] = kept[before] & ~piece_at(scene, stroke, ids, kept[before], held)
    left = kept[done] & (told >= 0)
    return Isolated(left & joined_to(matter, told > 0, left), tuple(left_out))


def without_flats(scene: Isolation) -> Isolated:
    """What is left without the flat parts that go on beyond the object, before any stroke."""
    left_out = surroundings_of(scene, ())
    kept = np.ones(len(scene.matter.tets), bool)
    for number in left_out:
        kept &= ~shell_of(scene.flats[number], scene.matter, scene.over[number])
    return Isolated(kept, tuple(left_out))


def without_surroundings(scene: Isolation, place, ours, left_out) -> np.ndarray:
    """What strokes that say "this" single out from surroundings.  [N] bool

    Args:
        place: The middle of these strokes.  [3]
        ours: What they hold.  [N] bool
        left_out: Flat parts that are surroundings.
    """
    matter, held = scene.matter, np.where(ours, 1, 0)
    layers = np.zeros(len(held), bool)
    for number in left_out:
        flat, over = scene.flats[number], scene.over[number]
        held[shell_of(flat, matter, over) & ~ours] = -1
        layers |= layer_on(flat, matter, over, place)
    held[(held == 0) & ~joined_to(matter, held > 0, held >= 0)] = -1
    evidence = np.where(layers, -LAYER, BY_DEFAULT)
    kept = minimum_cut(evidence * scene.weights, matter.pairs, scene.ties, held)
    outside = scene.border & ~ours & kept
    if not outside.any():
        return kept
    one = distances(scene, scene.lengths, np.flatnonzero(ours), kept)
    other = distances(scene, scene.lengths, np.flatnonzero(outside), kept)
    held = np.where(kept, np.where(ours, 1, 0), -1)
    alone = kept & (OUTER * other > one)
    for _ in range(LOOKS_LIKE):
        like = likeness_to(scene, alone)
        # Where colors don't tell them apart, what is nearer to the border goes.
        told = float((abs(like) * scene.weights)[kept].sum() / scene.weights[kept].sum())
        near = nearness(one, (OUTER if told > TOLD else 1.0) * other)
        pulls = np.where(layers, -LAYER, BY_DEFAULT + COLOR * like + BORDER_NEAR * near)
        alone = minimum_cut(pulls * scene.weights, matter.pairs, scene.ties, held)
        alone &= joined_to(matter, ours, alone)
    return alone


def likeness_to(scene: Isolation, one) -> np.ndarray:
    """-1..1: whose colors solid matter has, those of some of it, or those of the rest.  [N]

    By how often a color is seen in either, which is counted in cubes of colors.

    Args:
        one: Which are some.  [N] bool
    """
    from scipy.ndimage import gaussian_filter

    cubes = np.clip((scene.matter.colors * CUBES).astype(int), 0, CUBES - 1)
    index = np.ravel_multi_index(cubes.T, (CUBES,) * 3)
    solid = scene.opacity > SOLID
    shares = []
    for some in (solid & one, solid & ~one):
        counts = np.bincount(index[some], scene.weights[some], CUBES**3).reshape((CUBES,) * 3)
        smooth = gaussian_filter(counts, BLUR).ravel()
        shares.append(smooth / max(smooth.sum(), 1e-30) + SELDOM)
    ratio = np.log(shares[0] / shares[1]) / np.log(SURE_OF_COLOR)
    return np.clip(ratio, -1.0, 1.0)[index]


def piece_at(scene: Isolation, stroke, ids, kept, told) -> np.ndarray:
    """What a "not this" stroke takes away of what is kept.  [N] bool

    It is cut off within several distances from the stroke, and judged by its border over the
    root of its matter, which of a shell has no scale.  A larger piece is taken only if that is
    much less: a crumb goes at its own border, an arm at the shoulder.

    Args:
        ids: Sub-tets at the stroke.
        kept: What is left so far.  [N] bool
        told: 1 where a stroke says "this", -1 where one says "not this", so far.  [N] int
    """
    matter, own = scene.matter, ids[kept[ids]]
    if not len(own):
        return np.zeros(len(kept), bool)
    one = distances(scene, scene.ways, np.flatnonzero(told > 0), told >= 0)
    length = (np.linalg.norm(np.ptp(stroke.points, axis=0)) + 2.0 * stroke.radius) / matter.edge
    other = distances(scene, scene.ways, own, kept)
    open_ = kept & (told <= 0)
    weights = scene.weights
    shortest = max(length, 2.0 * SEED)
    like = likeness_to(scene, kept & (other > shortest))
    pulls = (NEAR * nearness(one, other) + COLOR * like) * weights
    best, best_quotient, before = np.zeros(len(kept), bool), np.inf, 0
    best[own] = True
    for reach in (*(shortest * 2.0 ** np.arange(REACHES)), np.inf):
        free = open_ & (other <= reach)
        if np.count_nonzero(free) == before:
            continue
        before = np.count_nonzero(free)
        held = np.where(free, 0, np.where(kept, 1, -1))
        held[own] = -1
        inner = kept[matter.pairs].all(axis=1)
        taken = kept & ~minimum_cut(pulls, matter.pairs[inner], scene.ties[inner], held)
        parted = taken[matter.pairs[inner]].sum(axis=1) == 1
        cost = scene.ties[inner][parted].sum()
        cost += COLOR * (np.maximum(like, 0.0) * weights)[taken].sum()
        quotient = cost / np.sqrt(weights[taken].sum())
        if quotient < SURER * best_quotient:
            best, best_quotient = taken, quotient
    return best


def check(matter: SubtetGraph, strokes: Sequence[Stroke]) -> None:
    """Raise a ValueError if strokes can't be used, as `isolated` says."""
    if not any(stroke.this for stroke in strokes):
        raise ValueError("no stroke says what the object is: give one")
    for stroke in strokes:
        for point in np.asarray(stroke.points, float)[:1]:
            away = float(matter.tree.query(point)[0])
            if not away <= max(MISSED * matter.edge, stroke.radius):
                where = " ".join(f"{v:g}" for v in point)
                raise ValueError(f"there is no matter at {where}: the nearest is {away:.3g} away")


def ids_near(matter: SubtetGraph, stroke: Stroke) -> np.ndarray:
    """The sub-tets at a stroke's points, ids."""
    tree, points = matter.tree, np.asarray(stroke.points, float)
    around = tree.query_ball_point(points, max(stroke.radius, SEED * matter.edge))
    return np.unique(np.concatenate([*map(np.int64, around), tree.query(points)[1]]))


def surroundings_of(scene: Isolation, strokes) -> list[int]:
    """The flat parts that are surroundings, by themselves or because a stroke says so."""
    flats, matter = scene.flats, scene.matter
    ours, others = set(), set()
    for stroke in strokes:
        for number, flat in enumerate(flats):
            if on_flat(flat, matter, stroke.points).mean() > 0.5:
                (ours if stroke.this else others).add(number)
    while True:  # sides of a box
        more = {
            number
            for number, flat in enumerate(flats)
            if number not in ours | others
            and scene.reasons[number] != BORDER
            and any(share_an_edge(flat, flats[k]) for k in ours)
        }
        if not more:
            break
        ours |= more
    found = set(np.flatnonzero(scene.reasons != NONE).tolist())
    return sorted((found | others) - ours)


def joined_to(matter: SubtetGraph, to: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Which of some sub-tets [N] bool are joined, at corners or more, to some of others.  [N]"""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    ids = np.flatnonzero(among)
    if not len(ids):
        return among
    count = len(ids)
    columns = (matter.nodes[ids] + count).ravel()
    size = int(columns.max()) + 1
    starts = np.minimum(4 * np.arange(size + 1), 4 * count)
    graph = csr_array((np.ones(4 * count, np.int8), columns, starts), shape=(size, size))
    labels = connected_components(graph, directed=False)[1][:count]
    joined = np.zeros(len(among), bool)
    joined[ids] = np.isin(labels, np.unique(labels[to[ids]]))
    return joined


def distances(scene: Isolation, ways, sources: np.ndarray, among: np.ndarray) -> np.ndarray:
    """The shortest ways from sources (ids) through some sub-tets [N] bool [edges].  [N]

    Args:
        ways: Between pairs: Isolation.lengths or .ways.  [E]
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    matter, count = scene.matter, len(scene.matter.tets)
    open_ = among[matter.pairs].all(axis=1)
    a, b = matter.pairs[open_].T
    graph = csr_array((ways[open_], (a, b)), shape=(count, count))
    found = dijkstra(graph, directed=False, indices=sources, min_only=True)
    return np.minimum(found, FARTHEST)


def nearness(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """-1..1: how much nearer "this" is than "not this", by their distances [N].  [N]"""
    return (other - one) / (other + one + 1.0)


def kept_field(field: TetField, scene: Isolation, result: Isolated) -> TetField:
    """The field of what is kept."""
    occupancy = field.occupancy & scene.matter.masks(result.kept)
    had, has = field.occupancy != 0, occupancy != 0
    keep = nearer_to_matter(field.neighbours, has, had & ~has)
    return reduced(replace(field, occupancy=occupancy), keep)


def left_out_in_words(scene: Isolation, result: Isolated, where=True) -> str:
    """What was left out, how much and, if asked for, where: the middle of a sentence."""
    matter, gone = scene.matter, ~result.kept
    weights = scene.opacity * matter.volumes
    share = float(weights[gone].sum() / max(weights.sum(), 1e-30))
    text = f"{share:.0%} of the matter"
    solid = gone & (scene.opacity > SOLID)
    if where and solid.any():
        low, high = np.percentile(matter.middles[solid], [1, 99], axis=0)
        text += " (in the box " + " ".join(f"{v:.3g}" for v in (*low, *high)) + ")"
    if count := len(result.left_out):
        parts = "a flat part that goes" if count == 1 else f"{count} flat parts that go"
        text += f", with {parts} on beyond the object"
    return text
