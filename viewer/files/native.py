"""The system's own dialogs for files, where there are any: they are asked in each frame."""

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

HELPERS = "zenity", "kdialog", "qarma", "matedialog"  # on Linux, programs that show them


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
