"""A pose for films from a file of vertices, in model units."""

import zipfile
import zlib
from pathlib import Path

import numpy as np

from ...core.base.reading import check_file
from ..document import FARTHEST_POINT

NAME = "vertices"  # of the array in an .npz file
KINDS = "<f4", "<f8"
UNREADABLE = (  # RuntimeError: of a password; NotImplementedError: of a method of compression
    *(KeyError, EOFError, ValueError, RuntimeError, NotImplementedError),
    *(zipfile.BadZipFile, zlib.error),
)


class PoseError(ValueError):
    """A file has no pose of the model; the message is one sentence."""


def load_vertices(path: Path, count: int):
    """The vertices of a file: .npy, or .npz with an array "vertices".  [count, 3] float32

    Raises:
        PoseError: It has no such numbers.
        OSError: It can't be read.
    """
    check_file(path)
    if path.suffix not in (".npz", ".npy"):
        raise PoseError(f"{path}: a pose is in a file .npy, .npz or .jsonl")
    try:
        if path.suffix == ".npz":
            with zipfile.ZipFile(path) as archive, archive.open(f"{NAME}.npy") as stream:
                vertices = _read(stream, count)
        else:
            with open(path, "rb") as stream:
                vertices = _read(stream, count)
    except UNREADABLE as error:
        raise PoseError(f"{path} has no pose of {count} vertices ({error})") from error
    if not (np.isfinite(vertices).all() and abs(vertices).max() <= FARTHEST_POINT):
        raise PoseError(f"{path} has vertices farther than {FARTHEST_POINT:g}, or no numbers")
    return vertices.astype(np.float32)


def _read(stream, count):
    """The array of a stream; its header is checked before memory is taken."""
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise ValueError(f"its format {version} is another one")
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(stream)
    if shape != (count, 3) or dtype.str not in KINDS:
        raise ValueError(f"it has {shape} of {dtype}")
    size = 3 * count * dtype.itemsize
    data = stream.read(size)
    if len(data) < size:
        raise ValueError("it ends too soon")
    return np.frombuffer(data, dtype).reshape(shape, order="F" if by_columns else "C")
