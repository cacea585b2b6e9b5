"""README's picture: the viewer's window on the bundled model while a vertex is dragged.

    python tests/benchmarks/viewer_picture.py [--out docs/figures/viewer.png]

Starts a screen with Xvfb, drives the window with xdotool as tests/test_window.py does, and saves
the screen once the bent object is shown in full resolution.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from deformrf.core import paths

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from test_window import Session  # noqa: E402

SIZE = (1200, 800)
WAY = (120, 50)  # pixels that the highest vertex is dragged by


def start_screen(folder):
    """The server's process and its display's name."""
    reading, writing = os.pipe()
    width, height = SIZE
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", f"{width}x{height}x24"]
    command += ["-noreset", "-fbdir", str(folder)]
    server = subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as stream:
        return server, ":" + stream.readline().strip()


def take_picture(session):
    """Drag the highest vertex and wait for the image in full."""
    highest = min(session.state()["vertices"], key=lambda vertex: vertex["at"][1])
    session.drag(highest["at"], WAY, release=False)
    session.wait(lambda: session.state()["refined"] == 1, 120, "the image is refined")
    session.next_state()
    return Image.fromarray(session.pixels())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures" / "viewer.png")
    out = parser.parse_args().out
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        server, display = start_screen(folder)
        try:
            screen = display, folder / "Xvfb_screen0"
            size = "x".join(map(str, SIZE))
            session = Session(screen, paths.DEFAULT_MODEL, folder, "--size", size)
            try:
                take_picture(session).save(out, optimize=True)
            finally:
                session.end()
        finally:
            server.terminate()
            server.wait()
    print(f"wrote {out}")


if __name__ == "__main__":
    main()
