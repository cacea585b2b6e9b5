"""Which features two photographs share: descriptors that match, in places that fit together.

Descriptors are compared by comparing.py, on a GPU if there is one.  RANSAC is pycolmap's: of a
pair's matches it keeps those that two cameras can have seen.
"""

from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ...core.base.device import thread_count
from .comparing import Comparer
from .features import LEAST_MATCHES
from .library import SEED, Threads, load_pycolmap
from .work import Work, number_of

EXHAUSTIVE = 200  # photographs up to which all pairs are matched
NEIGHBORS = 10  # before and after each frame of a video, or of very many photographs
MOST_KEYS = 100  # evenly among these, that are matched with one another: ways that meet again
PAIRS_AT_ONCE = 16  # for each thread
KEPT = 400  # photographs whose features are kept meanwhile: some 400 MB at most
LARGEST = 512  # features of a photograph, that are compared with all others first
ALIKE = 5  # matches of these, with which two photographs may share something
CLOSEST = 24  # pairs of each photograph that have most of these: few photographs need all pairs
TRIALS = 2000  # of RANSAC, at most
SOUGHT = 12  # matches that samples are enough for: of LEAST_MATCHES, noise keeps some from fitting
LEAST_RATIO = 0.25  # of a pair's matches that fit together, at least: pycolmap's default


@dataclass(frozen=True)
class Features:
    """A photograph's features.

    Attributes:
        camera: pycolmap's.
        places: In the image.  [m, 2] float64
        descriptors: On the comparer's device.  [m, 128] uint8
        largest: Those of the features that cover most pixels.  [at most LARGEST, 128] uint8
    """

    camera: object
    places: np.ndarray
    descriptors: Any
    largest: Any


def match_photos(work: Work, is_sequence: bool, begin, comparer: Comparer):
    """Match the features of pairs of photographs that have not been matched yet.

    Args:
        begin: Phases.phase.
    """
    with work.database() as database:
        images = {number_of(image.name): image for image in database.read_all_images()}
        pairs = pairs_to_match(sorted(images), is_sequence)
        keys = {pair: tuple(images[number].image_id for number in pair) for pair in pairs}
        todo = [pair for pair in pairs if not database.exists_two_view_geometry(*keys[pair])]
        features = lru_cache(KEPT)(partial(features_of, database, images, comparer))
        at_once = PAIRS_AT_ONCE * thread_count()
        with threadpool_limits(1, "blas"), Threads(thread_count()) as pool:  # a product in each
            chosen = pairs_alike(todo, features, comparer, begin, pool)
            for pair in sorted(set(todo) - chosen):
                database.write_two_view_geometry(*keys[pair], load_pycolmap().TwoViewGeometry())
            todo = sorted(chosen)
            done = len(pairs) - len(todo)
            with begin("Matching photographs", len(pairs), done) as advance:
                for first in range(0, len(todo), at_once):
                    chunk = todo[first : first + at_once]
                    sides = zip(*[map(features, pair) for pair in chunk], strict=True)
                    shared = pool.map(partial(geometry_of, comparer), *sides)
                    for pair, geometry in zip(chunk, shared, strict=True):
                        database.write_two_view_geometry(*keys[pair], geometry)
                    advance(done + first + len(chunk))


def features_of(database, images: dict, comparer, number: int) -> Features:
    """The features of one of the images in the database, which are by number."""
    image = images[number]
    keypoints = database.read_keypoints(image.image_id)
    descriptors = np.asarray(database.read_descriptors(image.image_id).data).reshape(-1, 128)
    areas = np.abs(np.linalg.det(keypoints[:, 2:6].reshape(len(keypoints), 2, 2)))
    largest = descriptors[np.argsort(-areas, kind="stable")[:LARGEST]]
    return Features(
        database.read_camera(image.camera_id),
        keypoints[:, :2].astype(np.float64),
        comparer.place(descriptors),
        comparer.place(largest),
    )


def pairs_alike(pairs, features, comparer, begin, pool) -> set[tuple[int, int]]:
    """Pairs whose largest features say that they may share something.

    Their matches are found in a tenth of the time, or less.  Of each photograph the CLOSEST pairs
    with most of them are among these in any case.

    Args:
        features: Those of a photograph, by its number.
        begin: Phases.phase.
    """
    counts, of_each = {}, defaultdict(list)
    with begin("Comparing photographs", len(pairs)) as advance:
        for first in range(0, len(pairs), KEPT):
            chunk = pairs[first : first + KEPT]
            sides = zip(
                *[(features(i).largest, features(j).largest) for i, j in chunk], strict=True
            )
            counts |= zip(chunk, comparer.counts(*sides, pool), strict=True)
            advance(first + len(chunk))
    for pair in sorted(pairs, key=counts.get, reverse=True):
        for number in pair:
            of_each[number].append(pair)
    closest = {pair for found in of_each.values() for pair in found[:CLOSEST]}
    return closest | {pair for pair in pairs if counts[pair] >= ALIKE}


def pairs_to_match(numbers, is_sequence: bool) -> list[tuple[int, int]]:
    """Pairs of photographs: all of them, or along a video and among frames spread over it."""
    if not is_sequence and len(numbers) <= EXHAUSTIVE:
        return list(combinations(numbers, 2))
    places = range(len(numbers))
    near = {(i, j) for i in places for j in range(i + 1, min(i + 1 + NEIGHBORS, len(numbers)))}
    step = max(-(-len(numbers) // MOST_KEYS), 3)
    near |= set(combinations(places[::step], 2))
    return [(numbers[i], numbers[j]) for i, j in sorted(near)]


def geometry_of(comparer, one: Features, other: Features):
    """What two photographs share: pycolmap's TwoViewGeometry."""
    pycolmap = load_pycolmap()
    matches = comparer.matches(one.descriptors, other.descriptors)
    if len(matches) < LEAST_MATCHES:
        return pycolmap.TwoViewGeometry()
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.max_num_trials = TRIALS
    # Fewer than LEAST_MATCHES are nothing, so samples that would find fewer are in vain.
    options.ransac.min_inlier_ratio = max(LEAST_RATIO, SOUGHT / len(matches))
    options.ransac.random_seed = SEED
    return pycolmap.estimate_two_view_geometry(
        one.camera, one.places, other.camera, other.places, matches, options
    )
