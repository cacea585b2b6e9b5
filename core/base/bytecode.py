"""The user's folder of compiled Python modules, for places where Python keeps none.

Containers often forbid Python to write bytecode beside modules (PYTHONDONTWRITEBYTECODE), and
install packages without any.  Then each start compiles hundreds of modules: 2.2 s of 5 on an
H100's host.  What is kept here is bytecode of the user's own, as compiled kernels are.
"""

import importlib.util
import os
import shutil
import stat
import sys
from pathlib import Path

import platformdirs

LARGE = "warp"  # a package whose modules take long to compile
ROOM = 64 * 2**20  # bytes that a folder needs: Python may leave half a file on a full disk


def keep(folder: Path | None = None) -> None:
    """Let Python keep bytecode in a folder, the user's cache by default, if it keeps none else.

    Nothing changes where the package that takes longest has its bytecode, where Python can write
    it beside the modules, or where the user said what to do (PYTHONPYCACHEPREFIX, python -B).
    A folder that others own or can write to is not used: whoever fills it chooses what runs here.
    As beside modules, Python compares the time and the size of a source before it takes bytecode.
    """
    if _is_said() or not _is_compiled_each_time(LARGE):
        return
    try:
        folder = folder or platformdirs.user_cache_path("deformrf") / "bytecode"
        if not folder.is_absolute():  # there is no home
            return
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        free = shutil.disk_usage(folder).free
        mine = _is_only_mine(folder) and _is_only_mine(folder.parent)
    except (OSError, RuntimeError):
        return
    if mine and free >= ROOM:
        sys.pycache_prefix, sys.dont_write_bytecode = os.fspath(folder), False


def _is_said() -> bool:
    """Whether the user chose a folder, or an option of Python that forbids bytecode."""
    forbidden = sys.flags.dont_write_bytecode and not os.environ.get("PYTHONDONTWRITEBYTECODE")
    return bool(forbidden) or sys.pycache_prefix is not None


def _is_only_mine(folder: Path) -> bool:
    """Whether it is a folder, no link, that nobody else can write to; on POSIX alone."""
    status = folder.lstat()
    if not hasattr(os, "geteuid"):
        return True
    others = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not others


def _is_compiled_each_time(package: str) -> bool:
    """Whether a package has no bytecode, and Python will not keep any beside it."""
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return False
    if spec is None or not spec.cached or Path(spec.cached).exists():
        return False
    beside = Path(spec.cached).parent
    beside = beside if beside.exists() else beside.parent
    return sys.dont_write_bytecode or not os.access(beside, os.W_OK)
