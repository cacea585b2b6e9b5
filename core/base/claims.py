"""Claim the files that this process will write, so that a second process can't claim them.

A claim locks one byte of a file in the user's state folder; a hash of the claimed path gives the
byte's place.  The system frees the lock when the process ends, even after a crash, and no lock file
lies beside the user's files.  Without a state folder, or without locks, nothing is claimed.
"""

import hashlib
import os
from pathlib import Path

import platformdirs

from .paths import target_of

PLACES = 2**40  # bytes that can be locked; the file itself is empty
_opened: list[int] = []  # the file of this process: closing any of it would free all claims


def claim(path: Path) -> None:
    """Let no other process of this user write to a path until `release` or the process's end.

    Raises:
        ValueError: One does.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        return
    if os.environ.get("RANK", "0") != "0":  # torchrun's further processes write nothing
        return
    name = os.fsencode(os.path.realpath(target_of(path)))
    place = int.from_bytes(hashlib.sha256(name).digest()[:8], "little") % PLACES
    try:
        if not _opened:
            _opened.append(_open())
        fcntl.lockf(_opened[0], fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
    except (BlockingIOError, PermissionError) as error:
        if _opened:
            raise ValueError(
                f"{path} is being written by another process: wait for its end, or give another "
                f"name"
            ) from error
    except OSError:  # no folder, or no locks in it
        pass


def release() -> None:
    """The work is done: others may write."""
    while _opened:
        os.close(_opened.pop())


def _open() -> int:
    folder = platformdirs.user_state_path("deformrf")
    if not folder.is_absolute():
        raise FileNotFoundError("there is no home")
    folder.mkdir(parents=True, exist_ok=True)
    return os.open(folder / "writing", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
