"""Cameras and points from matched features: pycolmap's mapping, and which result is taken.

Incremental mapping comes first.  Where it leaves out photographs that share matches with the
others, global mapping is the second try, and the one with more photographs is taken.  Either may
find several groups of photographs that nothing connects; the largest is taken.
"""

import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.base.children import start
from ...core.base.device import thread_count
from ...core.training import SparsePoints
from . import circles
from .features import LEAST_MATCHES
from .library import POLL_SECONDS, SEED, interruptible, load_pycolmap
from .still import scales_of
from .work import Work, number_of

SMALLEST_GROUP = 4  # photographs of a group that is found at all
# Of bundle adjustments.  With pycolmap's 1.1, 2 and 5 refinements, and 0 they take more than twice
# the time, and cameras are no nearer to the truth (009-cameras.md).
GROWN = 1.6  # times as many photographs or points as at the last one of all: then there is another
GAIN = 1e-5  # of the cost, in a step that ends one
# All cameras are adjusted, points that err are dropped, and so on: with few photographs up to
# ROUNDS times, as pycolmap does, because some cameras need it; with others once, to save time.
FEW, ROUNDS = 48, 5
NEAREST = 0.1  # of the points that a photograph shows
ENOUGH = 0.9  # of the photographs that matches connect: with fewer, there is a second try
GLOBAL_MAPPING = """
import sys
import numpy, PIL.Image
import pycolmap
database, folder, smallest, seed, threads = sys.argv[1:]
pycolmap.set_random_seed(int(seed))
options = pycolmap.GlobalPipelineOptions(min_model_size=int(smallest), random_seed=int(seed))
options.num_threads = int(threads)
pycolmap.global_mapping(database, folder, folder, options)
"""  # a program of its own; in this order, because of what load_pycolmap says


@dataclass(frozen=True)
class Mapped:
    """The largest group of photographs whose cameras are known; lengths have no unit.

    Attributes:
        numbers: Of the photographs.  [n] int
        poses: Camera to world, OpenGL's axes.  [n, 4, 4] float64
        lenses: fx, fy, cx, cy, k1, and the width and height that they are for.  [n, 7] float64
        points: In the same world.
        seen: How many of them each photograph shows.  [n] int
        nearest: From each camera to the nearest tenth of these; 0 if there are none.  [n] float64
        pixel_error: Mean distance of a point's image from its feature [pixels of the work size].
        groups: Photographs of all groups, the largest first, by number.
        is_on_circles: Whether the cameras of rings were adjusted as such (circles.py).
    """

    numbers: np.ndarray
    poses: np.ndarray
    lenses: np.ndarray
    points: SparsePoints
    seen: np.ndarray
    nearest: np.ndarray
    pixel_error: float
    groups: tuple[tuple[int, ...], ...]
    is_on_circles: bool = False


def map_photos(work: Work, begin, rings=(), still=None) -> Mapped | None:
    """Find the cameras; None if no two photographs fit together.

    Args:
        begin: Phases.phase.
        rings: The photographs of each ring (still.py), by number.
        still: What stands still behind them.
    """
    count = len(connected(work))
    found = incremental(work, begin)
    if found and not all(map(reaches_corners, max(found, key=size_of).cameras.values())):
        found = incremental(work, begin, distorts=False)
    if largest(found) < ENOUGH * count:
        found = max(found, global_mapping(work, begin), key=largest)
    if not found:
        return None
    found = sorted(found, key=size_of, reverse=True)
    is_on_circles = False
    if rings:
        numbers = {key: number_of(image.name) for key, image in found[0].images.items()}
        with work.database() as database:
            scales = {
                number_of(image.name): scales_of(database.read_keypoints(image.image_id))
                for image in database.read_all_images()
            }
        with begin("Fitting circles", 3 * circles.STEPS) as advance:
            is_on_circles = circles.on_circles(found[0], rings, numbers, scales, still, advance)
    return replace(mapped_of(work, found), is_on_circles=is_on_circles)


def size_of(group) -> int:
    return group.num_reg_images()


def largest(found) -> int:
    """The photographs of the largest group."""
    return max(map(size_of, found), default=0)


def reaches_corners(camera) -> bool:
    """Whether a SIMPLE_RADIAL camera has a ray for each pixel.

    A radius r is seen at r + k r³, which has its maximum at r = 1/sqrt(-3 k) if k is negative.
    """
    focal, x, y, k = camera.params
    corner = np.hypot(max(x, camera.width - x), max(y, camera.height - y)) / focal
    return bool(k >= 0.0 or corner < 2.0 / 3.0 / np.sqrt(-3.0 * k))


def incremental(work: Work, begin, distorts=True) -> list:
    """Groups of photographs, by incremental mapping.

    Args:
        distorts: Lenses may; few photographs of little can suggest one that no camera has.
    """
    pycolmap = load_pycolmap()
    options = pycolmap.IncrementalPipelineOptions(
        min_model_size=SMALLEST_GROUP,
        extract_colors=False,
        random_seed=SEED,
        num_threads=thread_count(),
        ba_refine_extra_params=distorts,
        ba_global_frames_ratio=GROWN,
        ba_global_points_ratio=GROWN,
        ba_local_max_refinements=1,
        ba_global_max_refinements=ROUNDS if len(work.photos) < FEW else 1,
        ba_local_function_tolerance=GAIN,
        ba_global_function_tolerance=GAIN,
    )
    registered = [0]

    def on_image():
        registered[0] += 1

    with begin("Finding cameras", len(work.photos)) as advance:
        with work.temporary_folder() as folder:
            found = interruptible(
                pycolmap.incremental_mapping,
                str(work.database_path),
                folder,  # of images, none of which is read
                folder,
                options,
                next_image_callback=on_image,
                each=lambda: advance(registered[0]),
            )
        advance(largest(found.values()))
    return list(found.values())


def global_mapping(work: Work, begin) -> list:
    """Groups of photographs, by global mapping; none if its solvers give up.

    It knows no cancellation, so it runs in a process of its own, which Ctrl-C ends.
    """
    pycolmap = load_pycolmap()
    with begin("Finding more cameras", len(work.photos)) as advance:
        with work.temporary_folder() as folder:
            arguments = work.database_path, folder, SMALLEST_GROUP, SEED, thread_count()
            run_alone(GLOBAL_MAPPING, *map(str, arguments))
            groups = sorted(path for path in Path(folder).iterdir() if path.is_dir())
            try:
                found = [pycolmap.Reconstruction(str(path)) for path in groups]
            except (RuntimeError, ValueError):  # what a process that failed has left
                return []
        advance(largest(found))
    return found


def run_alone(code: str, *arguments: str):
    """Run Python without input and output; an interrupt ends it, too."""
    nothing = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    with start(code, *arguments, **nothing) as process:
        try:
            while process.poll() is None:
                try:
                    process.wait(POLL_SECONDS)
                except subprocess.TimeoutExpired:
                    continue
        except BaseException:
            process.kill()
            raise


def connected(work: Work) -> set[int]:
    """The largest set of photographs that matches connect, by number."""
    pycolmap = load_pycolmap()
    with work.database() as database:
        names = {image.image_id: image.name for image in database.read_all_images()}
        pairs, counts = database.read_two_view_geometry_num_inliers()
    groups = {key: {key} for key in names}
    for pair, count in zip(pairs, counts, strict=True):
        if count >= LEAST_MATCHES:
            one, other = (groups[key] for key in pycolmap.pair_id_to_image_pair(pair))
            if one is not other:
                one |= other
                groups.update(dict.fromkeys(other, one))
    return {number_of(names[key]) for key in max(groups.values(), key=len, default=())}


def mapped_of(work: Work, found: list) -> Mapped:
    """Arrays of pycolmap's reconstructions, the largest first."""
    groups = [
        tuple(sorted(number_of(group.images[key].name) for key in group.reg_image_ids()))
        for group in found
    ]
    best = found[0]
    by_number = {number_of(best.images[key].name): best.images[key] for key in best.reg_image_ids()}
    images = [by_number[number] for number in groups[0]]
    poses, lenses = [], []
    for image in images:
        pose = np.eye(4)
        pose[:3] = image.cam_from_world().inverse().matrix()
        poses.append(pose * np.array([1.0, -1.0, -1.0, 1.0]))  # OpenCV's axes to OpenGL's
        camera = best.cameras[image.camera_id]
        focal, x, y, k1 = camera.params
        lenses.append((focal, focal, x, y, k1, camera.width, camera.height))
    rows = {key: row for row, key in enumerate(best.points3D)}
    observed = [observations(image, rows) for image in images]
    points = points_of(work, best, groups[0], observed)
    poses = np.array(poses)
    away = [points.points[seen] - p[:3, 3] for p, (_, seen) in zip(poses, observed, strict=True)]
    near = [np.quantile(np.linalg.norm(a, axis=1), NEAREST) if len(a) else 0.0 for a in away]
    return Mapped(
        np.array(groups[0]),
        poses,
        np.array(lenses),
        points,
        np.array([len(a) for a in away]),
        np.array(near),
        float(best.compute_mean_reprojection_error()),
        tuple(groups),
    )


def observations(image, rows: dict):
    """Features of a photograph that show points, and the rows of these.  [m] int both"""
    seen = [(i, rows[p.point3D_id]) for i, p in enumerate(image.points2D) if p.has_point3D()]
    return np.array(seen, int).reshape(-1, 2).T


def points_of(work: Work, group, numbers, observed) -> SparsePoints:
    """The points of a reconstruction, each in the mean color of its features.

    Args:
        numbers: Of its photographs.
        observed: What `observations` says of each.
    """
    points = list(group.points3D.values())
    sums, counts = np.zeros((len(points), 3)), np.zeros(len(points), int)
    for number, (features, rows) in zip(numbers, observed, strict=True):
        np.add.at(sums, rows, work.look(number).colors[features])
        np.add.at(counts, rows, 1)
    return SparsePoints(
        np.array([p.xyz for p in points], np.float32).reshape(-1, 3),
        np.round(sums / np.maximum(counts, 1)[:, None]).astype(np.uint8),
        counts.astype(np.int32),
        np.array([p.error for p in points], np.float32),
    )
