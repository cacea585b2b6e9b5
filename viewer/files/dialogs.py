"""What a dialog shows and does, without drawing: the choice of a file, and a problem.

Where the system has dialogs of its own for files, these are asked in each frame instead.
"""

import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

MOST_SHOWN = 2000  # entries of a folder
HELPERS = "zenity", "kdialog", "qarma", "matedialog"  # on Linux, programs that show them


@dataclass(frozen=True)
class Problem:
    """Something that went wrong, in a sentence; the log has more, if there is one."""

    title: str
    sentence: str
    log_file: Path | None = None


def readable(name) -> str:
    """A path, or text that has one, as it can be shown: what isn't UTF-8 in a name becomes "?"."""
    return str(name).encode("utf-8", "replace").decode()


class FileDialog:
    """The choice of a file in the folders of this machine, or of the name of a new one."""

    def __init__(
        self, title: str, folder: Path, endings: tuple[str, ...], chosen: Callable, name=""
    ):
        """Begin in a folder; `chosen` is called with the path of a file of these endings.

        Args:
            name: What a new file is called at first; without one, files that exist are chosen.
                `chosen` returns a sentence then if it can't be written.
        """
        self.title, self.endings = title, endings
        self.name = name
        self._chosen, self._replaces = chosen, None  # a file that is there: asked about
        self.problem = ""  # of the last choice
        self.entries: list[tuple[str, bool]] = []  # name, and whether it is a folder
        self.folder = Path(folder).absolute()
        self.text = ""  # the path that is typed
        self.enter(self.folder)

    def enter(self, folder: Path) -> None:
        """Show another folder, if it can be read."""
        try:
            with os.scandir(folder) as found:  # which knows kinds; to ask for each takes ten times
                entries = [(entry.name, _is_folder(entry)) for entry in found]
        except OSError as error:
            self.problem = f"can't read {folder}: {error.strerror or error}"
            return
        self.problem = ""
        self.folder = folder
        self.text = readable(folder / self.name)
        shown = [
            (name, is_folder)
            for name, is_folder in entries
            if not name.startswith(".") and (is_folder or name.lower().endswith(self.endings))
        ]
        shown.sort(key=lambda entry: (not entry[1], entry[0].lower()))
        self.entries = shown[:MOST_SHOWN]

    def typed(self) -> Path:
        """The path that the text means; the folder's own text need not be its name.

        Blanks alone are no name: they mean the folder, as an empty text does.
        """
        if self.text == readable(self.folder / self.name):
            return self.folder / self.name
        return Path(self.text if self.text.strip() else "")

    def choose(self, path: Path) -> bool:
        """Enter a folder, or take a file; whether the dialog is done."""
        try:
            path = (self.folder / path.expanduser()).absolute()
        except RuntimeError as error:  # ~ of nobody
            self.problem = str(error)
            return False
        if os.path.isdir(path):  # unlike Path's own, no name is an error
            self.enter(Path(os.path.normpath(path)))
            return False
        if self.name:
            return self._save(path)
        if not os.path.isfile(path):
            self.problem = f"there is no file {path}"
            return False
        self._chosen(path)
        return True

    def _save(self, path):
        """Take the name of a new file; one that is there is asked about."""
        if path.suffix.lower() not in self.endings:
            path = path.with_name(path.name + self.endings[0])
        if os.path.lexists(path) and path != self._replaces:
            self._replaces = path
            self.text = readable(path)
            self.problem = f"{path.name} is there already: once more replaces it"
            return False
        self.problem = self._chosen(path)
        return not self.problem


def _is_folder(entry):
    try:
        return entry.is_dir()
    except OSError:
        return False


def has_native_dialogs() -> bool:
    """Whether this machine can show them."""
    return sys.platform in ("win32", "darwin") or any(map(shutil.which, HELPERS))


class NativeDialog:
    """A dialog of the system that is open; `chosen` is called with the path."""

    def __init__(self, title: str, start: Path, endings: tuple[str, ...], saves, chosen: Callable):
        """Show it.  `start` is a folder, or the name that a new file would have."""
        from imgui_bundle import portable_file_dialogs as dialogs

        filters = ["deformrf", " ".join(f"*{ending}" for ending in endings), "all files", "*"]
        show = dialogs.save_file if saves else dialogs.open_file
        self._shown = show(title, os.fspath(start), filters)
        self._chosen = chosen

    def follow(self) -> bool:
        """Take the answer if there is one; whether it goes on."""
        if not self._shown.ready(0):
            return True
        result = self._shown.result()
        path = result if isinstance(result, str) else "".join(result[:1])
        if path:
            self._chosen(Path(path))
        return False
