"""A hand that uses all that a window shows, wrongly, too: menus, widgets, dialogs, the end.

    python tests/benchmarks/every_widget.py [--size 1280x800 780x480] [--part menus dialogs]

The viewer with the bundled fox is in a real window on a screen of its own (Xvfb, xdotool).  Each
entry of each menu is clicked on; each button, box, list, slider and field of the five tasks is
used, with texts that are no numbers; each dialog gets paths that can't be; it is quit in each
state.  After each step the process lives, its log has no error, no panel failed, and all values
are finite.  Prints what was tried, how often, and what went wrong; exits with 1 if anything did.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from clicking.dialogs import every_dialog
from clicking.ends import every_end
from clicking.hand import Gone, Hand, Tally
from clicking.menus import every_entry
from clicking.widgets import every_widget
from xwindow import missing_tools, screen

from deformrf.core.base.paths import BUNDLED

PARTS = {
    "menus": every_entry,
    "widgets": every_widget,
    "dialogs": every_dialog,
    "ends": every_end,
}
SIZES = "1280x800", "780x480"
SCREEN = "1400x900"


class Starter:
    """Starts viewers, one after another, each with a folder of its own."""

    def __init__(self, display, folder, size, tally):
        self._display, self._folder, self._size, self._tally = display, folder, size, tally
        self.hand = None

    def __call__(self, old=None, same=False):
        """Another window, in the place of an old one; in the same folder to find what was left."""
        self.end()
        folder = old.folder if same else Path(tempfile.mkdtemp(dir=self._folder))
        model = BUNDLED["fox"]
        self.hand = Hand(self._display, model, folder, self._size, self._tally)
        return self.hand

    def end(self):
        if self.hand is not None:
            self.hand.end()


def lines_of(tally) -> list[str]:
    """The table, and what went wrong."""
    parts = {}
    for (part, what), count in tally.counts.items():
        parts.setdefault(part, []).append(f"{count} {what}")
    lines = []
    for part, told in parts.items():
        wrong = sum(one[0] == part for one in tally.wrong)
        lines.append(f"{part}: {', '.join(told)}; {wrong} wrong")
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", nargs="+", default=SIZES, help="of the window")
    parser.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--pictures", type=Path, help="a folder for pictures of what went wrong")
    arguments = parser.parse_args()
    if missing_tools():
        parser.exit(2, f"it needs {' and '.join(missing_tools())}\n")
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="every-widget-") as folder:
        folder = Path(folder)
        home = folder / "home"
        home.mkdir()
        # Compiled kernels stay where they are.
        os.environ.setdefault("XDG_CACHE_HOME", str(Path.home() / ".cache"))
        os.environ["HOME"] = str(home)
        with screen(folder, SCREEN) as display:
            for size in arguments.size:
                wrong += _tried(display, folder, size, arguments)
    sys.exit(wrong > 0)


def _tried(display, folder, size, arguments) -> int:
    """All parts in a window of a size; how often something went wrong."""
    tally, begun = Tally(arguments.pictures), time.monotonic()
    for part in arguments.part:
        starter = Starter(display, folder, tuple(map(int, size.split("x"))), tally)
        try:
            PARTS[part](starter(), starter)
        except (Gone, TimeoutError, AssertionError) as error:
            tally.note(part, "start", f"{type(error).__name__}: {error}")
        finally:
            starter.end()
    print(f"window of {size}, {time.monotonic() - begun:.0f} s")
    for line in lines_of(tally):
        print(f"  {line}")
    return len(tally.wrong)


if __name__ == "__main__":
    main()
