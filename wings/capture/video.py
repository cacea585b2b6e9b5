"""A video as photographs: its sharp frames, evenly along the way of the camera.

The way is not known yet; how much the picture changes stands in for it.  So a camera that rests
gives few frames, and one that hurries gives as many as it needs.
"""

import json
import os
import tempfile
from itertools import pairwise
from pathlib import Path

import lazy_loader
import numpy as np
from PIL import Image

from ...core.base.reading import read_text
from ...core.training import sharpness_of, shrunk_size
from .hdr import check_color, is_hdr, standard
from .photos import IMAGE_SIZE, CaptureError

av = lazy_loader.load("av")  # at its first use: a viewer only asks what is_video

ENDINGS = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mts", ".3gp")
# FFmpeg's names.  Other formats may read further files, or name addresses.
FORMATS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts"
FRAMES = 100  # that are taken, if the video has as many
MOST_FRAMES = 100_000  # that are looked at: an hour
MOST_PIXELS = 40_000_000  # of a frame: 8K has 33 or 35 million
THUMBNAIL = 32  # pixels along a side of what is compared
SIDE = 480  # longer side that sharpness is measured at [pixels]
STILL = 0.5  # gray levels of 255 that noise changes a thumbnail by, from frame to frame
SOURCE = "video.json"  # in the folder of frames: which video they are of


def is_video(path: Path) -> bool:
    return path.suffix.lower() in ENDINGS and path.is_file()


def frames_folder(path: Path) -> Path:
    """The folder that a video's frames are written to."""
    return path.with_name(f"{path.stem}-frames")


def frames_of_video(path: str | Path, image_size: int = IMAGE_SIZE, count: int = FRAMES) -> Path:
    """Write a video's sharp frames, if they aren't there already; returns their folder.

    Args:
        image_size: Longer side to shrink them to [pixels].

    Raises:
        CaptureError: The video can't be read, or something else is in the folder.
    """
    from .phases import Phases  # late, as av

    path, folder = Path(path), frames_folder(Path(path))
    stat = path.stat()
    source = {"video": path.name, "bytes": stat.st_size, "time": stat.st_mtime_ns}
    if folder.exists():
        if source_of(folder) != source:
            raise CaptureError(
                f"the frames of {path} would be written to {folder}, and something else is there: "
                f"rename it, or remove it"
            )
        return folder
    prefix = f".{path.stem[:40]}-"
    with Phases() as phases, tempfile.TemporaryDirectory(prefix=prefix, dir=path.parent) as beside:
        unfinished = Path(beside) / "frames"
        unfinished.mkdir()
        try:
            with phases.phase("Looking for frames", 1) as advance:
                sharpness, way = watched(path, advance)
                chosen = chosen_frames(sharpness, way, count)
            with phases.phase("Taking frames", 1) as advance:
                write_frames(path, chosen, unfinished, image_size, advance)
        except av.error.FFmpegError as error:
            raise CaptureError(
                f"{path} has frames that can't be converted to pictures: "
                f"{error.strerror or 'unknown'}"
            ) from None
        (unfinished / SOURCE).write_text(json.dumps(source), encoding="utf-8")
        os.rename(unfinished, folder)
    return folder


def source_of(folder: Path):
    """What the folder of frames says it is of; None if it says nothing."""
    try:
        return json.loads(read_text(folder / SOURCE))
    except (OSError, ValueError, RecursionError):
        return None


def frames_of(path: Path, advance):
    """Yield the video's frames; `advance` is told the share that is done.

    Raises:
        CaptureError: There is no video in the file, or it is damaged from its beginning.
    """
    options = {"format_whitelist": FORMATS, "protocol_whitelist": "file"}
    number = -1
    try:
        # What the file says of itself may be in any encoding.
        with av.open(str(path), options=options, metadata_errors="replace") as container:
            if not container.streams.video:
                raise CaptureError(f"{path} holds no video")
            stream = container.streams.video[0]
            if stream.codec_context is None:
                raise CaptureError(f"{path} holds a video in a format that FFmpeg doesn't know")
            if stream.width * stream.height > MOST_PIXELS:
                raise CaptureError(f"{path} has {stream.width}x{stream.height} pixels: too many")
            stream.thread_type = "AUTO"
            seconds = (container.duration or 0) / av.time_base
            for number, frame in enumerate(container.decode(stream)):
                if number >= MOST_FRAMES:
                    break
                if seconds and frame.time is not None:
                    advance(min(1.0, frame.time / seconds))
                yield frame
    except (av.error.FFmpegError, IndexError) as error:  # PyAV knows no stream that begins later
        if number < 0:  # else what was decoded is used: the file is cut off
            reason = getattr(error, "strerror", None) or "it is damaged"
            raise CaptureError(f"{path} can't be read as a video: {reason}") from None


def watched(path: Path, advance):
    """Look at all frames: the sharpness of each, and the way until it.  [n] each"""
    sharpness, steps, before = [], [], None
    for frame in frames_of(path, advance):
        check_color(path, frame)
        scale = min(1.0, SIDE / max(frame.width, frame.height))
        size = [max(2, round(scale * side)) for side in (frame.width, frame.height)]
        gray = frame.reformat(*size, "gray").to_ndarray()
        small = Image.fromarray(gray).resize((THUMBNAIL, THUMBNAIL), Image.Resampling.BOX)
        thumbnail = np.asarray(small, np.float32)
        thumbnail -= thumbnail.mean()  # exposure that changes is no way
        steps.append(0.0 if before is None else float(np.abs(thumbnail - before).mean()))
        sharpness.append(sharpness_of(gray))
        before = thumbnail
    return np.array(sharpness), np.cumsum(np.maximum(np.array(steps) - STILL, 0.0))


def chosen_frames(sharpness, way, count: int) -> list[int]:
    """The sharpest frame of each of `count` equal stretches of the way, by number.

    Args:
        sharpness: Of each frame.  [n]
        way: How far it is from the first; ascending.  [n]
    """
    if len(way) <= count:
        return list(range(len(way)))
    if way[-1] <= 0.0:  # nothing moves
        way = np.arange(len(way), dtype=float)
    bounds = np.searchsorted(way, np.linspace(0.0, way[-1], count + 1)[1:-1])
    stretches = [(a, b) for a, b in pairwise([0, *bounds.tolist(), len(way)]) if a < b]
    return [a + int(np.argmax(sharpness[a:b])) for a, b in stretches]


def write_frames(path: Path, chosen, folder: Path, image_size: int, advance):
    """Write the chosen frames, upright, as JPEG files."""
    wanted = set(chosen)
    for number, frame in enumerate(frames_of(path, advance)):
        if number not in wanted:
            continue
        if is_hdr(frame):
            pixels = standard(frame, shrunk_size((frame.width, frame.height), image_size))
        else:
            pixels = frame.to_ndarray(format="rgb24")
        # FFmpeg's angle is that of a counterclockwise turn, as NumPy's.
        pixels = np.rot90(pixels, round(frame.rotation / 90))
        image = Image.fromarray(np.ascontiguousarray(pixels))
        if max(image.size) > image_size:
            image = image.resize(shrunk_size(image.size, image_size), Image.Resampling.BOX)
        image.save(folder / f"{number:06d}.jpg", quality=95, subsampling=0)
        if number == chosen[-1]:
            return
