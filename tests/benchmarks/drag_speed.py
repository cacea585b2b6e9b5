"""Frames per second and quality while somebody drags: the viewer's own frames, without a display.

    python tests/benchmarks/drag_speed.py [--model M] [--device cpu|cuda:0]
        [--sizes 400x400 1280x800] [--targets 10 15] [--orbits 0 10] [--seconds 10]

A control vertex goes in a circle in real time, and the camera turns by so many degrees a second;
resolution and savings follow the target, as in the window.  rays is their share of the window's
pixels (median), and the share of frames with all levels and whole steps follows; ms are means of
the stages in the last second.  dB compares SHOTS frames of the way with the same poses
rendered in conformance mode, over the object's pixels: mean, and the worst one.  The solver steps
60 times a second: frames between two steps have nothing to render, and count.  slowest is the mean
of the 1 % slowest frames, in ms.
"""

import argparse
import time
from dataclasses import replace
from itertools import product

import numpy as np

from deformrf.core.base import paths
from deformrf.core.base.device import device_name, start_warp
from deformrf.core.field import modelfile
from deformrf.core.render import Renderer, RenderOptions
from deformrf.core.training.metrics import psnr

WARM_UP_SECONDS = 3.0  # the ladder finds its rung
TURN = 4.0  # s for a circle
SHOTS = 12


def measure(app, target, orbit, seconds):
    """A row of the table."""
    scene, layer = app.scene, app.radiance
    scene.reset()
    scene.settings.target_fps = target
    scene.settings.show_handles = False
    ids = scene.handles.control_ids
    scene.handles.grab(int(ids[scene.handles.at(ids)[:, 2].argmax()]))
    start = scene.handles.grabbed.target.place.copy()
    frames, rays, whole, shots = [], [], [], []
    first_view = scene.orbit
    begin = last = time.perf_counter()
    while last - begin < WARM_UP_SECONDS + seconds:
        angle = 2.0 * np.pi * (last - begin) / TURN
        offset = 0.15 * scene.size * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
        scene.handles.drag_to(start + offset)
        scene.orbit = replace(first_view, yaw=first_view.yaw + np.radians(orbit) * (last - begin))
        now = time.perf_counter()
        app.frame(now - last)
        if last - begin > WARM_UP_SECONDS:
            frames.append(now - last)
            rays.append(layer.factor**2)
            whole.append(not layer.shown.cheaper)
            if last - begin > WARM_UP_SECONDS + seconds * len(shots) / SHOTS:
                vertices = np.array(scene.solver.vertices.numpy())
                shots.append((app.canvas.read()[..., :3].copy(), app.controls.camera, vertices))
                app.times.rest()  # which took time of no frame
                now = time.perf_counter()
        last = now
    stages = {name: 1e3 * value for name, value in app.times.means().items()}
    scene.handles.release()
    scene.orbit = first_view
    errors = quality(app, shots)
    return {
        "target": target,
        "fps": 1.0 / np.mean(frames),
        "slowest": 1e3 * np.mean(np.sort(frames)[-max(len(frames) // 100, 1) :]),
        "rays": float(np.median(rays)),
        "whole": np.mean(whole),
        **stages,
        "dB": np.mean(errors),
        "worst": min(errors),
    }


def quality(app, shots):
    """dB of what was shown, over the object's pixels."""
    renderer, found = Renderer(app.scene.field, str(app.scene.solver.device)), []
    for shown, camera, vertices in shots:
        renderer.set_vertices(vertices)
        options = RenderOptions(tuple(app.scene.settings.background), conformance=True)
        exact = renderer.render(camera, options).color_array()
        seen = exact[..., 3] > 0
        found.append(psnr(shown[seen] / 255.0, exact[seen, :3] / 255.0))
    return found


def main():
    from deformrf.commands.view import frame_size
    from deformrf.viewer.window import open_window

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--model", default=paths.DEFAULT_MODEL)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--sizes", nargs="+", default=["400x400", "800x800", "1280x800"])
    parser.add_argument("--targets", type=float, nargs="+", default=[10.0, 15.0])
    parser.add_argument("--orbits", type=float, nargs="+", default=[0.0])
    parser.add_argument("--seconds", type=float, default=10.0)
    arguments = parser.parse_args()
    start_warp()
    for size in arguments.sizes:
        pixels = frame_size(size)
        window, context = open_window(pixels, headless=True)
        from deformrf.viewer.app import App  # pyglet knows by now that there is no display
        from deformrf.viewer.events import EventLog

        app = App(window, context, EventLog(False), gui=False)
        app.load(modelfile.load(arguments.model), "model", device_name(arguments.device))
        app.canvas.use(pixels)
        app.scene.solver.edges.sheet_ratios.values()  # or time would stand at first
        for target, orbit in product(arguments.targets, arguments.orbits):
            row = {"window": size, "orbit": orbit}
            row |= measure(app, target, orbit, arguments.seconds)
            print("".join(f"{key:>10}" for key in row))
            cells = (v if isinstance(v, str) else f"{v:.3f}" for v in row.values())
            print("".join(f"{cell:>10}" for cell in cells), flush=True)
        app.close()


if __name__ == "__main__":
    main()
