"""A film for a phone by a hand in a real window: the fox gets eight poses, and a film in 9:16.

    python tests/benchmarks/film_by_hand.py [-o folder] [--size 1280x800] [--limit 90]

The viewer with the bundled fox is in a window on a screen of its own (Xvfb, xdotool).  The hand
goes to the task Animate, takes the tool that poses bones, keys eight joints at eight times, and
asks for a film of the timeline at 1080x1920.  Prints how long that took, with and without the
rests of the hand.  The film has to have that size and to move; the session that was saved has to
bring another window to the same pose, to the bit.  Exits with 1 if that isn't so.
"""

import argparse
import shutil
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
from PIL import Image

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
import rig_hand as hand
from clicking.hand import Hand, Tally
from clicking.widgets import choose
from xwindow import missing_tools, screen

from deformrf.core.base.paths import BUNDLED
from deformrf.viewer.films import SIZES

SIZE, MOVED = "1080x1920", 24  # of the film; a color that has changed
STEP = 24  # ticks between two poses
POSES = (  # bones, and the way their tips are dragged [points]
    *((6, (0, -45)), (5, (-20, 30)), (15, (30, -60)), (9, (-45, -20))),
    *((13, (-10, -40)), (12, (40, -25)), (23, (-40, -15)), (19, (40, -15))),
)
PATIENCE = 3600.0  # s for the film


def pose(viewer, folder):
    """Eight joints at eight times."""
    viewer.press("Animate##animate")
    viewer.press("##bones")
    hand.key(viewer, "3")  # from the right
    viewer.press("Key both")
    for number, (bone, way) in enumerate(POSES, 1):
        hand.scrub(viewer, STEP * number)
        hand.drag_joint(viewer, bone, way)
        assert viewer.state()["undoes"] == "pose a bone", f"bone {bone} is not posed"
        viewer.press("Key both")
        viewer.wait(lambda n=number: _pose_keys(viewer) == n + 1, 20, f"bone {bone} has its key")
        picture(viewer, folder, f"pose-{number}")


def _pose_keys(viewer):
    return len(viewer.next_state()["keyed"]["pose"])


def ask_for_film(viewer):
    """In the task Film: of the timeline, in 9:16; until it is being rendered."""
    viewer.press("Film##film")
    viewer.press("Make a film...")
    viewer.press("The timeline")
    assert choose(viewer, viewer.item("##size", "combo"), SIZES.index(SIZE))
    chosen = viewer.next_state()["values"]["film"]
    assert (chosen["size"], chosen["what"]) == (SIZE, "timeline"), chosen
    viewer.press("Render")
    viewer.wait(lambda: viewer.next_state()["films"], 20, "the film has begun")


def picture(viewer, folder, name):
    pixels = viewer.pixels()[: viewer.size[1], : viewer.size[0]]
    Image.fromarray(pixels.copy()).save(folder / f"{name}.png")


def looked_at(path) -> list[str]:
    """What is wrong with the film."""
    with av.open(str(path)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    height, width = frames[0].shape[:2]
    looks = [frame[::4, ::4].astype(int) for frame in frames[::6]]
    moved = [(abs(b - a) > MOVED).any(axis=-1).mean() for a, b in pairwise(looks)]
    shares = f"{100 * min(moved):.2f} to {100 * max(moved):.2f} % of the pixels move in 6"
    print(f"film: {len(frames)} frames of {width}x{height}; {shares}")
    wrong = [] if f"{width}x{height}" == SIZE else [f"the film is {width}x{height}"]
    return wrong + ["the film stands still"] * bool(np.median(moved) < 0.002)


def filmed(start, folder, limit) -> list[str]:
    """All of it; returns what is wrong."""
    viewer = start("first")
    begun, viewer.rested = time.monotonic(), 0.0
    pose(viewer, folder)
    posed = time.monotonic() - begun
    ask_for_film(viewer)
    taken = time.monotonic() - begun
    print(f"{taken:.1f} s until the film begins, {taken - viewer.rested:.1f} s without rests;")
    print(f"  {len(POSES)} joints are posed and keyed after {posed:.1f} s")
    picture(viewer, folder, "rendering")
    viewer.wait(lambda: not viewer.next_state()["films"], PATIENCE, "the film is made")
    path = viewer.folder / viewer.events("written")[-1]["path"]
    print(f"  the film was made in {time.monotonic() - begun - taken:.0f} s")
    session = viewer.folder / hand.written(viewer, "export session", 2)
    viewer.check("film", "end")
    before = viewer.next_state()["pose"]
    viewer.end()
    wrong = looked_at(path) + [f"the hand took more than {limit:g} s"] * (taken > limit)
    after = start("second", "--session", str(session)).next_state()["pose"]
    print(f"played again: the pose is {'the same' if after == before else 'another one'}")
    wrong += ["the session ends in another pose"] * (after != before)
    shutil.copy(path, folder / "film.mp4")
    shutil.copy(session, folder / "film.jsonl")
    return wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, help="a folder for the film and pictures")
    parser.add_argument("--size", default="1280x800", help="of the window")
    parser.add_argument("--limit", type=float, default=90.0, help="s until the film begins")
    chosen = parser.parse_args()
    if missing_tools():
        parser.exit(2, f"it needs {' and '.join(missing_tools())}\n")
    tally, made = Tally(), []
    size = tuple(map(int, chosen.size.split("x")))
    with tempfile.TemporaryDirectory() as folder, screen(Path(folder), "1400x900") as display:
        output = chosen.output or Path(folder, "output")
        output.mkdir(parents=True, exist_ok=True)

        def start(name, *arguments):
            own = Path(folder, name)
            own.mkdir()
            made.append(Hand(display, BUNDLED["fox"], own, size, tally, *arguments))
            return made[-1]

        try:
            wrong = filmed(start, output, chosen.limit)
        finally:
            for viewer in made:
                viewer.end()
    wrong += [sentence for *_, sentence in tally.wrong]
    for sentence in wrong:
        print(f"wrong: {sentence}")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
