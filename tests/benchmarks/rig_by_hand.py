"""A fox that is rigged by a hand in a real X window: eight joints, two poses, a clip, a film.

    python tests/benchmarks/rig_by_hand.py fox.npz -o folder

The model is one of the fox of the data set foxrig, seen from its right, with the nose to the
left.  The mouse clicks as a person's does (tests/support/rig_hand.py).  Writes the model with its
rig, the session, pictures of the window and film.mp4 into the folder, and prints how long the
hand took.
"""

import argparse
import shutil
import subprocess
import sys
import time
from pathlib import Path

import rig_hand as hand
from PIL import Image
from xwindow import LiveViewer, screen

SIZE = 1000, 700  # points
SPINE = (545, 300), (400, 295), (312, 252), (236, 283)  # hips, chest, head, nose
TAIL = (545, 300), (612, 306), (682, 362), (757, 421)  # from the hips again
LEG = (400, 295), (388, 470)  # from the chest again
TAIL_TIP, NOSE = 5, 2  # bones
POSES = (  # tick, and how far the hand drags the tips of bones [points]
    (60, {TAIL_TIP: (-20, -190), NOSE: (20, -60)}),
    (120, {TAIL_TIP: (10, 230), NOSE: (0, 90)}),
)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    chosen = parser.parse_args()
    folder = chosen.output.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "screen").mkdir(parents=True)
    with screen(folder / "screen") as display:
        size = f"{SIZE[0]}x{SIZE[1]}"
        viewer = LiveViewer(display, chosen.model.resolve(), folder, "--size", size)
        try:
            files = rig(viewer, folder)
        finally:
            viewer.end()
    code = "import sys; from deformrf.commands.render import main; sys.exit(main())"
    film = "--hide-handles", "-o", folder / "film.mp4", "--size", "640x480", "--frames", "120"
    arguments = folder / files["ctrl+s"], "--clip", "clip 1", *film
    subprocess.run([sys.executable, "-c", code, *map(str, arguments)], check=True)


def rig(viewer, folder):
    """Make joints, poses and a clip; the files that were written."""

    def picture(name):
        viewer.wait(lambda: viewer.next_state()["refined"] == 1, 120, "the picture is refined")
        time.sleep(1.0)
        pixels = viewer.pixels()[: SIZE[1], : SIZE[0]]
        Image.fromarray(pixels.copy()).save(folder / f"{name}.png")

    begin = time.monotonic()
    viewer.move(700, 650)
    for name in ("Tab", "h", "3"):  # no panel and no red points; from the right
        hand.key(viewer, name)
    viewer.wait(lambda: viewer.next_state()["refined"] == 1, 60, "the picture is refined")
    hand.take(viewer, "joints", "j")
    for chain in (SPINE, TAIL, LEG):
        hand.place_joints(viewer, chain)
    print(f"{len(viewer.events('joint'))} joints after {time.monotonic() - begin:.0f} s")
    picture("joints")
    hand.take(viewer, "bones", "a")
    hand.key(viewer, "shift+a")
    hand.key(viewer, "shift+k")
    for tick, drags in POSES:
        hand.scrub(viewer, tick)
        for bone, way in drags.items():
            hand.drag_joint(viewer, bone, way)
        hand.key(viewer, "shift+k")
    print(f"three poses are keyed after {time.monotonic() - begin:.0f} s")
    picture("bent")
    hand.key(viewer, "Tab")
    hand.key(viewer, "shift+c")
    files = {name: hand.written(viewer, name, k + 1) for k, name in enumerate(("ctrl+shift+s",))}
    files["ctrl+s"] = hand.written(viewer, "ctrl+s", 2)
    picture("window")
    return files


if __name__ == "__main__":
    main()
