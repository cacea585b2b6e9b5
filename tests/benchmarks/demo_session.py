"""The session of the clip in docs/window.md: assets/demo.jsonl, made by a hand that follows a plan.

    python tests/benchmarks/demo_session.py [--out assets/demo.jsonl]
    deformrf render --session assets/demo.jsonl --size 480x360 --fps 15 --samples 4 \\
        -o docs/figures/demo.webp

The head is dragged aside and let go, selected points are turned and come back, the camera goes
around meanwhile.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from deformrf.core.base import paths
from deformrf.core.base.device import start_warp
from deformrf.core.field import modelfile
from deformrf.viewer.document import save_session, start_of
from deformrf.viewer.loading import Progress, prepare

SECONDS = 10.0
FPS = 60
PULL = (0.34, -0.06, -0.04)  # object sizes
TWIST = (0.0, 0.0, 1.1)  # radians


def eased(time, begin, end):
    """0 before `begin`, 1 behind `end`, smooth between [s]."""
    share = float(np.clip((time - begin) / (end - begin), 0.0, 1.0))
    return share * share * (3.0 - 2.0 * share)


class Hand:
    """What is done at which second of the film."""

    def __init__(self, scene):
        self.scene, self.handles = scene, scene.handles
        ids = self.handles.control_ids
        places = self.handles.at(ids)
        order = np.argsort(-places[:, 2])
        self.top = [int(i) for i in ids[order[:10]]]
        front = places[order[:10]] @ [0.5, -0.85, 0.0]
        self.grip = self.top[int(front.argmax())]
        self.first = scene.orbit

    def act(self, time):
        scene, handles = self.scene, self.handles
        turn = 0.9 * eased(time, 0.0, SECONDS)
        scene.orbit = replace(self.first, yaw=self.first.yaw - 0.45 + turn)
        if 0.6 <= time < 3.4:
            self.drag_one(time)
        elif 3.4 <= time < 5.2:
            handles.release()
        elif 5.2 <= time < 8.4:
            self.twist(time)
        else:
            handles.release()
            if handles.selected:
                handles.select([])

    def drag_one(self, time):
        if self.handles.grabbed is None:
            self.scene.settings.grab_radius = 0.12
            self.handles.grab(self.grip)
        out = eased(time, 0.6, 1.7) - 1.6 * eased(time, 2.0, 3.1)
        grab = self.handles.grabbed
        self.handles.drag_to(grab.start + out * self.scene.size * np.array(PULL))

    def twist(self, time):
        if not self.handles.selected:
            self.handles.select(self.top)
        if time > 5.6 and self.handles.grabbed is None:
            self.handles.grab(self.top[0])
        if self.handles.grabbed is not None:
            share = eased(time, 5.6, 6.7) - 1.7 * eased(time, 6.9, 8.1)
            self.handles.turn_to(share * np.array(TWIST), 1.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("assets/demo.jsonl"))
    arguments = parser.parse_args()
    start_warp()
    field = modelfile.load(paths.DEFAULT_MODEL)
    scene, _ = prepare(field, "helmet", "cpu", Progress("cpu"))
    hand, start = Hand(scene), start_of(scene)
    for frame in range(round(SECONDS * FPS)):
        hand.act(frame / FPS)
        scene.clock.advance(1.0 / FPS)
    print(save_session(scene, start, arguments.out))


if __name__ == "__main__":
    main()
