"""Whether the cameras that were found agree with what pairs of photographs share.

Things that look alike are matched with one another.  Mapping may then find a camera for every
photograph, with small errors in pixels, and find them wrongly.  The matches of a pair fit together
by themselves: `match_photos` keeps no others.  If most of them don't fit the cameras, the pair
contradicts these.  A match is as far from its epipolar lines as Sampson's distance says,

    d = f |yᵀ E x| / sqrt((E x)₁² + (E x)₂² + (Eᵀ y)₁² + (Eᵀ y)₂²)  [pixels],  E = [t]× R

for its places x, y at depth 1, the mean focal length f, and the second camera's rotation R and
shift t from the first.

Only strong pairs are asked.  Places of a wallpaper that look alike are matched as well, and such
pairs contradict cameras that are right; but they share less than neighbors do.  Of few photographs
a strong pair may have hardly more matches than chance finds: with less than ENOUGH it contradicts
nothing.
"""

from dataclasses import dataclass

import numpy as np

from .features import LEAST_MATCHES
from .library import load_pycolmap
from .work import Work, number_of

STRONG = 0.5  # of the matches in the strongest pair of one of the two photographs
FAR = 4.0  # a match does not fit if it is so far from its epipolar lines [pixels]
TOLD = 0.01  # of the strong pairs, above which contradictions are told
LEAST_TOLD = 2  # pairs: a single one is found in captures that are right
ENOUGH = 30  # matches: pairs with fewer can contradict cameras that are right
FLIP = np.array([1.0, -1.0, -1.0, 1.0])  # OpenGL's axes to OpenCV's


@dataclass(frozen=True)
class Agreement:
    """How many strong pairs there are, and how many of these contradict the cameras."""

    strong: int
    contradicting: int

    def sentences(self) -> list[str]:
        """What to tell the user; none if hardly any contradict."""
        if self.contradicting < LEAST_TOLD or self.contradicting <= TOLD * self.strong:
            return []
        return [
            f"{self.contradicting} of the {self.strong} pairs of photographs that share most "
            f"contradict the cameras, so these may be wrong, and the model with them: perhaps two "
            f"things look alike, one looks the same from several sides, or something moves, as a "
            f"shadow; photograph one thing at a time, on a patterned cloth or a newspaper"
        ]


def agreement(work: Work, mapped) -> Agreement:
    """Compare the matches of strong pairs with a mapping.Mapped."""
    pycolmap = load_pycolmap()
    rows = {number: row for row, number in enumerate(mapped.numbers.tolist())}
    with work.database() as database:
        images = {image.image_id: number_of(image.name) for image in database.read_all_images()}
        points = {
            rows[number]: database.read_keypoints(key)[:, :2].astype(float)
            for key, number in images.items()
            if number in rows
        }
        keys, geometries = database.read_two_view_geometries()
    matches = {}
    for key, geometry in zip(keys, geometries, strict=True):
        pair = tuple(rows.get(images[k]) for k in pycolmap.pair_id_to_image_pair(key))
        if None not in pair and len(geometry.inlier_matches) >= LEAST_MATCHES:
            matches[pair] = geometry.inlier_matches
    places = {row: at_depth_1(mapped.lenses[row], points[row]) for row in points}
    strong = strong_pairs({pair: len(found) for pair, found in matches.items()})
    contradicting = 0
    for a, b in strong:
        one, other = matches[a, b].T
        focal = mapped.lenses[[a, b], 0].mean()
        off = distances(mapped.poses[[a, b]], places[a][one], places[b][other], focal)
        contradicting += int(len(one) >= ENOUGH and np.median(off) > FAR)
    return Agreement(len(strong), contradicting)


def at_depth_1(lens, points):
    """Where the rays of pixels meet the plane at depth 1, in OpenCV's axes.  [m, 2] -> [m, 2]"""
    focal, _, x, y, k1, width, height = lens
    camera = load_pycolmap().Camera(
        model="SIMPLE_RADIAL", width=int(width), height=int(height), params=[focal, x, y, k1]
    )
    return np.asarray(camera.cam_from_img(points)).reshape(-1, 2)


def strong_pairs(counts: dict) -> list[tuple[int, int]]:
    """Pairs with STRONG of the matches in the strongest pair of one of their photographs.

    Args:
        counts: Matches of each pair.
    """
    strongest = {}
    for pair, count in counts.items():
        for photo in pair:
            strongest[photo] = max(count, strongest.get(photo, 0))
    return [
        (a, b)
        for (a, b), count in counts.items()
        if count >= STRONG * min(strongest[a], strongest[b])
    ]


def distances(poses, x, y, focal: float):
    """Sampson's distance of matches from the epipolar lines of two cameras [pixels].  [m]

    Args:
        poses: Camera to world, OpenGL's axes.  [2, 4, 4]
        x, y: Places at depth 1 in the two cameras, OpenCV's axes.  [m, 2] both
    """
    one, other = poses * FLIP
    second_from_first = np.linalg.inv(other) @ one
    turn, shift = second_from_first[:3, :3], second_from_first[:3, 3]
    essential = np.cross(shift, turn, axisb=0, axisc=0)
    squared = load_pycolmap().compute_squared_sampson_error(x, y, essential)
    return focal * np.sqrt(squared)
