"""Find photographs whose camera stood still while the object turned, as on a turntable.

What stands still shows itself: features of two photographs lie at the same pixels and look the
same.  A hand moves between photographs, so all but a few features of any two move as well.  A ring
is a group of photographs that a camera took from one place.
"""

import numpy as np

from .features import LEAST_MATCHES
from .library import SEED
from .work import Work, number_of

SAME_PLACE = 1.0  # pixels of the work size
ALIKE = 0.9  # cosine between the descriptors of two features that look the same
STILL = 0.1  # of the features of one of two photographs: then the camera stood still
RING = 6  # photographs
SEEDS = 12  # photographs that all are compared with in vain before no ring is sought any more
CELLS, OCCUPIED = 8, 6  # of a grid over the image, along a side; how many hold what stands still


def find_rings(work: Work) -> list[tuple[int, ...]]:
    """Photographs, by number, of each ring of at least RING; the first photograph's ring first."""
    features = features_of(work)
    left, rings, vain = list(features), [], 0
    for seed in np.random.default_rng(SEED).permutation(left).tolist():
        if vain == SEEDS:
            break
        if seed not in left:
            continue
        ring = [n for n in left if n == seed or stood_still(features[seed], features[n])]
        if len(ring) < RING:
            vain += 1
            continue
        vain = 0
        rings.append(tuple(ring))
        left = [n for n in left if n not in ring]
    return sorted(rings)


def features_of(work: Work) -> dict:
    """Places in the image [m, 2], descriptors of length 1 [m, 128], and a tree, of each photo."""
    from scipy.spatial import cKDTree

    found = {}
    with work.database() as database:
        for image in database.read_all_images():
            places = database.read_keypoints(image.image_id)[:, :2].astype(np.float64)
            described = np.asarray(database.read_descriptors(image.image_id).data, np.float32)
            if len(places) == len(described) >= LEAST_MATCHES:
                described = described / np.linalg.norm(described, axis=1, keepdims=True)
                found[number_of(image.name)] = places, described, cKDTree(places)
    return dict(sorted(found.items()))


def stood_still(one, other) -> bool:
    """Whether so many features of two photographs are at the same places, all over the image."""
    distances, nearest = other[2].query(one[0], distance_upper_bound=SAME_PLACE)
    found = np.flatnonzero(np.isfinite(distances))
    cosines = (one[1][found] * other[1][nearest[found]]).sum(axis=1)
    still = one[0][found[cosines > ALIKE]]
    if len(still) < max(LEAST_MATCHES, STILL * min(len(one[0]), len(other[0]))):
        return False
    # A name or a time that a camera writes into each photograph stands still as well.
    extent = np.maximum(one[0].max(axis=0), other[0].max(axis=0)) + 1.0
    return len(np.unique((still * CELLS / extent).astype(int), axis=0)) >= OCCUPIED
