"""Open a model file as a dictionary of arrays; count the bytes of its mesh and its tables."""

import zipfile
from contextlib import contextmanager
from pathlib import Path

from ..base.archive import open_archive
from ..base.schema import FileError, check

MESH_ARRAYS = ("rest_vertices", "addresses", "tets", "occupancy")
TABLE_ARRAYS = ("table_", "reached_", "scale_")


class ModelFileError(FileError):
    """A model file cannot be read; the message is one sentence for the user."""


@contextmanager
def open_arrays(path):
    """The arrays of a model file, while it is open.

    Raises:
        ModelFileError: The file is missing, is no zip with an entry `meta.npy`, or an array
            that was asked for is damaged.
    """
    try:
        with open_archive(path, "model file") as arrays:
            check("meta" in arrays, "it is not a deformrf model: it has no 'meta' array")
            yield arrays
    except FileError as error:
        raise ModelFileError(str(error)) from error


def bytes_of_file(path: str | Path) -> dict[str, int]:
    """Bytes of a model's mesh (occupancy included) and of its tables, as stored."""
    counts = {"mesh_bytes": 0, "table_bytes": 0}
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            name = entry.filename.removesuffix(".npy")
            if name in MESH_ARRAYS:
                counts["mesh_bytes"] += entry.compress_size
            elif name.startswith(TABLE_ARRAYS):
                counts["table_bytes"] += entry.compress_size
    return counts
