"""A pose that doesn't move, for films: from a file of vertices, or the end of a session."""

import zipfile
import zlib
from pathlib import Path

import numpy as np

from ...core.base.reading import check_file
from ..document import FARTHEST_POINT, Player, load_session, play_patiently

NAME = "vertices"  # of the array in an .npz file
KINDS = "<f4", "<f8"
UNREADABLE = (  # RuntimeError: of a password; NotImplementedError: of a method of compression
    *(KeyError, EOFError, ValueError, RuntimeError, NotImplementedError),
    *(zipfile.BadZipFile, zlib.error),
)


class PoseError(ValueError):
    """A file has no pose of the model; the message is one sentence."""


def strike(scene, path: Path, playing=Player) -> None:
    """Bring a scene at rest into the pose of a file, and let go of it.

    Args:
        path: Of a session (.jsonl), whose last pose it is, seen as there; or of an array [V, 3]
            of numbers in model units, .npy or .npz with an array "vertices".
        playing: Makes a Player of a scene and a session.

    Raises:
        ValueError: The file has no pose of this model (SessionError, PoseError).
        OSError: It can't be read.
    """
    path = Path(path)
    check_file(path)
    if path.suffix == ".jsonl":
        session = load_session(path, scene.field)
        play_patiently(playing(scene, session), session.ticks)
        scene.handles.release()
        scene.end_push()
    else:
        vertices = load_vertices(path, scene.field.mesh.vertex_count)
        scene.solver.set_state(vertices, np.zeros_like(vertices))
    scene.look(0.0)


def load_vertices(path: Path, count: int):
    """The vertices of a file.  [count, 3] float32"""
    try:
        if path.suffix == ".npz":
            with zipfile.ZipFile(path) as archive, archive.open(f"{NAME}.npy") as stream:
                vertices = _read(stream, count)
        elif path.suffix == ".npy":
            with open(path, "rb") as stream:
                vertices = _read(stream, count)
        else:
            raise PoseError(f"{path}: a pose is in a file .npy, .npz or .jsonl")
    except UNREADABLE as error:
        if isinstance(error, PoseError):
            raise
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
