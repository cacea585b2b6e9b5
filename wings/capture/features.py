"""Features of photographs.

Photographs are decoded by core/base/images.py, and handed to pycolmap as upright PNG files of the
work size, a few at a time; pycolmap itself never opens a file of the user's.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from ...core.base.device import thread_count
from ...core.base.images import ImageError
from ...core.training import exposure_of, gray_of, read_mask, sharpness_of, shrunk_size
from .library import Threads, interruptible, load_pycolmap
from .photos import read_photo
from .work import Look, Work, name_of, number_of

MOST_FEATURES = 4096  # of a photograph; the strongest
BEYOND = 0.005  # of the longer side: features so far outside of a user's or program's masks count
FAINT = 0.002  # pycolmap's peak_threshold, which is 0.0067 for whole photographs
MOST_AT_ONCE = 64  # photographs in memory, and as many that are read meanwhile
FOCAL_FACTOR = 1.2  # focal length over the longer side, where EXIF doesn't say
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
    unreadable, at_once = [], min(2 * thread_count(), MOST_AT_ONCE)
    portions = [todo[first : first + at_once] for first in range(0, len(todo), at_once)]
    title = "Features of the object" if work.is_cut else "Finding features"
    with (
        begin(title, len(work.photos), len(done)) as advance,
        work.temporary_folder() as folder,
        Threads(thread_count()) as pool,
    ):
        # While pycolmap works at a portion, the next one is read.
        begun = [pool.submit(written, work, n, Path(folder)) for n in todo[:at_once]]
        for portion, following in pairwise([*portions, []]):
            results = [future.result() for future in begun]
            begun = [pool.submit(written, work, n, Path(folder)) for n in following]
            unreadable += [result for result in results if isinstance(result, str)]
            read = zip(portion, results, strict=True)
            images = {n: result for n, result in read if not isinstance(result, str)}
            extract(work, {n: cameras[n] for n in images if n not in extracted}, folder)
            keep_looks(work, images, pool)
            for path in (path for n in images for path in Path(folder).glob(f"{name_of(n)}.*")):
                path.unlink()
            advance(len(done) + todo.index(portion[-1]) + 1)
    return unreadable


def written(work: Work, number: int, folder: Path):
    """Write a photograph as a PNG file, and its mask if the work is cut.

    Returns:
        Its pixels [h, w, 3] uint8, or why it can't be read.
    """
    try:
        rgb = read_photo(work.photos[number], work.image_size)
    except ImageError as error:
        return str(error)
    path = folder / f"{name_of(number)}.png"
    Image.fromarray(rgb).save(path, compress_level=1)
    if work.is_cut:  # pycolmap's name for the mask of an image
        mask = object_mask(work, number, rgb.shape[1::-1])
        Image.fromarray(mask).save(path.with_name(path.name + ".png"), compress_level=1)
    return rgb


def extract(work: Work, cameras: dict[int, int], folder: str):
    """Features of photographs that were written into a folder, into the database.

    Args:
        cameras: The database's camera of each photograph.
    """
    pycolmap = load_pycolmap()
    options = pycolmap.FeatureExtractionOptions()
    options.sift.max_num_features = MOST_FEATURES
    options.num_threads = thread_count()  # by default all of the host's, beyond a quota
    if work.is_cut:
        options.sift.peak_threshold = FAINT
    for camera in set(cameras.values()):
        interruptible(
            pycolmap.extract_features,
            str(work.database_path),
            folder,
            [name_of(n) + ".png" for n in cameras if cameras[n] == camera],
            reader_options=pycolmap.ImageReaderOptions(
                existing_camera_id=camera, mask_path=folder if work.is_cut else ""
            ),
            extraction_options=options,
        )


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


def keep_looks(work: Work, images: dict, pool: Threads):
    """Note the colors at the features of photographs, their sharpness and exposure.

    Args:
        images: By number.  [h, w, 3] uint8 each
    """
    with work.database() as database:
        keys = [database.read_image_with_name(f"{name_of(n)}.png").image_id for n in images]
        points = [database.read_keypoints(key)[:, :2].astype(int) for key in keys]

    def keep(number, points):
        rgb = images[number]
        columns, rows = np.clip(points, 0, np.array(rgb.shape[1::-1]) - 1).T
        gray = gray_of(rgb)
        work.keep_look(number, Look(rgb[rows, columns], sharpness_of(gray), exposure_of(gray)))

    list(pool.map(keep, images, points))
