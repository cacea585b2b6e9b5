"""The error of a model file; the bytes of its mesh and its tables."""

import zipfile
from pathlib import Path

from ..base.schema import FileError

MESH_ARRAYS = ("rest_vertices", "addresses", "tets", "occupancy")
TABLE_ARRAYS = ("table_", "reached_", "scale_")


class ModelFileError(FileError):
    """A model file cannot be read; the message is one sentence for the user."""


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
