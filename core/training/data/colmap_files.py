"""The files of a COLMAP model, binary or text: cameras, images with poses, points.

The reader does not trust the files: it compares counts with the files' sizes before it allocates
memory.  Every error is a DatasetError of one sentence with the file's path.

    cameras   number, model, width, height, parameters
    images    number, quaternion w x y z, translation, camera's number, name, features
    points3D  number, x y z, r g b, error, track

Rotation and translation map the world to the camera, whose axes are OpenCV's.  In text files an
image has two lines; the second one, with its features, may be empty.  Newer versions also write
rigs and frames.  The reader ignores these, because images still have their own poses.
"""

import struct
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.schema import check
from .errors import DatasetError
from .posed_images import FARTHEST, rigid_pose, rotation_of

MODELS = (  # of cameras, in the order of COLMAP's numbers; and how many parameters they have
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
)
PARAMETER_COUNTS = dict(MODELS)
MOST_IMAGES = 100_000  # and as many cameras
MOST_POINTS = 10_000_000  # 240 MB
LONGEST_NAME = 4096  # bytes
LONGEST_LINE = 2**14  # bytes of it that are looked at; lists of features and tracks may be longer
BLOCK = 2**22  # bytes of points that are read at once
CAMERA, POSE = "<IiQQ", "<I7dI"
CAMERA_BYTES = struct.calcsize(CAMERA) + 2 * 8  # at least
IMAGE_BYTES, FEATURE_BYTES = struct.calcsize(POSE) + 2 + 8, 24
POINT_BYTES, TRACK_BYTES = 51, 8  # a point without its track, an element of that
IMAGE_FIELDS = "number qw qx qy qz tx ty tz camera name"


@dataclass(frozen=True)
class ColmapCamera:
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class Registered:
    """An image with a pose."""

    name: str
    camera: int
    world_to_camera: np.ndarray  # [4, 4] OpenCV's axes


def read_cameras(path: Path) -> dict[int, ColmapCamera]:
    """Cameras by number.

    Raises:
        DatasetError: The file is missing, too long, cut off, or not what it should be.
    """
    cameras = {}
    with readable(path):
        rows = binary_cameras(path) if path.suffix == ".bin" else text_cameras(path)
        for number, camera in rows:
            check(number not in cameras, f"has two cameras with the number {number}")
            cameras[number] = camera
            check(len(cameras) <= MOST_IMAGES, f"has more than {MOST_IMAGES} cameras")
            size = f"{camera.width}x{camera.height}"
            check(min(camera.width, camera.height) > 0, f"has a camera of {size} pixels")
            wanted = PARAMETER_COUNTS.get(camera.model, len(camera.parameters))
            check(
                len(camera.parameters) == wanted,
                f"has {len(camera.parameters)} parameters for camera {number}, and "
                f"{camera.model} has {wanted}",
            )
    return cameras


def read_images(path: Path) -> list[Registered]:
    """Images in the order of their names.

    Raises:
        DatasetError: As of `read_cameras`; or there is none, or two of them have one name.
    """
    images, numbers = {}, set()
    with readable(path):
        rows = binary_images(path) if path.suffix == ".bin" else text_images(path)
        for number, rigid, camera, name in rows:
            text = decoded(name)
            check(number not in numbers, f"has two images with the number {number}")
            check(text not in images, f"has two images with the name {text[:200]}")
            numbers.add(number)
            images[text] = Registered(text, camera, matrix_of(rigid, f"the pose of {text[:200]}"))
            check(len(images) <= MOST_IMAGES, f"has more than {MOST_IMAGES} images")
        check(images, "holds no registered images")
    return [images[name] for name in sorted(images)]


def read_points(path: Path):
    """Places of all points.  [n, 3] float64

    Raises:
        DatasetError: As of `read_cameras`; or a point lies beyond FARTHEST.
    """
    with readable(path):
        points = binary_points(path) if path.suffix == ".bin" else text_points(path)
        fine = bool((np.abs(points) <= FARTHEST).all())  # not so of NaN
        check(fine, f"has points that are no finite numbers, up to {FARTHEST:g}")
    return points


@contextmanager
def readable(path):
    """Turn what goes wrong into a DatasetError of one sentence that begins with the path."""
    try:
        yield
    except DatasetError as error:
        raise DatasetError(f"{path}: {error}") from None
    except OSError as error:
        raise DatasetError(f"{path} can't be read: {error.strerror or error}") from None
    except ValueError as error:
        raise DatasetError(f"{path} {error}") from None


def decoded(name: bytes) -> str:
    try:
        return name.decode()
    except UnicodeDecodeError:
        raise ValueError(f"has the name {name[:60]!r}, which is not UTF-8") from None


def matrix_of(rigid, name):
    """World to camera of a quaternion w x y z and a translation, seven numbers.  [4, 4]"""
    w, x, y, z, *translation = rigid
    return rigid_pose(np.column_stack([rotation_of((x, y, z, w), name), translation]), name)


# -- binary ------------------------------------------------------------------------------------


def count_of(stream, size, most, least_bytes, what) -> int:
    """How many records a file counts, if so many can be in it."""
    start = stream.read(8)
    check(len(start) == 8, f"is cut off: it has {len(start)} bytes")
    count = int.from_bytes(start, "little")
    check(
        count <= (size - 8) // least_bytes,
        f"is cut off or damaged: it counts {count} {what}, which take at least "
        f"{8 + count * least_bytes} bytes, and it has {size}",
    )
    check(count <= most, f"counts {count} {what}, and at most {most} are read")
    return count


def taken(stream, layout: str):
    """The next values of a binary file."""
    data = stream.read(struct.calcsize(layout))
    check(len(data) == struct.calcsize(layout), "is cut off: a record is incomplete")
    return struct.unpack(layout, data)


def check_end(position, size):
    check(
        position == size,
        f"is cut off or damaged: its records end at byte {position}, and it has {size}",
    )


def binary_cameras(path) -> Iterator[tuple[int, ColmapCamera]]:
    size = path.stat().st_size
    with open(path, "rb") as stream:
        for _ in range(count_of(stream, size, MOST_IMAGES, CAMERA_BYTES, "cameras")):
            number, model, width, height = taken(stream, CAMERA)
            check(
                0 <= model < len(MODELS),
                f"has a camera model with the number {model}, which is not known",
            )
            name, count = MODELS[model]
            yield number, ColmapCamera(name, width, height, taken(stream, f"<{count}d"))
        check_end(stream.tell(), size)


def binary_images(path):
    """Yield number, quaternion and translation, the camera's number, and the name."""
    size = path.stat().st_size
    with open(path, "rb") as stream:
        for _ in range(count_of(stream, size, MOST_IMAGES, IMAGE_BYTES, "images")):
            number, *rigid, camera = taken(stream, POSE)
            begin = stream.tell()
            name, ended, _ = stream.read(LONGEST_NAME + 1).partition(b"\0")
            check(ended, f"is cut off or damaged: the name of image {number} has no end")
            check(name, f"has no name for image {number}")
            stream.seek(begin + len(name) + 1)
            (features,) = taken(stream, "<Q")
            end = stream.tell() + features * FEATURE_BYTES
            check(
                end <= size,
                f"is cut off or damaged: image {number} counts {features} features, which end at "
                f"byte {end}, and it has {size}",
            )
            stream.seek(end)
            yield number, rigid, camera, name
        check_end(stream.tell(), size)


def binary_points(path):
    """Points have tracks of any length, so each record says where the next one begins.  [n, 3]"""
    size, length = path.stat().st_size, struct.Struct("<Q").unpack_from
    with open(path, "rb") as stream:
        count = count_of(stream, size, MOST_POINTS, POINT_BYTES, "points")
        points, done, position = np.empty((count, 3)), 0, 8
        while done < count:
            stream.seek(position)
            block = stream.read(BLOCK)
            starts, at, last = [], 0, len(block) - POINT_BYTES
            while at <= last and done + len(starts) < count:
                starts.append(at)
                at += POINT_BYTES + TRACK_BYTES * length(block, at + POINT_BYTES - 8)[0]
            check(starts, f"is cut off or damaged: it has {done} of {count} points")
            places = np.lib.stride_tricks.sliding_window_view(np.frombuffer(block, np.uint8), 24)
            found = places[np.array(starts) + 8].view("<f8")
            points[done : done + len(found)] = found
            done, position = done + len(found), position + at
        check_end(position, size)
    return points


# -- text --------------------------------------------------------------------------------------


def lines_of(path) -> Iterator[tuple[int, bytes]]:
    """Number and beginning of each line that is no comment, without what ends it."""
    number, begins = 0, True
    with open(path, "rb") as stream:
        while piece := stream.readline(LONGEST_LINE):
            check(b"\0" not in piece, "is not a text file (UTF-8)")
            if begins:
                number += 1
                text = piece.removeprefix(b"\xef\xbb\xbf") if number == 1 else piece
                if not text.lstrip().startswith(b"#"):
                    yield number, text.rstrip(b"\r\n")
            begins = piece.endswith(b"\n")


def fields_of(number, line, count, form):
    """The first fields of a line, and the rest of it; ValueError if there are fewer."""
    fields = line.split(None, count)
    check(len(line) < LONGEST_LINE - 2, f"has more than {len(line)} bytes in line {number}")
    check(len(fields) > count, f"has to have '{form}' in line {number}")
    return fields[:count], fields[count].strip()


@contextmanager
def numbers_of(number, form):
    """ValueError that names the line, if a field of it is no number."""
    try:
        yield
    except ValueError:
        raise ValueError(f"has to have '{form}' with numbers in line {number}") from None


def text_cameras(path) -> Iterator[tuple[int, ColmapCamera]]:
    form = "number model width height parameters"
    for place, line in lines_of(path):
        if not line.strip():
            continue
        (number, model, *size), rest = fields_of(place, line, 4, form)
        with numbers_of(place, form):
            width, height = map(int, size)
            parameters = tuple(map(float, rest.split()))
            row = int(number), ColmapCamera(model.decode("ascii"), width, height, parameters)
        yield row


def text_images(path):
    """Yield the same as `binary_images`.

    The line after an image's has its features.  Some programs leave it out where it would be
    empty, so a line with a name in it is an image's.
    """
    features_next = False
    for place, line in lines_of(path):
        if features_next and not names_image(line):
            features_next = False
            continue
        if not line.strip():
            continue
        (number, *rigid, camera), name = fields_of(place, line, 9, IMAGE_FIELDS)
        with numbers_of(place, IMAGE_FIELDS):
            row = int(number), list(map(float, rigid)), int(camera), name
        yield row
        features_next = True


def names_image(line) -> bool:
    """Whether a line is an image's, and no features: these are numbers by threes.

    The name of an image may be one number or two, as 0001: there are 10 fields then, or 11.
    """
    fields = line.split(None, 12)
    return len(fields) in (10, 11) or not all(map(is_number, fields[9:12]))


def is_number(field) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def text_points(path):
    found, form = array("d"), "number x y z ..."
    for place, line in lines_of(path):
        fields = line.split(None, 4)
        if not fields:
            continue
        check(len(fields) >= 4, f"has to have '{form}' in line {place}")
        with numbers_of(place, form):
            found.extend(map(float, fields[1:4]))
        check(len(found) <= 3 * MOST_POINTS, f"has more than {MOST_POINTS} points")
    return np.array(found).reshape(-1, 3)
