"""One thing of a field alone: what a click and strokes mean, and what is cut off.

    this, not this   what the strokes say: sub-tets near their points are held on one side
    surroundings     flat parts that go on beyond the object, and what lies on them in a layer
    rest             matter that is neither; `near_minimum_cut` (cutting.py) parts it
    neck             the ties that a cut parts, over the root of the smaller side's matter

The rules have no lengths but the edge of a sub-tet, and no sizes but shares.

Shapes: N occupied sub-tets (of a large field children of tets, see subtet_graph.py), E pairs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..field import TetField
from ..reduction import nearer_to_matter, reduced
from .cutting import near_minimum_cut
from .subtet_graph import SubtetGraph, graph_of
from .surroundings import NONE, FlatPart, flat_parts_of, layer_on, what_goes

DRAWS = 3  # of points; flat parts are sought in each, which finds others of the hardly flat
LEAST = 0.02  # of all matter, that the smaller side of a neck has at least
ALIKE = 0.8  # of a flat part's shell: if another part's has as much of it, they are the same
STANDS = 0.1  # times its ties to a block: an object that leans there has more to what it stands on
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
    draws: list[list[FlatPart]]  # as several draws of points find them
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

    def cut(self, pulls, held, pairs=slice(None)) -> np.ndarray:
        """Which sub-tets are kept by a cut, as `near_minimum_cut`; pairs: those that are tied."""
        ties = self.matter.pairs[pairs], self.ties[pairs]
        return near_minimum_cut(pulls, *ties, held, self.matter.groups)


@dataclass(frozen=True)
class Isolated:
    """What strokes single out.

    Attributes:
        kept: Which sub-tets are the object's.  [N] bool
        left_out: The flat parts that were taken for surroundings.
    """

    kept: np.ndarray
    left_out: tuple[FlatPart, ...]


def isolation_of(field: TetField) -> Isolation:
    """What strokes need of a field; takes seconds."""
    return isolation_of_graph(graph_of(field), box_of(field))


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


def isolation_of_graph(matter: SubtetGraph, box: np.ndarray) -> Isolation:
    """The same of matter in a box [2, 3]."""
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
        [flat_parts_of(matter, box, seed) for seed in range(DRAWS)],
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
    place = np.concatenate([s.points for s in strokes if s.this]).mean(axis=0)
    named = [what_goes(draw, matter, strokes) for draw in scene.draws]
    follows_from = np.packbits(told > 0).tobytes(), place.tobytes(), named
    if scene.last.get("from") != follows_from:  # the same for each stroke "not this"
        first = at_narrowest_neck(scene, place, told > 0, named)
        scene.last.update({"from": follows_from, "kept": {(): first.kept}, "first": first})
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
    return Isolated(left & joined_to(matter, told > 0, left), scene.last["first"].left_out)


def without_flats(scene: Isolation) -> Isolated:
    """What is left without the flat parts that go on beyond the object, before any stroke.

    If most draws have such parts, the draw counts that is parted at the narrowest neck.  Otherwise
    nothing goes.
    """
    results = []
    for draw in scene.draws:
        left_out = tuple(part for part in draw if part.reason != NONE)
        kept = np.ones(len(scene.matter.tets), bool)
        for part in left_out:
            kept &= ~part.shell(scene.matter)
        results.append(Isolated(kept, left_out))
    most = 2 * sum(bool(result.left_out) for result in results) > len(results)
    results = [result for result in results if bool(result.left_out) == most]
    return min(results, key=lambda result: neck_of(scene, result.kept))


def at_narrowest_neck(scene: Isolation, place, ours, named) -> Isolated:
    """What strokes that say "this" single out from surroundings.

    Which flat parts are found that are hardly flat is chance.  A wrong one cuts the object, and
    leaves a wide neck.  So of several draws the one counts that is parted at the narrowest.

    A block that the object leans on doesn't reach the border.  If a side of it is cut off, all of
    it hangs on the object by a neck that is much narrower still, so the other flat parts of all
    draws are tried.  A head may hang on its body by such a neck, but it doesn't stand on what goes
    by itself.

    Args:
        place: The middle of these strokes.  [3]
        ours: What they hold.  [N] bool
        named: Of each draw, its parts that go, and those that may: see what_goes.
    """
    results, found = [], []
    for goes, _ in named:
        shells = [part.shell(scene.matter) for part in goes]
        if any(all_alike(shells, others) and all_alike(others, shells) for others in found):
            continue  # another draw has found nearly the same
        found.append(shells)
        kept = without_surroundings(scene, place, ours, goes)
        results.append(Isolated(kept, tuple(goes)))
    necks = [neck_of(scene, result.kept) for result in results]
    least = int(np.argmin(necks))
    first, neck = results[least], SURER * necks[least]
    if not np.isfinite(neck):
        return first
    best, tried = first, []
    for part in (part for _, may_go in named for part in may_go):
        shell = part.shell(scene.matter) & first.kept
        if all_alike([shell], tried):
            continue  # another draw has found it as well, or there is nothing of it
        tried.append(shell)
        kept, _ = parted_from(scene, place, ours, [part], first.kept)
        its_neck = neck_of(scene, kept)
        if its_neck < neck and (part.reason != NONE or stands_alone(scene, kept, first.kept)):
            best, neck = Isolated(kept, (*first.left_out, part)), its_neck
    return best


def all_alike(shells, others) -> bool:
    """Whether each of some shells [N] bool has nearly all its matter in common with another one."""
    return all(
        any((shell & other).sum() >= ALIKE * shell.sum() for other in others) for shell in shells
    )


def stands_alone(scene: Isolation, kept: np.ndarray, before: np.ndarray) -> bool:
    """Whether what is kept is tied to what had gone before, and not only to what goes now.

    [N] bool each; what is kept was kept before.
    """
    pairs, ties = scene.matter.pairs, scene.ties
    parted = kept[pairs].sum(axis=1) == 1
    inner = before[pairs].all(axis=1)
    return bool(ties[parted & ~inner].sum() > STANDS * ties[parted & inner].sum())


def neck_of(scene: Isolation, kept: np.ndarray) -> float:
    """How much what is kept is tied to the rest: the ties, over the root of the smaller side's
    matter, which of a shell has no scale.  Infinite if one side has hardly any matter.
    """
    weights = scene.weights
    one, other = scene.matter.pairs.T
    parted = kept[one] != kept[other]
    smaller = min(weights[kept].sum(), weights[~kept].sum())
    if smaller <= LEAST * weights.sum():
        return np.inf
    return float(scene.ties[parted].sum() / np.sqrt(smaller))


def parted_from(scene: Isolation, place, ours, parts, among):
    """What of some sub-tets [N] bool stays if flat parts go, and what lies on these in a layer.

    [N] bool each; place, ours: as in `at_narrowest_neck`.
    """
    matter, held = scene.matter, np.where(among, np.where(ours, 1, 0), -1)
    layers = np.zeros(len(held), bool)
    for part in parts:
        held[part.shell(matter) & ~ours] = -1
        layers |= layer_on(part.flat, matter, part.over, place)
    kept = scene.cut(np.where(layers, -LAYER, BY_DEFAULT) * scene.weights, held)
    return kept & joined_to(matter, ours, kept), layers


def without_surroundings(scene: Isolation, place, ours, goes) -> np.ndarray:
    """What stays if flat parts go, and what is joined to the border rather than to strokes that say
    "this".  [N] bool
    """
    matter = scene.matter
    kept, layers = parted_from(scene, place, ours, goes, np.ones(len(ours), bool))
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
        alone = scene.cut(pulls * scene.weights, held)
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
        taken = kept & ~scene.cut(pulls, held, inner)
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


def joined_to(matter: SubtetGraph, to: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Which of some sub-tets [N] bool are joined, at corners or more, to some of others.  [N]"""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    ids = np.flatnonzero(among)
    if not len(ids):
        return among
    count = len(ids)
    columns = (matter.nodes[ids] + count).ravel().astype(np.int32)  # SciPy's own types
    size = int(columns.max()) + 1
    starts = np.minimum(4 * np.arange(size + 1, dtype=np.int32), 4 * count)
    graph = csr_array((np.ones(4 * count), columns, starts), shape=(size, size))
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
    a, b = matter.pairs.T
    open_ = among[a] & among[b]
    graph = csr_array((ways[open_], (a[open_], b[open_])), shape=(count, count))
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
    if count := sum(part.reason != NONE for part in result.left_out):
        parts = "a flat part that goes" if count == 1 else f"{count} flat parts that go"
        text += f", with {parts} on beyond the object"
    return text
