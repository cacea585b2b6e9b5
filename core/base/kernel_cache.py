"""Give Warp a cache folder for compiled kernels that is writable and has no damaged files.

Warp compiles a module of kernels once and keeps its files in a folder.  The linker may crash on
damaged files, so `start` makes Warp compare files with checksums before it loads them.  If Warp
can't write its folder, `start` chooses another one.  Before Warp looks for a module that is shipped
compiled, its files are copied into the cache.
"""

import atexit
import functools
import json
import logging
import os
import shutil
import tempfile
import threading
import zlib
from collections.abc import Callable
from pathlib import Path

import platformdirs

from . import shipped_kernels
from .paths import WriteError, whole_file
from .streams import printable

SUMS = "deformrf-sums.json"  # in a module's folder: checksums by file name
SPACE = 64 * 2**20  # bytes that a folder needs; Warp's compiler ends the process on a full disk

log = logging.getLogger(__name__)
_moving = threading.Lock()
_temporary: list[Path] = []  # folders of this process


def start(init: Callable[[], None]) -> None:
    """Initialize Warp by `init`, and guard its cache from now on."""
    import warp as wp

    try:
        init()
    except OSError as error:  # the folder can't be made
        moved = _move(Path(wp.config.kernel_cache_dir), error.strerror or str(error))
        init()
        wp.config.kernel_cache_dir = os.fspath(moved)  # Warp added a folder of its version
    if not hasattr(wp.Module.load, "__wrapped__"):
        wp.Module.load = _guarded(wp.Module.load)


def problem(folder: Path) -> str:
    """Why no kernels can be written to a folder; empty if they can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return error.strerror or str(error)
    return "" if free >= SPACE else f"{free / 2**20:.0f} MiB are free, {SPACE >> 20} are needed"


def _guarded(load):
    """Warp's Module.load, with files that are compared first, and mended or moved."""

    @functools.wraps(load)
    def guarded(module, device, block_dim=None, binary_path=None, *rest, **named):
        import warp as wp

        device = wp.get_device(device)
        block_dim = module.options["block_dim"] if block_dim is None else block_dim
        arguments = (device, block_dim, binary_path, *rest)
        if binary_path or (device.context, block_dim) in module.execs:
            return load(module, *arguments, **named)
        module.get_module_hash(block_dim)
        name = module.get_module_identifier(block_dim)
        folder = _ready(name)
        shipped_kernels.unpack(module, device, block_dim, folder)
        cached = folder.exists()
        try:
            loaded = load(module, *arguments, **named)
        except Exception as error:
            if cached:
                _discard(folder)
                folder = _ready(name)
            elif why := _error(error) or problem(folder.parent):
                folder = _move(folder.parent, why) / name
            else:
                raise
            module.mark_modified()  # it keeps the error otherwise
            loaded = load(module, *arguments, **named)
        if _known(folder) != (sums := _sums(folder)):
            _write(folder, sums)
        return loaded

    return guarded


def _error(error):
    return (error.strerror or str(error)) if isinstance(error, OSError) else ""


def _ready(name: str) -> Path:
    """The folder of a module: whole, or absent where it can be written."""
    folder = _folder() / name
    if folder.exists() and _damaged(folder):
        _discard(folder)
    if not folder.exists() and (why := problem(folder.parent)):
        folder = _move(folder.parent, why) / name
    return folder


def _folder() -> Path:
    import warp as wp

    return Path(wp.config.kernel_cache_dir)


def _damaged(folder: Path) -> bool:
    """Whether a file isn't as it was when it was first loaded; those not yet loaded are good."""
    known, now = _known(folder), _sums(folder)
    return known is None or any(known.get(name, total) != total for name, total in now.items())


def _sums(folder: Path) -> dict[str, int]:
    try:
        files = [path for path in sorted(folder.iterdir()) if path.name != SUMS]
        return {path.name: zlib.crc32(path.read_bytes()) for path in files if path.is_file()}
    except OSError:  # it was deleted meanwhile, or can't be read
        return {}


def _known(folder: Path) -> dict | None:
    """The checksums that were written; empty if none were, None if they are damaged."""
    try:
        known = json.loads((folder / SUMS).read_bytes())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError):
        return None
    return known if isinstance(known, dict) else None


def _write(folder: Path, sums: dict[str, int]) -> None:
    try:
        with whole_file(folder / SUMS) as partial:
            partial.write_text(json.dumps(sums), encoding="utf-8")
    except OSError:
        pass  # a cache that others made, and that is only read


def _discard(folder: Path) -> None:
    """Delete a damaged module, or leave the folder if that is impossible."""
    log.warning("compiled kernels in %s are damaged; they are compiled anew", printable(folder))
    try:
        shutil.rmtree(folder)
    except FileNotFoundError:
        pass
    except OSError as error:
        _move(folder.parent, error.strerror or str(error))


def remove_temporary() -> None:
    """Remove the folders that are not kept, as the end of Python does."""
    for folder in _temporary:
        shutil.rmtree(folder, ignore_errors=True)


def _temporary_folder(old: Path) -> Path:
    try:
        return Path(tempfile.mkdtemp(prefix="deformrf-kernels-"))
    except OSError as error:
        sentence = "compiled kernels need a folder: name one in WARP_CACHE_PATH, or in TMPDIR"
        raise WriteError(error.errno, sentence, str(old)) from error


def _move(old: Path, why: str) -> Path:
    """Give Warp a folder of our own, kept if possible, else until the end of this process."""
    import warp as wp

    with _moving:
        if _folder() != old:
            return _folder()  # another thread was first
        kept = platformdirs.user_state_path("deformrf") / "kernels" / wp.config.version
        if kept == old or problem(kept):
            kept = _temporary_folder(old)
            _temporary.append(kept)
            atexit.register(remove_temporary)
        log.warning("kernels can't be kept in %s (%s): %s has them", printable(old), why, kept)
        wp.config.kernel_cache_dir = os.fspath(kept)
        return kept
