"""Start Python processes without importing modules from the current folder.

`python -c` and `python -m` import from the current folder first, and so does a PYTHONPATH with an
empty entry or a dot.  In a folder of downloaded files they would run that folder's numpy.py.  So
`start` passes -P and a PYTHONPATH of the folders from which this process imports, without the
current one.  The child therefore imports the same package as this process.
"""

import os
import sys

PACKAGE = __package__.removesuffix(".core.base")
ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", ".."))  # of the package
NOT_HERE = "import sys; sys.path[:] = filter(None, sys.path); "  # as -P, for code alone
SAME_PACKAGE = f"""
import sys, types
sys.modules[{PACKAGE!r}] = types.ModuleType({PACKAGE!r})
sys.modules[{PACKAGE!r}].__path__ = [{ROOT!r}]
"""


def start(code: str, *arguments: str, **options):
    """A Python that runs code with arguments, as a subprocess.Popen.

    Args:
        options: Of subprocess.Popen.

    Raises:
        OSError: The process can't be started.
    """
    import subprocess  # a start of the viewer does without it

    folders = [f for f in _without_current(sys.path) if os.path.isabs(f) and os.pathsep not in f]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    command = [sys.executable, "-P", "-c", SAME_PACKAGE + code, *arguments]
    return subprocess.Popen(command, env=environment, **options)


def forget_current_folder() -> None:
    """Import nothing from the current folder from now on, other than this package."""
    folders = _without_current(sys.path)
    if len(folders) < len(sys.path):
        sys.modules[PACKAGE].__path__ = [ROOT]  # it may lie there
        sys.path[:] = folders


def _without_current(folders: list[str]) -> list[str]:
    """The folders of sys.path without the current one, unless somebody chose it.

    A user chose what PYTHONPATH names by its whole path: packages may be installed there.  What
    Python itself and its packages are installed in comes from its standard library on.
    """
    library = os.path.dirname(os.__file__)
    begin = folders.index(library) if library in folders else len(folders)
    chosen = {os.path.realpath(f) for f in _named() if os.path.isabs(f)}
    here = {_START, _working_folder()} - chosen
    return [f for f in folders[:begin] if os.path.realpath(f) not in here] + folders[begin:]


def _named() -> list[str]:
    """The folders of the user's PYTHONPATH, as they stand there."""
    if sys.flags.ignore_environment:
        return []
    return os.environ.get("PYTHONPATH", "").split(os.pathsep)


def _working_folder() -> str | None:
    try:
        return os.path.realpath(os.getcwd())
    except OSError:  # it was deleted
        return None


_START = _working_folder()  # `python -m` has its path in sys.path, also when it is left
