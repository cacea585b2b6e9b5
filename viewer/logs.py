"""The log file: what went wrong, with tracebacks, in the user's folder of logs."""

import logging
import platform
import sys
from logging.handlers import RotatingFileHandler
from pathlib import Path

from platformdirs import user_log_path

from ..core.base.paths import program_version

LARGEST, OLDER = 2**20, 2  # bytes of a file, and how many full ones are kept
FORMAT = "%(asctime)s %(process)d %(levelname)s %(name)s: %(message)s"

log = logging.getLogger(__name__)


def file() -> Path:
    """Where this user's log is."""
    return user_log_path("deformrf") / "viewer.log"


def start(path: Path) -> Path | None:
    """Write warnings and errors of all modules there from now on; None if that is impossible."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        text = {"encoding": "utf-8", "errors": "backslashreplace"}  # of names that aren't UTF-8
        handler = RotatingFileHandler(path, maxBytes=LARGEST, backupCount=OLDER, **text)
    except OSError as error:
        log.warning("there will be no log in %s: %s", path, error.strerror or error)
        return None
    handler.setFormatter(logging.Formatter(FORMAT))
    handler.setLevel(logging.INFO)
    logging.getLogger().addHandler(handler)
    # The root logger passes warnings on; these lines begin what each run writes.
    system = f"Python {platform.python_version()}, {platform.platform()}"
    line = f"deformrf {program_version()}, {system}: {' '.join(sys.argv)}"
    handler.handle(log.makeRecord(log.name, logging.INFO, __file__, 0, line, (), None))
    return path


def note(error: BaseException) -> None:
    """Write an error with its traceback into the file, and not to stderr, where Python will."""
    trace = type(error), error, error.__traceback__
    record = log.makeRecord(log.name, logging.ERROR, __file__, 0, "the viewer ends", (), trace)
    for handler in _handlers():
        handler.handle(record)


def stop() -> None:
    """Write no further."""
    for handler in _handlers():
        logging.getLogger().removeHandler(handler)
        handler.close()


def _handlers():
    return [h for h in logging.getLogger().handlers if isinstance(h, RotatingFileHandler)]


def sentence(error: BaseException) -> str:
    """What a dialog says of an error that no one expected."""
    return f"{type(error).__name__}: {error}".rstrip(": ")
