"""Folders of shaders and assets, the program's version, and the writing of files."""

import os
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

    So a full disk or an interrupt leaves an older file as it was.
    """
    partial = path.with_name(path.name + ".part")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
