"""Paths of shaders and assets, the program's version, and functions that write files."""

import errno
import os
import secrets
import stat
from contextlib import contextmanager, suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]  # the checkout, or site-packages/deformrf
SHADERS = ROOT / "shaders"
ASSETS = ROOT / "assets"
BUNDLED = {name: ASSETS / f"{name}.npz" for name in ("helmet", "fox")}  # models
PROJECT = ".deformrf"  # the ending of a project's name
DEFAULT_MODEL = BUNDLED["helmet"]


def is_project(path: Path) -> bool:
    """Whether a path names a project: model, session and looks in one file."""
    return path.suffix.lower() == PROJECT


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


class WriteError(OSError):
    """A file can't be written; its text is a sentence for the user."""

    def __str__(self):
        return f"can't write {self.filename}: {self.strerror}"


@contextmanager
def whole_file(path: Path):
    """Yield a path to write to beside `path`; rename the file if the block ends without error.

    So a full disk, an interrupt or a power failure leaves an older file as it was.  The path is
    a free name, which ends as `path` does, so nobody else's file is overwritten.  The new file
    has the older one's permissions; a link stays, and the file behind it is replaced.

    Raises:
        WriteError: Any OSError of the block, or of what comes before and after it.
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
        targets = [target_of(path) for path in paths]
        for target in targets:
            partials.append(reserved(target))
        yield partials
        for target, partial in zip(targets, partials, strict=True):
            sync(partial)
            target_of(target)  # what stands there now
            take_permissions(partial, target)
        for path in replaced:
            path.unlink(missing_ok=True)
        for target, partial in zip(targets, partials, strict=True):
            os.replace(partial, target)
        for folder in {target.parent for target in targets}:
            sync(folder)
    except OSError as error:
        named = paths[0] if error.filename is None else Path(os.fsdecode(error.filename))
        for path, partial in zip(paths, partials, strict=False):
            named = path if named == partial else named  # a name that no user knows
        raise WriteError(error.errno, error.strerror or str(error), str(named)) from error
    finally:
        for partial in partials:
            discard(partial)


def target_of(path: Path) -> Path:
    """The file that is written if one writes to a path: itself, or what its links lead to.

    Raises:
        OSError: Links lead in a circle, or there is something else than a file.
    """
    path = Path(path)
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    if target.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, f"it is {kind_of(target)}, not a file", str(path))
    return target


def kind_of(path: Path) -> str:
    """What is at a path, in words."""
    words = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    return words.get(stat.S_IFMT(os.stat(path).st_mode), "a device")


def reserved(target: Path) -> Path:
    """A new empty file beside `target`, to be renamed to it: .<stem>-<random>.part<ending>.

    Nobody can read it who can't read a file that is at `target` already.
    """
    mode = 0o600 if target.exists() else 0o666
    for _ in range(100):
        # A long name would become too long with what is added.
        name = f".{target.stem[:40]}-{secrets.token_hex(4)}.part{target.suffix}"
        partial = target.with_name(name)
        try:
            os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))
            take_permissions(partial, target)
            return partial
        except FileExistsError:
            continue
        except BaseException as error:  # an interrupt, too, leaves nothing
            with suppress(OSError):
                discard(partial)
            if isinstance(error, OSError):
                error.filename = str(target)
            raise
    raise FileExistsError(errno.EEXIST, "no name is free beside it", str(target))


def discard(partial: Path) -> None:
    """Remove a file that may be gone already, though an interrupt comes just then."""
    try:
        partial.unlink(missing_ok=True)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def take_permissions(partial: Path, target: Path) -> None:
    """Give a file the permissions of the one that it will replace, if there is one."""
    try:
        os.chmod(partial, stat.S_IMODE(os.stat(target).st_mode))
    except OSError:  # there is none, or the file system knows no permissions
        pass


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
