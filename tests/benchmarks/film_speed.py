"""How fast a film is made: what a frame costs, step by step.

    python tests/benchmarks/film_speed.py --device cuda:0 --model chair.npz \
        --size 3840x2160 --fps 60 --seconds 10 --samples 1 16
    python tests/benchmarks/film_speed.py --device cpu --size 400x400 --fps 15 --seconds 10

A film is a turn around the object while it swings, as after a drag; `--frames` measures the first
ones alone, and the time of the whole film is then that of so many like them.  OpenGL draws while
the device renders, and the encoder has a thread, so the steps add up to more than the total.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from deformrf.core import field as fields
from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.viewer.films import Film
from deformrf.viewer.window import open_window


def parsed():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--model", type=Path, default=DEFAULT_MODEL)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--size", default="400x400")
    parser.add_argument("--fps", type=int, default=15)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--samples", type=int, nargs="+", default=[1])
    parser.add_argument("--frames", type=int, help="measure so many frames alone")
    parser.add_argument("--ending", default=".mp4")
    parser.add_argument("--handles", action="store_true")
    return parser.parse_args()


def swinging(field, device, ticks, folder):
    """A session in which the object is dragged, let go, and seen from all around."""
    from deformrf.viewer.camera import orbit as orbits
    from deformrf.viewer.document import Scene, load_session, save_session, start_of

    scene = Scene(field, "film", device)
    start, vertex = start_of(scene), int(scene.handles.control_ids[0])
    scene.clock.advance(1 / 60)
    for tick in range(ticks - 1):
        if tick % 120 == 0:
            scene.handles.grab(vertex)
        if scene.handles.grabbed is not None:
            up = [0.0, 0.0, 0.005 * scene.size]
            scene.handles.drag_to(np.add(scene.handles.grabbed.target.place, up))
        if tick % 120 == 30:
            scene.handles.release()
        scene.orbit = orbits.turned(scene.orbit, 2.0, 0.0, ticks)
        scene.clock.advance(1 / 60)
    return load_session(save_session(scene, start, Path(folder) / "film.jsonl"), field)


def made(app, session, options, args, path):
    """Make a film; returns its FilmMaker, seconds in all and of the encoder's thread."""
    from deformrf.viewer.films import FilmMaker

    app.scene.reset()
    app.scene.journal.clear()
    film = Film(app.scene, session, args.fps)
    count = min(film.count, args.frames or film.count)
    app.canvas.use(app.size)
    maker = FilmMaker(app, film, options)
    start = time.perf_counter()
    app.recorder.start(path, live=False)
    video = app.recorder.video
    for frame in range(count):
        maker.make(frame)
    maker.finish()
    app.recorder.stop()
    assert maker.made == count and not app.recorder.failed
    return maker, time.perf_counter() - start, video.encoding_seconds


def main():
    args = parsed()
    size = tuple(map(int, args.size.split("x")))
    field = fields.load(args.model)
    window, context = open_window(size, headless=True)
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog
    from deformrf.viewer.films import FilmOptions
    from deformrf.viewer.films.film_maker import STEPS

    app = App(window, context, EventLog(False), gui=False, fps=args.fps)
    columns = "samples", "frames", *STEPS, "encoding, beside", "a frame", "measured", "whole film"
    table = Table(*columns, title=f"{args.model.stem}, {args.size}, {args.fps} fps, {args.device}")
    whole = round(args.seconds * args.fps) + 1
    with tempfile.TemporaryDirectory() as folder:
        session = swinging(field, args.device, round(60 * args.seconds), folder)
        app.load(field, "film", args.device)
        print(f"draws on {context.info['GL_RENDERER']}, frames go by {app.radiance.path}")
        first = args.frames
        args.frames = 3  # that load and compile
        made(app, session, FilmOptions(), args, Path(folder) / f"first{args.ending}")
        args.frames = first
        for samples in args.samples:
            options = FilmOptions(samples, show_handles=args.handles)
            path = Path(folder) / f"{samples}{args.ending}"
            maker, seconds, encoding = made(app, session, options, args, path)
            times = [*(maker.seconds[step] for step in STEPS), encoding, seconds]
            cells = [f"{1e3 * t / maker.made:.1f} ms" for t in times]
            measured, all_of_it = f"{seconds:.1f} s", f"{seconds / maker.made * whole:.0f} s"
            table.add_row(str(samples), str(maker.made), *cells, measured, all_of_it)
    Console(width=140).print(table)
    app.close()


if __name__ == "__main__":
    main()
