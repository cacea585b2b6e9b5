"""Type the lines of README, one after another, in an empty environment with an empty HOME.

    python tests/support/readme_lines.py [--python python3.13] [--wheel WHEEL] [--train]

git clones the last commit of this checkout where README names the project's address.  A window
closes after a few frames.  Without --train, `pip install .` stands for `pip install ".[all]"`,
toy.npz is a bundled model, and the commands that train and report have to name the extra that they
lack.  With it, they run with the quickest preset.  With --wheel, there is no clone.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from xwindow import screen

ROOT = Path(__file__).resolve().parents[2]
BLOCK, PROGRAM = r"^```\n(.*?)^```$", r"^```python\n(.*?)^```$"
LINES = re.compile(rf"{BLOCK}|{PROGRAM}|`((?:deformrf|make) [^`]+)`", re.M | re.S)
ADDRESS = re.compile(r"https://\S+\.git")
FRAMES = 3  # of a window, and of a film that is only to begin
NEED_EXTRAS = "deformrf train", "deformrf report"
# pip cannot reach an index.
NO_INDEX = re.compile("NewConnectionError|ConnectTimeout|NameResolutionError|ProxyError|SSLError")
LACKS = re.compile(r'is not installed: pip install ".*\[(train|report)\]"')
# Runs a line in the folder, and with the variables, that the line before has left.
SHELL = """
source "$STATE"
eval "$LINE"
code=$?
{ printf 'cd %q\\n' "$PWD"; declare -px PATH VIRTUAL_ENV 2>/dev/null; } > "$STATE"
exit $code
"""


class Typed(NamedTuple):
    """A line as README has it, what was typed, its exit code, all that it printed, seconds."""

    line: str
    typed: str
    code: int
    printed: str
    seconds: float

    def is_right(self, trains: bool) -> bool:
        """Whether it did its work or, without the extras, said in one sentence which it lacks."""
        lacks = self.code == 2 and LACKS.search(self.printed)
        return self.code == 0 if trains or not self.line.startswith(NEED_EXTRAS) else bool(lacks)


def lines_of(page: str) -> list[str]:
    """What README has one type, in its order; the program in Python as a line of the shell."""
    found = []
    for block, program, inline in LINES.findall(page):
        lines = [line.partition(" #")[0].strip() for line in block.splitlines()]
        found += lines or [inline or f"python -c '{program}'"]
    return [line for line in found if line]


def typed_line(line: str, wheel: Path | None, trains: bool) -> str:
    """The line with what the hand at the keyboard chooses."""
    what = str(wheel or ".") + ("[all]" if trains else "")
    if line.startswith("git clone") and wheel:
        return "mkdir deformrf && cd deformrf"
    if line.startswith("pip install"):
        copied = "cp .venv/lib/python3*/site-packages/deformrf/assets/helmet.npz toy.npz"
        return f'pip install "{what}"' + ("" if trains else f" && {copied}")
    if line.startswith("make") and wheel:
        return "true"
    if line.startswith("deformrf view" if trains else ("deformrf view", "deformrf render")):
        return f"{line} --frames {FRAMES}"
    if line.startswith("deformrf train") and "--check" not in line:
        return f"{line} --preset tiny"
    return f"{line} --quick" if line.startswith("deformrf report") else line


def type_all(folder: Path, python: str, wheel: Path | None = None, trains: bool = False):
    """Yield each line of README as it ends.

    Args:
        folder: Empty; for HOME and the clone.
        python: What `python3` is.
    """
    page = (ROOT / "README.md").read_text("utf-8")
    for name in ("home", "bin", "screen"):
        (folder / name).mkdir()
    (folder / "bin" / "python3").symlink_to(shutil.which(python))
    state = folder / "state"
    state.write_text(f"cd {folder}\n")
    dropped = "PYTHON", "XDG_", "WARP_", "VIRTUAL_ENV", "WAYLAND_DISPLAY", "DEFORMRF_"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(dropped)}
    with screen(folder / "screen") as (display, _):
        env = kept | {
            "HOME": str(folder / "home"),
            "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
            "STATE": str(state),
            "DISPLAY": display,
            "PIP_CONSTRAINT": str(ROOT / "constraints.txt"),
            "PIP_RETRIES": "1",
            "PIP_CONFIG_FILE": str(Path.home() / ".config/pip/pip.conf"),  # the way to an index
            "GIT_CONFIG_COUNT": "1",
            "GIT_CONFIG_KEY_0": f"url.{ROOT.as_uri()}.insteadOf",
            "GIT_CONFIG_VALUE_0": ADDRESS.search(page)[0],
        }
        for line in lines_of(page):
            typed = typed_line(line, wheel, trains)
            ends_alone = {"DISPLAY": ""} if line.startswith("make") else {}
            began = time.monotonic()
            done = subprocess.run(
                ["bash", "-c", SHELL],
                env=env | ends_alone | {"LINE": typed},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
            )
            printed = done.stdout.decode("utf-8", "replace")
            yield Typed(line, typed, done.returncode, printed, time.monotonic() - began)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--wheel", type=Path)
    parser.add_argument("--train", action="store_true")
    given = parser.parse_args()
    wheel = given.wheel and given.wheel.resolve()
    with tempfile.TemporaryDirectory() as folder:
        for one in type_all(Path(folder), given.python, wheel, given.train):
            print(f"{one.seconds:6.1f} s  {one.code:3}  {one.typed.splitlines()[0]}", flush=True)
            if not one.is_right(given.train):
                print(one.printed)
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
