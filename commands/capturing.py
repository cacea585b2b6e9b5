"""Photographs without cameras as a command's data: the cameras are found first."""

import sys
import time
from pathlib import Path

from ..core import training
from ..core.base.device import Choice
from ..core.base.streams import printable
from ..wings import capture
from .running import is_first

# Files of cameras that other programs write: LLFF, Metashape, Bundler, Meshroom, OpenSfM, NeuS.
UNREAD = (
    "poses_bounds.npy",
    "cameras.xml",
    "bundle.out",
    "cameras.sfm",
    "reconstruction.json",
    "cameras_sphere.npz",
)
WAIT_SECONDS = 1.0  # of further processes, between looks for the first one's result


def needs_cameras(data: Path) -> bool:
    """Whether this is a folder of photographs, or a video, that no file says the cameras of.

    Raises:
        DatasetError: The cameras lie deeper in the folder than they are read from.
    """
    if capture.is_video(data):
        data = capture.frames_folder(data)
        return not data.is_dir() or not training.has_cameras(data)
    if not data.is_dir() or training.has_cameras(data):
        return False
    if not training.photo_files(data):
        training.check_place(data)
    return bool(training.photo_folder(data))


def prepared(
    data: Path,
    output: Path,
    image_size: int | None,
    masks: Path | None = None,
    mask_with: str | None = None,
    device: Choice = "auto",
) -> tuple[Path, int | None]:
    """Find the cameras of photographs, if no file has them.

    Args:
        output: The model to be written; unfinished work is kept beside it, as in MODEL.capture.
        masks: The user's folder of masks.
        mask_with: The user's program that makes them while cameras are found.
        image_size: The user's; without one, captures are worked at capture.IMAGE_SIZE.

    Returns:
        The folder of the data set, and the longer side to shrink images to; None for none.

    Raises:
        ValueError: The photographs don't fit together, or the like; a sentence for the user.
    """
    is_new, is_video = needs_cameras(data), capture.is_video(data)
    work, side = output.with_suffix(".capture"), image_size or capture.IMAGE_SIZE
    if is_new and is_first():
        photos = capture.frames_of_video(data, side) if is_video else data
        program = capture.program_words(mask_with) if mask_with else ()
        found_by(photos, work, side, is_video, masks, program, device=device)
    elif is_first():
        if mask_with:
            say_not_masked(capture.frames_folder(data) if is_video else data)
        capture.remove_left(work, capture.frames_folder(data) if is_video else data)
    while is_new and needs_cameras(data):  # torchrun ends this process if the first one fails
        time.sleep(WAIT_SECONDS)
    if is_video:
        data = capture.frames_folder(data)
    if image_size is None and capture.is_capture(data):
        image_size = capture.IMAGE_SIZE
    return data, image_size


def check_masks(masks: Path | None, mask_with: str | None):
    """Raise a ValueError if masks are both given and to be made, or their program is not there."""
    if mask_with is None:
        return
    if masks is not None:
        raise ValueError("--masks and --mask-with exclude one another: give one of them")
    capture.program_words(mask_with)


def say_not_masked(data: Path):
    """Say that the masks are there already; a ValueError if they are not, though cameras are."""
    if capture.names_masks(data):
        print(f"The masks of {printable(data)} are there: --mask-with is not used.", flush=True)
        return
    way = "make masks by the program, and give their folder with --masks"
    if capture.is_capture(data):
        way += f", or remove {data / 'transforms.json'}"
    raise ValueError(
        f"--mask-with makes masks while cameras are found, and {data} has its cameras: {way}"
    )


def found_by(
    data: Path,
    work: Path,
    image_size: int,
    is_sequence: bool,
    masks: Path | None = None,
    program: tuple[str, ...] = (),
    device: Choice = "auto",
):
    """Find the cameras, and say what was found; after Ctrl-C, how to go on."""
    place = None
    if unread := next((name for name in UNREAD if (data / name).is_file()), None):
        print(
            f"{printable(data / unread)} may have the photographs' cameras, but is not read: to "
            f"use them, export COLMAP's files (sparse/0/) or a transforms.json.",
            flush=True,
        )

    photos_at = training.photo_folder(data)
    if photos_at and (said := training.about_raw_files(photos_at)):
        print(f"{printable(said)}.", flush=True)

    def on_work(folder, again):
        nonlocal place
        place = folder
        known = "going on with the work in" if again else "unfinished work is kept in"
        other = "" if folder == work else f" ({printable(work)} holds something else)"
        print(
            f"No file in {printable(data)} has the photographs' cameras: they are found first, at "
            f"{image_size} pixels (--image-size); {known} {printable(folder)}{other}.",
            flush=True,
        )

    try:
        found = capture.find_cameras(
            data, work, image_size, is_sequence, on_work, masks, program, device=device
        )
    except KeyboardInterrupt:
        if place is not None:
            print(
                f"What was found so far is in {printable(place)}: the same command goes on there.",
                file=sys.stderr,
            )
        raise
    for line in capture.summary(found).splitlines():
        print(printable(line), flush=True)
