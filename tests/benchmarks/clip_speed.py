"""Frames per second and pixels while a clip plays: the viewer's own frames, without a display.

    python tests/benchmarks/clip_speed.py MODEL [--clip Run] [--device cpu|cuda:0]
        [--sizes 800x800] [--targets 12 15] [--softness 0 0.5] [--seconds 10] [--full] [--each]

The model has a rig.  The clip plays in real time, again and again; resolution and savings follow
the target, as in the window, or, with --full, all pixels are rendered whatever the target.
pixels is the shorter side of the image that was rendered, and the share of frames with all levels
and whole steps follows; ms are means of the stages in the last second.  At softness 0 bones move
all vertices, above it physics moves a part of them, 60 times a second: frames between two ticks
have nothing to render, and count.  With --each every frame takes one tick, however long it lasts,
so that each has a new pose and physics.  slowest is the mean of the 1 % slowest frames, in ms.
"""

import argparse
import time

import numpy as np

from deformrf.core.base.device import device_name, start_warp
from deformrf.core.deform import TIME_STEP
from deformrf.core.field import modelfile

WARM_UP_SECONDS = 3.0  # the ladder finds its rung


def measure(app, clip, target, softness, seconds, full, each):
    """A row of the table."""
    scene, layer = app.scene, app.radiance
    scene.reset()
    scene.settings.target_fps, scene.settings.show_handles = target, False
    scene.settings.fixed_resolution = 1.0 if full else None
    scene.posing.set_softness(softness)
    scene.posing.play_clip(clip)
    frames, sides, whole = [], [], []
    begin = last = time.perf_counter()
    while last - begin < WARM_UP_SECONDS + seconds:
        now = time.perf_counter()
        app.frame(TIME_STEP if each else now - last)
        if last - begin > WARM_UP_SECONDS:
            frames.append(now - last)
            sides.append(min(layer.shown.texture.size))
            whole.append(not layer.shown.cheaper)
        last = now
    return {
        "target": target,
        "softness": softness,
        "fps": 1.0 / np.mean(frames),
        "slowest": 1e3 * np.mean(np.sort(frames)[-max(len(frames) // 100, 1) :]),
        "pixels": int(np.median(sides)),
        "whole": np.mean(whole),
        **{name: 1e3 * value for name, value in app.times.means().items()},
    }


def main():
    from deformrf.commands.view import frame_size
    from deformrf.viewer.window import open_window

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("--clip", default="Run")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--sizes", nargs="+", default=["800x800"])
    parser.add_argument("--targets", type=float, nargs="+", default=[12.0, 15.0])
    parser.add_argument("--softness", type=float, nargs="+", default=[0.0, 0.5])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--each", action="store_true")
    arguments = parser.parse_args()
    start_warp()
    for size in arguments.sizes:
        window, context = open_window(frame_size(size), headless=True)
        from deformrf.viewer.app import App  # imports pyglet's window, possible from now on
        from deformrf.viewer.events import EventLog

        app = App(window, context, EventLog(False), gui=False)
        app.load(modelfile.load(arguments.model), "model", device_name(arguments.device))
        for target in arguments.targets:
            for softness in arguments.softness:
                more = softness, arguments.seconds, arguments.full, arguments.each
                row = measure(app, arguments.clip, target, *more)
                numbers = ", ".join(f"{name} {value:.3g}" for name, value in row.items())
                print(f"{size}: {numbers}", flush=True)
        app.close()


if __name__ == "__main__":
    main()
