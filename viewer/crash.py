"""Crash reports: what a user can attach to a report of a fault, beside the log.

A report has the program's versions and devices, the traceback, and the names of the last events.
It has no contents of files, and folders are left out of paths.
"""

import logging
import platform
import re
import sys
import time
import traceback
from collections import deque
from importlib import metadata
from pathlib import Path

from platformdirs import user_log_path

from ..core.base.paths import ROOT, free_name, program_version

PACKAGES = ("warp-lang", "torch", "moderngl", "pyglet", "imgui-bundle", "av", "numpy", "pillow")
LAST = 200  # events
FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"
FOLDERS = re.compile(r"(?:[A-Za-z]:)?(?:[\\/][^\\/\s\"':]+)+[\\/]")  # of an absolute path


class Recent(logging.Handler):
    """Keeps the last records of all modules, also those that are shown nowhere."""

    def __init__(self):
        super().__init__()
        self.records = deque(maxlen=LAST)
        self.setFormatter(logging.Formatter(FORMAT))

    def emit(self, record):
        self.records.append(record)

    def lines(self) -> list[str]:
        return [self.format(record) for record in self.records]


def begin_logging(program: str, verbose: bool) -> Recent:
    """Show warnings of all modules on stderr, or with `verbose` everything that they note."""
    shown = logging.StreamHandler()
    shown.setLevel(logging.DEBUG if verbose else logging.WARNING)
    shown.setFormatter(logging.Formatter(f"{program}: %(message)s"))
    recent = Recent()
    for handler in (shown, recent):
        logging.getLogger().addHandler(handler)
    logging.getLogger("deformrf").setLevel(logging.DEBUG)
    return recent


def write_report(program: str, error: BaseException, recent: Recent) -> Path | None:
    """Write a report into the folder of logs; None if that is impossible."""
    try:
        folder = user_log_path("deformrf", ensure_exists=True)
        path = free_name(folder / f"crash-{time.strftime('%Y%m%d-%H%M%S')}", ".txt")
        path.write_text(report(program, error, recent), encoding="utf-8", errors="backslashreplace")
    except OSError:
        return None
    return path


def report(program: str, error: BaseException, recent: Recent) -> str:
    lines = [f"{program} {program_version()}", f"Python {platform.python_version()}"]
    versions = (f"{package} {version_of(package)}" for package in PACKAGES)
    lines += [platform.platform(), *versions, *_devices(), "", "Traceback"]
    lines += "".join(traceback.format_exception(error)).splitlines()
    lines += ["", f"The last {len(recent.records)} events", *recent.lines()]
    return "\n".join(map(without_folders, lines)) + "\n"


def without_folders(line: str) -> str:
    """A line with paths of the program from its own folder on, and names of other files."""
    return FOLDERS.sub(lambda _: "", line.replace(str(ROOT), "deformrf"))


def version_of(package: str) -> str:
    """Which version of a package is installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "is missing"


def _devices():
    """What Warp found, if it was started; the program that failed starts nothing."""
    warp = sys.modules.get("warp")
    try:
        return [f"{device.alias}: {device.name}" for device in warp.get_devices()] if warp else []
    except Exception as error:  # whatever is wrong with it
        return [f"devices: {error}"]
