"""The arrays of a model file, read without trust in its contents.

`read_arrays` checks the sizes in the zip's own headers first, so that a small file cannot
unpack to gigabytes; `array` checks an array's name, type, shape and finiteness.  Every error
is a ModelFileError of one sentence.
"""

import math
import zipfile
import zlib

import numpy as np

MESH_ARRAYS = ("rest_vertices", "addresses", "tets", "occupancy")
TABLE_ARRAYS = ("table_", "reached_", "scale_")
MAX_BYTES = 2**31  # unpacked; a full-size model has about 2^25
# Errors of zipfile and NumPy on damaged files; RuntimeError is for encrypted ones.
UNREADABLE = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    ValueError,
    KeyError,
    MemoryError,
    RuntimeError,
)


class ModelFileError(ValueError):
    """A model file cannot be read; the message is one sentence for the user."""


def read_arrays(path) -> dict:
    """All arrays of a file by name."""
    check(path.is_file(), f"there is no model file at {path}")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
            check(
                size <= MAX_BYTES,
                f"{path} would unpack to {size / 2**30:.1f} GiB; models have less than "
                f"{MAX_BYTES / 2**30:.0f} GiB",
            )
            for entry in archive.infolist():
                _check_header(archive, entry)
        with np.load(path, allow_pickle=False) as archive:
            named = "meta" in archive.files
            check(named, f"{path} is not a deformrf model: it has no 'meta' array")
            return {name: archive[name] for name in archive.files}
    except ModelFileError:
        raise
    except UNREADABLE as error:
        raise ModelFileError(f"{path} is not a model file, or is damaged ({error})") from error


def parts_of_file(path) -> dict:
    """Bytes of a model's mesh (occupancy included) and of its tables, as stored."""
    parts = {"mesh_bytes": 0, "table_bytes": 0}
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            name = entry.filename.removesuffix(".npy")
            if name in MESH_ARRAYS:
                parts["mesh_bytes"] += entry.compress_size
            elif name.startswith(TABLE_ARRAYS):
                parts["table_bytes"] += entry.compress_size
    return parts


def check(condition, sentence):
    if not condition:
        raise ModelFileError(sentence)


def array(arrays, name, dtypes, shape):
    """The named array of that type (or one of a tuple) and shape; None there is any length."""
    dtypes = dtypes if isinstance(dtypes, tuple) else (dtypes,)
    check(name in arrays, f"the array '{name}' is missing")
    found = arrays[name]
    fits = found.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, found.shape, strict=True)
    )
    check(
        found.dtype in dtypes and fits,
        f"'{name}' is {found.dtype} {list(found.shape)}, "
        f"it should be {' or '.join(str(np.dtype(t)) for t in dtypes)} "
        f"{['any' if s is None else s for s in shape]}",
    )
    if found.dtype.kind == "f":
        check(np.isfinite(found).all(), f"'{name}' holds NaN or infinite values")
    return found


def _check_header(archive, entry):
    """Refuse an array whose header declares more than the zip holds."""
    with archive.open(entry) as stream:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0}.get(
            version, np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = read(stream)
    check(
        math.prod(shape) * dtype.itemsize <= entry.file_size,
        f"'{entry.filename}' declares {shape}, more than the file holds",
    )
