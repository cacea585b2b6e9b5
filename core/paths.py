"""Folders of shaders and assets, the program's version, and the writing of files."""

import errno
import os
import secrets
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent  # the checkout, or site-packages/deformrf
SHADERS = ROOT / "shaders"
ASSETS = ROOT / "assets"
DEFAULT_MODEL = ASSETS / "helmet.npz"


def program_version() -> str:
    """The version of this program, installed or in a checkout."""
    import tomllib
    from importlib import metadata

    try:
        return metadata.version("deformrf")
    except metadata.PackageNotFoundError:
        project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        return tomllib.loads(project)["project"]["version"]


def working_folder() -> Path:
    """The current folder; the user's own one if that was deleted."""
    try:
        return Path.cwd()
    except FileNotFoundError:
        return Path.home()


def free_name(stem: Path, ending: str) -> Path:
    """The first path of <stem>[-2, -3 ..]<ending> at which nothing is."""
    path, count = stem.with_name(stem.name + ending), 1
    while os.path.lexists(path):
        count += 1
        path = stem.with_name(f"{stem.name}-{count}{ending}")
    return path


@contextmanager
def whole_file(path: Path):
    """Yield a path to write to beside `path`; rename the file if the block ends without error.

    So a full disk, an interrupt or a power failure leaves an older file as it was.  The path is
    a free name, which ends as `path` does, so nobody else's file is overwritten.
    """
    with whole_files([path]) as (partial,):
        yield partial


@contextmanager
def whole_files(paths, replaced=()):
    """The same for several files: none is renamed before all are on the disk.

    Files in `replaced`, of which none may stand beside the new ones, are removed in between.
    """
    paths, partials = [Path(path) for path in paths], []
    try:
        for path in paths:
            partials.append(reserved(path))
        yield partials
        for path, partial in zip(paths, partials, strict=True):
            sync(partial)
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        for path in replaced:
            path.unlink(missing_ok=True)
        for path, partial in zip(paths, partials, strict=True):
            os.replace(partial, path)
        for folder in {path.parent for path in paths}:
            sync(folder)
    except OSError as error:
        for path, partial in zip(paths, partials, strict=False):
            if error.filename in (str(partial), partial):  # a name that no user knows
                error.filename, error.filename2 = str(path), None
        raise
    finally:
        for partial in partials:
            partial.unlink(missing_ok=True)


def reserved(path: Path) -> Path:
    """A new empty file beside `path`, to be renamed to it: .<stem>-<random>.part<ending>."""
    for _ in range(100):
        # A long name would become too long with what is added.
        name = f".{path.stem[:40]}-{secrets.token_hex(4)}.part{path.suffix}"
        partial = path.with_name(name)
        try:
            os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            return partial
        except FileExistsError:
            continue
        except OSError as error:
            error.filename = str(path)
            raise
    raise FileExistsError(errno.EEXIST, "no name is free beside it", str(path))


def sync(path: Path) -> None:
    """Have the system write a file or a folder's names to the disk.

    Raises:
        OSError: A file can't be written.  Of folders, which some systems can't do this for,
            errors are passed over.
    """
    folder = path.is_dir()
    try:
        descriptor = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    except OSError:
        if folder:
            return
        raise
    try:
        os.fsync(descriptor)
    except OSError as error:
        # EINVAL: what a link leads to is no file on a disk.
        if not folder and error.errno != errno.EINVAL:
            raise
    finally:
        os.close(descriptor)
