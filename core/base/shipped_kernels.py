"""Unpack compiled kernels that are shipped, so that a first start on a usual GPU compiles none.

`assets/kernels` has an archive for each GPU architecture and version of Warp.  It contains, for
each compiled module, the files that Warp would write, in a folder named by the module's hash.  The
hash covers sources, constants and options.  So kernels that have changed are not found, and Warp
compiles them, as it does on every other architecture.  `make kernels` writes the archives.
"""

import io
import logging
import tarfile
import threading
from functools import lru_cache
from pathlib import Path

from .paths import ASSETS, reserved

FOLDER = ASSETS / "kernels"
MOST_BYTES = 2**25  # that an archive unpacks to; ours take a fifteenth

log = logging.getLogger(__name__)
_reading = threading.Lock()


def archive_path(architecture: int) -> Path:
    """The archive of an architecture (90 for sm_90) for this version of Warp."""
    import warp as wp

    return FOLDER / f"warp-{wp.__version__}-sm{architecture}.tar.xz"


def has(module, device, block_dim: int) -> bool:
    """Whether a Warp module is shipped, as it is now, for a device."""
    return module.get_module_hash(block_dim).hex() in _modules(device)


def unpack(module, device, block_dim: int, folder: Path) -> None:
    """Put a module's files into its folder of Warp's cache, unless it has a binary there.

    If nothing is shipped, or a file can't be written, Warp compiles the module.
    """
    if device.is_cpu or any(folder.glob(f"*.sm{device.arch}.cubin")):
        return  # later starts read no archive
    files = _modules(device).get(module.get_module_hash(block_dim).hex(), {})
    missing = [name for name in sorted(files) if not (folder / name).exists()]
    try:
        if missing:
            folder.mkdir(parents=True, exist_ok=True)
        for name in missing:  # the binary last
            partial = reserved(folder / name)  # checksums tell later if the disk lost some
            try:
                partial.write_bytes(files[name])
                partial.replace(folder / name)
            finally:
                partial.unlink(missing_ok=True)
    except OSError:
        pass


def _modules(device) -> dict[str, dict[str, bytes]]:
    """The shipped modules' files for a device, by the modules' hashes and the files' names."""
    if device.is_cpu:
        return {}
    with _reading:  # once, though modules load side by side
        return read(archive_path(device.arch))


@lru_cache
def read(path: Path) -> dict[str, dict[str, bytes]]:
    """An archive's files, by the modules' hashes and the files' names; none if it is damaged."""
    try:
        import lzma  # some builds of Python lack it

        packed = io.BytesIO(path.read_bytes())
        with lzma.open(packed) as stream:
            unpacked = stream.read(MOST_BYTES)
        modules = {}
        with tarfile.open(fileobj=io.BytesIO(unpacked), mode="r:") as archive:
            for member in archive:
                key, name = Path(member.name).parts
                modules.setdefault(key, {})[name] = archive.extractfile(member).read()
    except FileNotFoundError:
        return {}
    except Exception as error:  # tarfile and lzma have many ways to fail
        log.warning("shipped kernels in %s can't be read (%s): they are compiled", path, error)
        return {}
    return modules
