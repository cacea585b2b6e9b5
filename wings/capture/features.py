"""Features of photographs, and which of them two photographs share.

Photographs are decoded by core/base/images.py, and handed to pycolmap as upright PNG files of the
work size, a few at a time; pycolmap itself never opens a file of the user's.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import combinations
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from ...core.base.device import thread_count
from ...core.base.images import ImageError
from ...core.training import exposure_of, gray_of, read_mask, sharpness_of, shrunk_size
from .library import SEED, interruptible, load_pycolmap
from .photos import read_photo
from .work import PAIRS, Look, Work, name_of, number_of

MOST_FEATURES = 4096  # of a photograph; the strongest
BEYOND = 0.005  # of the longer side: features so far outside of a user's or program's masks count
FAINT = 0.002  # pycolmap's peak_threshold, which is 0.0067 for whole photographs
FOCAL_FACTOR = 1.2  # focal length over the longer side, where EXIF doesn't say
EXHAUSTIVE = 200  # photographs up to which all pairs are matched
NEIGHBORS = 10  # before and after each frame of a video, or of very many photographs
MOST_KEYS = 100  # evenly among these, that are matched with one another: ways that meet again
PAIRS_AT_ONCE = 32  # for each thread
LEAST_MATCHES = 15  # of a pair that shows the same thing, as in pycolmap


def find_features(work: Work, begin) -> list[str]:
    """Write the features of all photographs that have none yet into the database.

    If the work is cut, these are features of what may be the object, by masks or mattes, and there
    are more of them, since an object is a small part of a photograph.

    Args:
        begin: Phases.phase.

    Returns:
        Why photographs were left out: they are damaged.
    """
    pycolmap = load_pycolmap()
    with work.database() as database:
        cameras = camera_ids(work, database)
        extracted = {
            number_of(image.name)
            for image in database.read_all_images()
            if database.exists_descriptors(image.image_id)
        }
    # An interrupt may come between a photograph's features and its look.
    done = {number for number in extracted if work.has_look(number)}
    todo = [n for n in range(len(work.photos)) if n not in done]
    unreadable, at_once = [], 2 * thread_count()
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features = MOST_FEATURES
    if work.is_cut:
        options.sift.peak_threshold = FAINT
    with begin(
        "Features of the object" if work.is_cut else "Finding features", len(work.photos), len(done)
    ) as advance:
        for first in range(0, len(todo), at_once):
            numbers = todo[first : first + at_once]
            with work.temporary_folder() as folder:
                images = written_images(work, numbers, Path(folder), unreadable)
                missing = [n for n in images if n not in extracted]
                for camera in {cameras[n] for n in missing}:
                    interruptible(
                        pycolmap.extract_features,
                        str(work.database_path),
                        folder,
                        [name_of(n) + ".png" for n in missing if cameras[n] == camera],
                        reader_options=pycolmap.ImageReaderOptions(
                            existing_camera_id=camera, mask_path=folder if work.is_cut else ""
                        ),
                        extraction_options=options,
                    )
            keep_looks(work, images)
            advance(len(done) + min(first + at_once, len(todo)))
    return unreadable


def written_images(work: Work, numbers, folder: Path, unreadable: list) -> dict:
    """Write photographs as PNG files; those that could be read, by number.  [h, w, 3] uint8"""

    def write(number):
        try:
            rgb = read_photo(work.photos[number], work.image_size)
        except ImageError as error:
            return number, str(error)
        path = folder / f"{name_of(number)}.png"
        Image.fromarray(rgb).save(path, compress_level=1)
        if work.is_cut:  # pycolmap's name for the mask of an image
            mask = object_mask(work, number, rgb.shape[1::-1])
            Image.fromarray(mask).save(path.with_name(path.name + ".png"), compress_level=1)
        return number, rgb

    with ThreadPoolExecutor(min(len(numbers), thread_count())) as pool:
        results = list(pool.map(write, numbers))
    unreadable += [result for _, result in results if isinstance(result, str)]
    return {number: rgb for number, rgb in results if not isinstance(rgb, str)}


def object_mask(work: Work, number: int, size) -> np.ndarray:
    """Where a photograph may show the object: 255, else 0.  [h, w] uint8

    Raises:
        DatasetError: The user's mask can't be read.
    """
    ring = None if work.masks else work.matte(number)
    if work.masks:
        mask = read_mask(work.masks[number], *size, work.photos[number].is_turned)
    elif (mask := work.matte(number, made=True) if ring is None else ring) is None:
        return np.full(size[::-1], 255, np.uint8)
    else:
        mask = np.asarray(Image.fromarray(mask).resize(size, Image.Resampling.NEAREST))
    if ring is None:  # corners of the outline count, whose features lie half outside
        reach = 2 * round(BEYOND * max(size)) + 1
        mask = np.asarray(Image.fromarray(mask).filter(ImageFilter.MaxFilter(reach)))
    return np.where(mask > 0, np.uint8(255), np.uint8(0))


def camera_ids(work: Work, database) -> dict[int, int]:
    """The database's camera of each photograph, made if it has none yet.

    Photographs of one device, focal length and size share a camera.
    """
    pycolmap = load_pycolmap()
    devices = sorted({photo.device for photo in work.photos}, key=str)
    known = {camera.camera_id for camera in database.read_all_cameras()}
    for number, device in enumerate(devices, start=1):
        if number in known:
            continue
        photo = next(photo for photo in work.photos if photo.device == device)
        width, height = shrunk_size(photo.size, work.image_size)
        focal = FOCAL_FACTOR * max(width, height)
        if photo.focal is not None:
            focal = photo.focal * max(width, height) / max(photo.size)
        camera = pycolmap.Camera.create_from_model_name(
            number, "SIMPLE_RADIAL", focal, width, height
        )
        camera.has_prior_focal_length = photo.focal is not None
        database.write_camera(camera, use_camera_id=True)
        rig = pycolmap.Rig(rig_id=number)
        rig.add_ref_sensor(camera.sensor_id)
        database.write_rig(rig, use_rig_id=True)
    return {n: 1 + devices.index(photo.device) for n, photo in enumerate(work.photos)}


def keep_looks(work: Work, images: dict):
    """Note the colors at the features of photographs, their sharpness and exposure."""
    with work.database() as database:
        for number, rgb in images.items():
            image = database.read_image_with_name(f"{name_of(number)}.png")
            points = database.read_keypoints(image.image_id)[:, :2]
            columns, rows = np.clip(points.astype(int), 0, np.array(rgb.shape[1::-1]) - 1).T
            gray = gray_of(rgb)
            look = Look(rgb[rows, columns], sharpness_of(gray), exposure_of(gray))
            work.keep_look(number, look)


def match_photos(work: Work, is_sequence: bool, begin):
    """Match the features of pairs of photographs that have not been matched yet."""
    pycolmap = load_pycolmap()
    with work.database() as database:
        ids = {number_of(image.name): image.image_id for image in database.read_all_images()}
        pairs = pairs_to_match(sorted(ids), is_sequence)
        todo = [(a, b) for a, b in pairs if not database.exists_two_view_geometry(ids[a], ids[b])]
    verification = pycolmap.TwoViewGeometryOptions()
    # Pairs that show nothing in common would have 10,000: a third of the time, for no pair more.
    verification.ransac.max_num_trials = 2000
    verification.ransac.random_seed = SEED
    at_once = PAIRS_AT_ONCE * thread_count()
    listed = work.folder / PAIRS
    with begin("Matching photographs", len(pairs), len(pairs) - len(todo)) as advance:
        for first in range(0, len(todo), at_once):
            chunk = todo[first : first + at_once]
            lines = [f"{name_of(a)}.png {name_of(b)}.png\n" for a, b in chunk]
            listed.write_text("".join(lines), encoding="ascii")
            interruptible(
                pycolmap.match_image_pairs,
                str(work.database_path),
                pairing_options=pycolmap.ImportedPairingOptions(match_list_path=str(listed)),
                verification_options=verification,
            )
            advance(len(pairs) - len(todo) + min(first + at_once, len(todo)))


def pairs_to_match(numbers, is_sequence: bool) -> list[tuple[int, int]]:
    """Pairs of photographs: all of them, or along a video and among frames spread over it."""
    if not is_sequence and len(numbers) <= EXHAUSTIVE:
        return list(combinations(numbers, 2))
    places = range(len(numbers))
    near = {(i, j) for i in places for j in range(i + 1, min(i + 1 + NEIGHBORS, len(numbers)))}
    step = max(-(-len(numbers) // MOST_KEYS), 3)
    near |= set(combinations(places[::step], 2))
    return [(numbers[i], numbers[j]) for i, j in sorted(near)]
