"""From a folder of photographs to transforms.json and points.npz beside them.

The world that they are in: +z is up (`up_of` in core/training/data/views.py), the origin is the
point that the cameras look at (the points' median, if they all look the same way), and the median
camera is DISTANCE away from it.
"""

import json
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from ...core.base.device import Choice
from ...core.base.paths import free_name, whole_file
from ...core.base.reading import open_file, read_text
from ...core.training import (
    MADE_BY,
    mask_paths,
    nearest_to_axes,
    photo_folder,
    save_points,
    up_of,
    upright,
)
from .agreement import Agreement, agreement
from .comparing import Comparer, begin_comparer
from .features import find_features
from .library import load_pycolmap
from .mapping import ENOUGH, Mapped, connected, map_photos
from .masking import digest_of, make_mattes
from .matching import match_photos
from .page import gaps_of
from .phases import Phases
from .photos import IMAGE_SIZE, CaptureError, Photo, find_photos
from .standing import checked
from .still import find_still
from .turntable import FoundMasks, find_masks, find_turning, said_of
from .work import Work, open_work

TRANSFORMS_FILE = "transforms.json"
MASKS_FOLDER = "masks"  # or masks-2 and so on
HEAD = 1000  # bytes of the file, in which that stands
DISTANCE = 4.0  # about that of NeRF-synthetic's cameras, which is 4.03
LEAST_PHOTOS = 8  # with which something can be learned at all
FEW_FEATURES = 150  # in the median photograph: there is hardly any texture
NAMES_SHOWN = 4
ADVICE = "take 30 to 60 sharp photographs all around the object, each a small step from the last"


@dataclass(frozen=True)
class Capture:
    """Photographs whose cameras were found.

    Attributes:
        folder: Where transforms.json and points.npz lie.
        photos: Those with cameras.  [n]
        mapped: These cameras, and sparse points on what the photographs show.
        agreement: Of the cameras with what pairs of photographs share.
        left_out: Names of photographs without a camera.
        other_groups: How many of these fit together as other scenes, the largest first.
        unreadable: Why files could not be read, a sentence for each.
        seconds: That it took.
        rings: The photographs of each place where the camera stood still, by number.
        found: Masks, and the object's box, if masks or rings tell them.
        masks_at: Where the masks were written; None if none were.
        program: The program that made them first; "" without one.
        whole: Whether all of each photograph was followed, though the user gave masks.
    """

    folder: Path
    photos: tuple[Photo, ...]
    mapped: Mapped
    agreement: Agreement
    left_out: tuple[str, ...]
    other_groups: tuple[int, ...]
    unreadable: tuple[str, ...]
    seconds: float
    rings: tuple[tuple[int, ...], ...] = ()
    found: FoundMasks | None = None
    masks_at: Path | None = None
    program: str = ""
    whole: bool = False


def find_cameras(
    folder: str | Path,
    work_folder: str | Path,
    image_size: int = IMAGE_SIZE,
    is_sequence: bool = False,
    on_work: Callable[[Path, bool], None] = lambda folder, again: None,
    masks: str | Path | None = None,
    program: tuple[str, ...] = (),
    device: Choice = "auto",
) -> Capture:
    """Find the cameras of all photographs in a folder, and write what was found beside them.

    Ctrl-C leaves the work folder, from which the next call with the same photographs goes on.

    Args:
        work_folder: For unfinished work, removed at the end; <work_folder>-2 and so on if something
            else is there.
        image_size: Longer side that photographs are shrunk to [pixels].
        is_sequence: They are frames of a video, in order.
        on_work: Called with the folder of the work, and whether work goes on there.
        masks: Folder of the photographs' masks (core/training/data/masks.py): only what they show
            is followed.
        program: Instead, the words of a program that makes them (masking.py).
        device: Where descriptors are compared; the matches don't depend on it.

    Raises:
        CaptureError: The photographs don't fit together, are too few, or can't be read; or the
            program failed.
        DatasetError: The masks are not as they have to be.
        ModuleNotFoundError: pycolmap is not installed.
        OSError: Nothing can be written beside the photographs.
    """
    began, folder = time.monotonic(), Path(folder)
    load_pycolmap()
    photos_at = photo_folder(folder)
    if photos_at is None:
        raise CaptureError(f"{folder} holds no photographs: {ADVICE}")
    if (path := folder / TRANSFORMS_FILE).exists():
        raise CaptureError(f"{path} is there already, and is not overwritten: remove or rename it")
    photos, unreadable = find_photos(photos_at)
    check_count(folder, photos, unreadable)
    given = () if masks is None else mask_paths(masks, photos)
    by = digest_of(program) if program else ""
    work, again = open_work(Path(work_folder), photos, image_size, given, by)
    on_work(work.folder, again)
    with Phases() as phases:
        if program:
            make_mattes(work, program, phases.phase)
        loading = begin_comparer(device)  # the program before may need the GPU for itself
        unreadable += find_features(work, phases.phase)
        rings = find_turning(work, phases.phase)
        work, mapped = mapped_by(work, rings, is_sequence, phases.phase, loading)
        check_mapped(folder, work, mapped, rings)
        mapped = checked(folder, len(photos), mapped)
        check_mapped(folder, work, mapped, rings)  # without cameras that aren't known
        mapped = placed(mapped)
        found = find_masks(work, mapped, phases.phase) if rings or work.has_masks else None
    taken = set(mapped.numbers.tolist())
    capture = Capture(
        folder,
        tuple(photos[n] for n in mapped.numbers),
        mapped,
        agreement(work, mapped),
        tuple(p.path.name for n, p in enumerate(photos) if n not in taken),
        tuple(len(set(group) - taken) for group in mapped.groups[1:]),
        tuple(unreadable),
        time.monotonic() - began,
        tuple(rings),
        found,
        write_masks(folder, photos, found) if found and found.masks else None,
        Path(program[0]).name if program else "",
        bool(given) and not work.is_cut,
    )
    write(capture, {n: work.look(n).sharpness for n in mapped.numbers})
    work.remove()
    return capture


def mapped_by(
    work: Work, rings, is_sequence: bool, begin, loading: Future[Comparer]
) -> tuple[Work, Mapped | None]:
    """The cameras, by features of the object alone where masks or rings tell it.

    If few photographs have cameras by the user's masks, all features are tried as well.  Masks by a
    program err, so by these features of the object are the second try; rings have mattes.

    Returns:
        The work with the features that were used, too.
    """
    whole, tried = work, []
    still = find_still(work, rings) if len(rings) > 1 else None
    if rings or work.has_masks:
        tried = [replace(work, is_cut=True)]
    if not rings:
        tried.insert(0 if work.program else 1, whole)
    best = None
    for work in tried:
        if work.is_cut:
            find_features(work, begin)
        match_photos(work, is_sequence, begin, loading.result())
        mapped = map_photos(work, begin, rings, still)
        if best is None or (mapped and (not best[1] or count_of(mapped) > count_of(best[1]))):
            best = work, mapped
        if mapped and count_of(mapped) >= ENOUGH * len(work.photos):
            break
    loading.result().close()
    return best


def count_of(mapped: Mapped) -> int:
    return len(mapped.numbers)


def check_count(folder, photos, unreadable):
    """CaptureError unless there are enough photographs."""
    if len(photos) >= LEAST_PHOTOS:
        return
    if unreadable:
        raise CaptureError(
            f"of {len(photos) + len(unreadable)} photographs in {folder} only {len(photos)} can be "
            f"read, and {LEAST_PHOTOS} are needed; first: {unreadable[0]}"
        )
    what = "1 photograph" if len(photos) == 1 else f"{len(photos)} photographs"
    raise CaptureError(f"{folder} holds {what}, and at least {LEAST_PHOTOS} are needed: {ADVICE}")


def check_mapped(folder, work, mapped: Mapped | None, rings=()):
    """CaptureError unless enough photographs fit together."""
    total = len(work.photos)
    with work.database() as database:
        features = [
            database.num_keypoints_for_image(image.image_id) for image in database.read_all_images()
        ]
    least = max(LEAST_PHOTOS, total // 2 + 1)
    if mapped is not None and len(mapped.numbers) >= least:
        return
    found = 0 if mapped is None else len(mapped.numbers)
    names = [photo.path.name for photo in work.photos]
    if np.median(features or [0]) < FEW_FEATURES:
        raise CaptureError(
            f"the cameras of {found} of {total} photographs in {folder} were found, because most "
            f"show hardly any texture ({np.median(features or [0]):.0f} features in the median "
            f"one): put the object on a patterned cloth or a newspaper, and photograph it in focus"
        )
    if rings:
        count = sum(map(len, rings))
        raise CaptureError(
            f"the camera stood still for {count} photographs in {folder}, in {len(rings)} "
            f"{'rings' if len(rings) > 1 else 'ring'}, and what turns fits together in only "
            f"{found} of {total}, where {least} are needed: turn it by 10° to 15° from one "
            f"photograph to the next, take the rings from heights that differ by no more than 30°, "
            f"and come nearer if it is small in the picture"
        )
    doubts = [] if mapped is None else agreement(work, mapped).sentences()
    if doubts:
        raise CaptureError(
            f"only {found} of {total} photographs in {folder} fit together, and {least} are "
            f"needed; {doubts[0]}"
        )
    if mapped is not None and len(mapped.groups) > 1:
        shown = "; ".join(
            f"{len(group)} from {names[group[0]]} to {names[group[-1]]}"
            for group in mapped.groups[:3]
        )
        beginning = (
            f"the {total} photographs in {folder} fall into {len(mapped.groups)} groups that"
        )
        if len(connected(work)) > len(mapped.groups[0]):
            raise CaptureError(
                f"{beginning} share something, but do not fit together ({shown}): photograph the "
                f"way from one to the other in small steps, and one thing at a time if two look "
                f"alike, on a patterned cloth or a newspaper"
            )
        raise CaptureError(
            f"{beginning} show nothing in common ({shown}): photograph the way from one to the "
            f"other in small steps, or put one group alone into a folder"
        )
    raise CaptureError(
        f"only {found} of {total} photographs in {folder} fit together, and {least} are "
        f"needed: neighbors have to show mostly the same things, so {ADVICE}"
    )


def placed(mapped: Mapped) -> Mapped:
    """The same in the world that this module's docstring describes."""
    turn = upright(up_of(mapped.poses))
    poses = mapped.poses.copy()
    poses[:, :3] = turn @ poses[:, :3]
    points = mapped.points.points @ turn.T
    center = nearest_to_axes(poses)
    if center is None:
        center = np.median(points, axis=0)
    scale = DISTANCE / np.median(np.linalg.norm(poses[:, :3, 3] - center, axis=1))
    poses[:, :3, 3] = scale * (poses[:, :3, 3] - center)
    moved = (scale * (points - center)).astype(np.float32)
    return replace(mapped, poses=poses, points=replace(mapped.points, points=moved))


def write_masks(folder: Path, photos, found: FoundMasks) -> Path:
    """Write masks into a new folder beside the photographs; returns it."""
    at = free_name(folder / MASKS_FOLDER, "")
    at.mkdir()
    for number, mask in found.masks.items():
        with whole_file(at / mask_name(photos[number])) as partial:
            Image.fromarray(mask).save(partial)
    return at


def mask_name(photo: Photo) -> str:
    return f"{photo.path.name}.png"


def said_of_masks(capture: Capture) -> str:
    """Whose masks the written ones are, as the beginning of a sentence."""
    if not capture.found.made:
        return "What turns was cut out by masks"
    names = dict(zip(capture.mapped.numbers.tolist(), capture.photos, strict=True))
    wrong = [names[number].path.name for number in capture.found.overruled]
    text = f"The masks of {capture.program} were mended by the votes of all photographs"
    if not wrong:
        return text
    shown = ", ".join(wrong[:NAMES_SHOWN]) + (" and others" if len(wrong) > NAMES_SHOWN else "")
    return f"{text} (what it took for the object in {len(wrong)} of them, {shown}, was not used)"


def write(capture: Capture, sharpness: dict):
    """Write transforms.json, which is never overwritten, and points.npz."""
    frames = []
    mapped = capture.mapped
    rings = {number: r for r, ring in enumerate(capture.rings) for number in ring}
    rows = zip(mapped.numbers.tolist(), capture.photos, mapped.poses, mapped.lenses, strict=True)
    for number, photo, pose, lens in rows:
        # pycolmap's pixels, and ours, have their center at ½, so the lens is scaled alone.
        x, y = photo.size[0] / lens[5], photo.size[1] / lens[6]
        numbers = {"w": photo.size[0], "h": photo.size[1]}
        numbers |= {"fl_x": lens[0] * x, "fl_y": lens[1] * y, "cx": lens[2] * x, "cy": lens[3] * y}
        frame = {
            "file_path": photo.path.relative_to(capture.folder).as_posix(),
            "transform_matrix": pose.tolist(),
            "sharpness": sharpness[number],
            **numbers,
            "k1": lens[4],
        }
        if photo.is_turned:
            frame["upright"] = True
        if number in rings:
            frame["ring"] = rings[number]
        if capture.masks_at:
            frame["mask_path"] = f"{capture.masks_at.name}/{mask_name(photo)}"
        frames.append(frame)
    scene = {"camera_model": "OPENCV", "made_by": MADE_BY, "pixel_error": mapped.pixel_error}
    scene["agreement"] = vars(capture.agreement)
    if capture.found:
        scene["object_box"] = capture.found.box.tolist()
    save_points(mapped.points, capture.folder)
    with whole_file(capture.folder / TRANSFORMS_FILE) as partial:
        partial.write_text(json.dumps({**scene, "frames": frames}, indent=1), encoding="utf-8")


def is_capture(folder: Path) -> bool:
    """Whether a folder's transforms.json was written here."""
    path = Path(folder) / TRANSFORMS_FILE
    try:
        with open_file(path) as file:
            return f'"made_by": "{MADE_BY}"'.encode() in file.read(HEAD)
    except OSError:
        return False


def names_masks(folder: Path) -> bool:
    """Whether a folder's transforms.json was written here and names masks."""
    if not is_capture(folder):
        return False
    try:
        scene = json.loads(read_text(Path(folder) / TRANSFORMS_FILE))
        return any("mask_path" in frame for frame in scene["frames"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):  # edited
        return False


def doubts_about(folder: Path) -> list[str]:
    """Sentences about cameras that were found here and may be wrong; none if nothing tells so."""
    if not is_capture(folder):
        return []
    try:
        scene = json.loads(read_text(Path(folder) / TRANSFORMS_FILE))
        return Agreement(**scene["agreement"]).sentences()
    except (OSError, ValueError, KeyError, TypeError, RecursionError):  # older, or edited
        return []


def summary(capture: Capture) -> str:
    """What was found, as lines for the user."""
    total = len(capture.photos) + len(capture.left_out)
    text = (
        f"The cameras of {len(capture.photos)} of {total} photographs were found, "
        f"{capture.mapped.pixel_error:.2f} pixels off in the mean, in {capture.seconds:.0f} s: "
        f"{capture.folder / TRANSFORMS_FILE}"
    )
    if capture.rings:
        text += f"\n{said_of(capture.rings)}."
        if not capture.mapped.is_on_circles:
            text += " It did not turn about one axis, so each camera was found by itself."
    if capture.program and not (capture.found and capture.found.made):
        text += (
            f"\nWhat {capture.program} takes for the object is not one thing in space, so its "
            f"masks are not used."
        )
    if capture.masks_at:
        text += (
            f"\n{said_of_masks(capture)}, in {capture.masks_at}: mend what is wrong there, or give "
            f"others by --masks."
        )
    if capture.whole:
        text += (
            "\nBy what the masks show, fewer photographs have a camera: all that the photographs "
            "show was followed."
        )
    if capture.found:
        box = " ".join(f"{value:.3g}" for value in capture.found.box.ravel())
        text += f"\nThe object's box is what the masks leave, about --aabb {box}."
    if capture.left_out:
        shown = ", ".join(capture.left_out[:NAMES_SHOWN])
        more = len(capture.left_out) - NAMES_SHOWN
        text += f"\nWithout a camera, and not used: {shown}" + (
            f" and {more} more" if more > 0 else ""
        )
    if capture.other_groups and capture.other_groups[0] >= LEAST_PHOTOS:
        text += (
            f"\n{capture.other_groups[0]} of these fit together, but not with the others: "
            f"photograph the way between in small steps, or give them a folder of their own"
        )
    for doubt in capture.agreement.sentences():
        text += f"\n{doubt}."
    for gap in gaps_of([photo.path.name for photo in capture.photos], capture.mapped.poses):
        text += f"\n{gap[0].upper()}{gap[1:]}."
    if capture.unreadable:
        text += f"\n{len(capture.unreadable)} files can't be read: {capture.unreadable[0]}"
    return text
