"""Read an .npz file, a zip of NumPy arrays, without trusting the sizes that it declares.

`open_archive` maps names to arrays.  It reads type and shape of an array from the array's header,
whose length is bounded.  The values are read only when `numpy.asarray` asks for them, so a caller
can check the shape first, and an array that is never asked for costs nothing, however large it is.

An Archive also reads entries that are no arrays, as bytes, up to a size that the caller names.

A file of n bytes may unpack to FREE_BYTES + EXPANSION · n bytes, but not to more than MAX_BYTES
or a quarter of the free memory.  Every error is a FileError of one sentence.
"""

import ast
import math
import zipfile
from collections.abc import Mapping
from contextlib import ExitStack, contextmanager
from io import BytesIO

import numpy as np

from .memory import free_bytes
from .reading import open_file
from .schema import FileError, check
from .streams import one_line

MAX_BYTES = 2**31  # unpacked; a full-size model has about 2^25
FREE_BYTES = 2**24
EXPANSION = 16  # times its size that a file may unpack to; models unpack to about twice theirs
LONGEST_READ = 2**20  # also of the zip's list of its entries, which zipfile reads at once
LONGEST_HEADER = 2**12  # ours have 118 bytes
LONGEST_REASON = 300  # characters
HEADER_KEYS = {"descr", "fortran_order", "shape"}


def unpacked_limit(file_size: int) -> int:
    """Bytes that the arrays of a file of that size may have."""
    return min(MAX_BYTES, FREE_BYTES + EXPANSION * file_size)


class StoredArray:
    """An array of an open file: its type and shape are known, `numpy.asarray` reads it."""

    def __init__(self, archive: "Archive", entry: zipfile.ZipInfo):
        self.archive, self.entry = archive, entry
        with archive.zip.open(entry) as stream:
            self.dtype, self.shape, self.fortran, self.start = _read_header(stream, entry)

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def __array__(self, dtype=None, copy=None):
        self.archive.take(self.nbytes)
        values = np.empty(self.nbytes, np.uint8)
        with self.archive.zip.open(self.entry) as stream:
            stream.read(self.start)
            _fill(values, stream)
        shape = self.shape[::-1] if self.fortran else self.shape
        values = values.view(self.dtype).reshape(shape)
        values = values.T if self.fortran else values
        return values if dtype is None else values.astype(dtype)


class Archive(Mapping):
    """The arrays of an open file by name, as StoredArray."""

    def __init__(self, zip_file: zipfile.ZipFile, file_size: int):
        self.zip = zip_file
        self.names = {entry.filename: entry for entry in zip_file.infolist()}
        check(len(self.names) == len(zip_file.infolist()), "it has two entries of one name")
        self.allowed = self.left = unpacked_limit(file_size)
        free = free_bytes()
        if free is not None:
            self.allowed = self.left = min(self.allowed, free // 4)

    def __getitem__(self, name) -> StoredArray:
        return StoredArray(self, self.names[f"{name}.npy"])

    def __contains__(self, name):
        return f"{name}.npy" in self.names

    def __iter__(self):
        return (name.removesuffix(".npy") for name in self.names)

    def __len__(self):
        return len(self.names)

    def read(self, name: str, most: int) -> bytes:
        """The bytes of the entry with that name, if it has at most so many."""
        check(name in self.names, f"it lacks '{name}'")
        entry = self.names[name]
        _check_compression(entry)
        check(entry.file_size <= most, f"'{name}' has {entry.file_size} bytes, over {most}")
        self.take(entry.file_size)
        values = bytearray(entry.file_size)
        with self.zip.open(entry) as stream:
            _fill(values, stream)
        return bytes(values)

    def take(self, byte_count: int) -> None:
        """Account for bytes that are about to be read."""
        self.left -= byte_count
        check(
            self.left >= 0,
            f"it unpacks to more than {self.allowed / 2**20:.0f} MiB, which is more than "
            "a file of its size may hold, or than this machine's memory",
        )


class _BoundedFile:
    """A file of which no single call reads much, whatever the zip's headers ask for."""

    def __init__(self, stream):
        self.stream = stream
        self.seek, self.tell, self.seekable = stream.seek, stream.tell, stream.seekable

    def read(self, count=-1):
        check(count <= LONGEST_READ, f"its list of entries takes {count} bytes")
        return self.stream.read(count if count >= 0 else LONGEST_READ)


@contextmanager
def open_archive(path, kind: str, content: bytes | None = None):
    """The arrays of a file, while it is open; what reading them raises is the caller's.

    Args:
        kind: What the file should be, for the error's sentence: "model file".
        content: All bytes of an archive inside the file at `path`, which is not read then.

    Raises:
        FileError: The file is missing, or is no zip.
    """
    check(path.exists(), f"there is no {kind} at {path}")
    with ExitStack() as stack:
        try:
            opened = open_file(path) if content is None else BytesIO(content)
            stream = stack.enter_context(opened)
            zip_file = stack.enter_context(zipfile.ZipFile(_BoundedFile(stream)))
            size = path.stat().st_size if content is None else len(content)
            arrays = Archive(zip_file, size)
        except FileError:
            raise
        except OSError as error:
            reason = error.strerror or error
            raise FileError(f"{path} can't be read as a {kind}: {reason}") from error
        except Exception as error:  # zipfile has many ways to fail
            raise FileError(f"{path} is not a {kind}, or is damaged ({error})") from error
        yield arrays


def _fill(values, stream):
    """Read bytes from a zip's entry until all values are there, in blocks."""
    for first in range(0, len(values), LONGEST_READ):
        block = memoryview(values)[first : first + LONGEST_READ]
        if stream.readinto(block) != len(block):
            raise EOFError(f"'{stream.name}' ends too early")
    stream.read(1)  # the zip's checksum is compared at the end of an entry


def _check_compression(entry):
    known = entry.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    check(known, f"'{entry.filename}' is compressed in a way that this program does not write")


def _read_header(stream, entry):
    """Type, shape, Fortran order and the values' first byte, of an array in a zip.

    NumPy's own reader takes a header of any length into memory and hands it to Python's parser.
    """
    name = entry.filename
    _check_compression(entry)
    start = stream.read(12)
    check(start[:6] == b"\x93NUMPY" and len(start) == 12, f"'{name}' is no NumPy array")
    size = 2 if start[6] == 1 else 4
    length = int.from_bytes(start[8 : 8 + size], "little")
    check(length <= LONGEST_HEADER, f"the header of '{name}' has {length} bytes")
    text = start[8 + size :] + stream.read(length - (4 - size))
    try:
        header = ast.literal_eval(text.decode().strip())
        assert header.keys() == HEADER_KEYS and type(header["descr"]) is str
        dtype, shape = np.dtype(header["descr"]), header["shape"]
        assert type(shape) is tuple and all(type(n) is int and n >= 0 for n in shape)
    except Exception as error:  # Python's parser has a dozen ways to fail
        raise FileError(f"the header of '{name}' is damaged") from error
    check(dtype.kind in "biuf", f"'{name}' is damaged: it holds {dtype}, not numbers")
    wanted, found = math.prod(shape) * dtype.itemsize, entry.file_size - 8 - size - length
    check(
        wanted == found,
        f"'{name}' declares {list(shape)}, {wanted} bytes, but the file holds {found}",
    )
    return dtype, shape, bool(header["fortran_order"]), 8 + size + length


@contextmanager
def one_sentence(path, foreseen=ValueError, kind=ValueError):
    """Turn any error in reading a file into one of a kind: one sentence with the file's path.

    Args:
        foreseen: Errors that say what is wrong; others are damage.
    """
    try:
        yield
    except MemoryError as error:
        raise kind(f"{path} needs more memory than is free") from error
    except foreseen as error:
        line = one_line(error, LONGEST_REASON + len(str(path)))
        raise kind(line if str(path) in line else f"{path}: {line}") from error
    except Exception as error:  # a file can hold anything
        raise kind(f"{path} is damaged: {one_line(error, LONGEST_REASON)}") from error
