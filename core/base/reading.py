"""Open a file that somebody else wrote, if it is a regular file within a size limit.

Reading a pipe that nobody writes to would wait for ever, and reading a device might never end.
Every error is an OSError with `strerror` and `filename`, which a command prints as one sentence.
"""

import errno
import os
from pathlib import Path

from .paths import kind_of

LARGEST_TEXT = 64 * 2**20  # bytes of a file that is read as a whole, where nothing else is said


def check_file(path, most: int | None = None) -> int:
    """The size of a file [bytes]; for libraries that open a path themselves.

    Raises:
        OSError: It is missing, no regular file, or larger than `most` bytes.
    """
    path = Path(path)
    size = path.stat().st_size
    if not path.is_file():
        raise OSError(errno.EINVAL, f"it is {kind_of(path)}, not a file", str(path))
    if most is not None and size > most:
        raise _too_large(path, most)
    return size


def open_file(path, most: int | None = None):
    """A file as a binary stream; raises what `check_file` does.

    Whatever takes the file's place after the check is not waited for.
    """
    check_file(path, most)
    return open(path, "rb", opener=_without_waiting)


def read_bytes(path, most: int = LARGEST_TEXT) -> bytes:
    """All bytes of a file; raises what `check_file` does."""
    with open_file(path, most) as stream:
        content = stream.read(most + 1)  # files of /proc have no size
    if len(content) > most:
        raise _too_large(path, most)
    return content


def read_text(path, most: int = LARGEST_TEXT) -> str:
    """All of a text file in UTF-8, with or without a byte order mark.

    Raises:
        UnicodeDecodeError: It is no such text; besides, what `check_file` raises.
    """
    return read_bytes(path, most).decode("utf-8-sig")


def _without_waiting(path, flags):
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _too_large(path, most):
    size = f"{most / 2**20:.0f} MiB" if most >= 2**20 else f"{most} bytes"
    return OSError(errno.EFBIG, f"it is larger than {size}, the most that is read", str(path))
