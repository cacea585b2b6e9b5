"""Find photographs whose camera stood still while the object turned, as on a turntable.

What stands still shows itself: features of two photographs lie at the same pixels and look the
same.  A hand moves between photographs, so all but a few features of any two move as well.  A ring
is a group of photographs that a camera took from one place.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations

import numpy as np

from ...core.base.device import thread_count
from ...core.training import shrunk_size
from .features import LEAST_MATCHES, object_mask
from .library import SEED, Threads
from .work import Work, number_of

SAME_PLACE = 1.0  # pixels of the work size
ALIKE = 0.9  # cosine between the descriptors of two features that look the same
RATIO = 0.8  # of the angles to the nearest and to the next descriptor, as in pycolmap
STILL = 0.1  # of the features of one of two photographs: then the camera stood still
RING = 6  # photographs
SEEDS = 12  # photographs that all are compared with in vain before no ring is sought any more
KEPT = 400  # photographs whose features are kept meanwhile: some 300 MB at most
CELLS, OCCUPIED = 8, 6  # of a grid over the image, along a side; how many hold what stands still


@dataclass(frozen=True)
class Still:
    """What stands still behind two rings.

    Attributes:
        rings: Which two.  [m, 2] int
        pixels: Where it is, in each.  [m, 2, 2]
        scales: Of these features [pixels].  [m, 2]
    """

    rings: np.ndarray
    pixels: np.ndarray
    scales: np.ndarray


def find_rings(work: Work, begin) -> list[tuple[int, ...]]:
    """Photographs, by number, of each ring of at least RING; the first photograph's ring first.

    Args:
        begin: Phases.phase.
    """
    with (
        work.database() as database,
        begin("Looking for a turntable", 1) as advance,
        Threads(thread_count()) as pool,
    ):
        keys = {number_of(image.name): image.image_id for image in database.read_all_images()}
        features = lru_cache(KEPT)(lambda number: features_of(database, keys[number]))
        left, rings, vain = sorted(keys), [], 0
        for seed in np.random.default_rng(SEED).permutation(left).tolist():
            if vain == SEEDS:
                break
            if seed not in left:
                continue
            stood = pool.map(partial(stood_still, features(seed)), map(features, left))
            ring = [n for n, still in zip(left, stood, strict=True) if n == seed or still]
            if len(ring) < RING:
                vain += 1
                continue
            vain = 0
            rings.append(tuple(ring))
            left = [n for n in left if n not in ring]
        advance(1)
    return sorted(rings)


def features_of(database, key: int):
    """Of a photograph: places [m, 2], a tree of them, descriptors [m, 128], scales [m]."""
    from scipy.spatial import cKDTree

    found = database.read_keypoints(key)
    places = found[:, :2].astype(np.float64)
    described = np.asarray(database.read_descriptors(key).data)
    count = min(len(places), len(described))
    return places[:count], cKDTree(places[:count]), described[:count], scales_of(found)[:count]


def find_still(work: Work, rings) -> Still:
    """Features of the background that two rings share.

    Args:
        work: With the features of whole photographs, and mattes or the user's masks.
    """
    with work.database() as database:
        keys = {number_of(image.name): image.image_id for image in database.read_all_images()}
        seen = []
        for ring in rings:
            one, other = ring[len(ring) // 2], ring[len(ring) // 2 - 1]
            features = features_of(database, keys[one])
            seen.append(
                background_features(work, one, features, features_of(database, keys[other]))
            )
    shared, pixels, scales = [np.zeros((0, 2), int)], [np.zeros((0, 2, 2))], [np.zeros((0, 2))]
    for pair in combinations(range(len(rings)), 2):
        (one, sizes, a), (other, others, b) = (seen[r] for r in pair)
        rows, columns = shared_features(a, b)
        shared.append(np.tile(pair, (len(rows), 1)))
        pixels.append(np.stack([one[rows], other[columns]], axis=1))
        scales.append(np.stack([sizes[rows], others[columns]], axis=1))
    return Still(*map(np.concatenate, (shared, pixels, scales)))


def background_features(work: Work, number: int, features, others):
    """Places, scales and descriptors of features that another photograph of the ring has there."""
    places, _, described, scales = features
    size = shrunk_size(work.photos[number].size, work.image_size)
    mask = object_mask(work, number, size)
    columns, rows = places.astype(int).T
    outside = mask[np.clip(rows, 0, len(mask) - 1), np.clip(columns, 0, len(mask[0]) - 1)] == 0
    chosen = np.intersect1d(np.flatnonzero(outside), still_features(features, others))
    return places[chosen], scales[chosen], unit(described[chosen])


def shared_features(a, b):
    """The numbers of descriptors that are each other's nearest, and nearer than any other.

    Args:
        a, b: Unit vectors.  [n, 128], [m, 128]
    """
    if min(len(a), len(b)) < 2:
        return np.zeros((2, 0), int)
    cosines = a @ b.T
    best, back = cosines.argmax(axis=1), cosines.argmax(axis=0)
    rows = np.arange(len(a))
    second = np.partition(cosines, -2, axis=1)[:, -2]
    near, far = (np.arccos(np.clip(c, -1.0, 1.0)) for c in (cosines[rows, best], second))
    rows = rows[(back[best] == rows) & (near < RATIO * far)]
    return rows, best[rows]


def unit(described):
    described = described.astype(np.float32)
    return described / (np.linalg.norm(described, axis=1, keepdims=True) + 1e-9)


def still_features(one, other):
    """The numbers of a photograph's features that another has at the same place."""
    distances, nearest = other[1].query(one[0], distance_upper_bound=SAME_PLACE)
    found = np.flatnonzero(np.isfinite(distances))
    cosines = (unit(one[2][found]) * unit(other[2][nearest[found]])).sum(axis=1)
    return found[cosines > ALIKE]


def scales_of(features):
    """Scales of pycolmap's features, whose last columns are a matrix.  [m, 6] -> [m] pixels"""
    a, b, c, d = features[:, 2:6].astype(np.float64).T
    return np.sqrt(abs(a * d - b * c))


def stood_still(one, other) -> bool:
    """Whether so many features of two photographs are at the same places, all over the image."""
    fewer = min(len(one[0]), len(other[0]))
    if fewer < LEAST_MATCHES:
        return False
    still = one[0][still_features(one, other)]
    if len(still) < max(LEAST_MATCHES, STILL * fewer):
        return False
    # A name or a time that a camera writes into each photograph stands still as well.
    extent = np.maximum(one[0].max(axis=0), other[0].max(axis=0)) + 1.0
    return len(np.unique((still * CELLS / extent).astype(int), axis=0)) >= OCCUPIED
