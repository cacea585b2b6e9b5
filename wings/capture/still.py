"""Find photographs whose camera stood still while the object turned, as on a turntable.

What stands still shows itself: features of two photographs lie at the same pixels and look the
same.  A hand moves between photographs, so all but a few features of any two move as well.  A ring
is a group of photographs that a camera took from one place.
"""

from functools import lru_cache

import numpy as np

from .features import LEAST_MATCHES
from .library import SEED
from .work import Work, number_of

SAME_PLACE = 1.0  # pixels of the work size
ALIKE = 0.9  # cosine between the descriptors of two features that look the same
STILL = 0.1  # of the features of one of two photographs: then the camera stood still
RING = 6  # photographs
SEEDS = 12  # photographs that all are compared with in vain before no ring is sought any more
KEPT = 400  # photographs whose features are kept meanwhile: some 300 MB at most
CELLS, OCCUPIED = 8, 6  # of a grid over the image, along a side; how many hold what stands still


def find_rings(work: Work, begin) -> list[tuple[int, ...]]:
    """Photographs, by number, of each ring of at least RING; the first photograph's ring first.

    Args:
        begin: Phases.phase.
    """
    with work.database() as database, begin("Looking for a turntable", 1) as advance:
        keys = {number_of(image.name): image.image_id for image in database.read_all_images()}
        features = lru_cache(KEPT)(lambda number: features_of(database, keys[number]))
        left, rings, vain = sorted(keys), [], 0
        for seed in np.random.default_rng(SEED).permutation(left).tolist():
            if vain == SEEDS:
                break
            if seed not in left:
                continue
            one = features(seed)
            ring = [n for n in left if n == seed or stood_still(one, features(n))]
            if len(ring) < RING:
                vain += 1
                continue
            vain = 0
            rings.append(tuple(ring))
            left = [n for n in left if n not in ring]
        advance(1)
    return sorted(rings)


def features_of(database, key: int):
    """Places in the image [m, 2], a tree of them, and descriptors [m, 128] of a photograph."""
    from scipy.spatial import cKDTree

    places = database.read_keypoints(key)[:, :2].astype(np.float64)
    described = np.asarray(database.read_descriptors(key).data)
    count = min(len(places), len(described))
    return places[:count], cKDTree(places[:count]), described[:count]


def stood_still(one, other) -> bool:
    """Whether so many features of two photographs are at the same places, all over the image."""
    fewer = min(len(one[0]), len(other[0]))
    if fewer < LEAST_MATCHES:
        return False
    distances, nearest = other[1].query(one[0], distance_upper_bound=SAME_PLACE)
    found = np.flatnonzero(np.isfinite(distances))
    a, b = one[2][found].astype(np.float32), other[2][nearest[found]].astype(np.float32)
    cosines = (a * b).sum(axis=1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) + 1e-9)
    still = one[0][found[cosines > ALIKE]]
    if len(still) < max(LEAST_MATCHES, STILL * fewer):
        return False
    # A name or a time that a camera writes into each photograph stands still as well.
    extent = np.maximum(one[0].max(axis=0), other[0].max(axis=0)) + 1.0
    return len(np.unique((still * CELLS / extent).astype(int), axis=0)) >= OCCUPIED
