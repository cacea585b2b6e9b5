"""The pictures of docs/own-object.md: from photographs to a film.

    python tests/benchmarks/own_object.py PHOTOS [--model toy.npz] [--out docs/figures/own]

PHOTOS is a folder of photographs to which transforms.json may be written; the model is trained of
them first if its file isn't there.  Everything runs without a display, on the CPU, in about ten
minutes; training and the camera search take most of it.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image
from screenshots import SIZE, Studio

from deformrf.core.field import pack_mask, subtet_middles

WIDTH = 640  # of the pictures [pixels]
QUALITY = 72
SHOWN = 2, 120  # of stage 2, at which training is shown
TRAIN = "import sys; from deformrf.commands.train import main; sys.exit(main())"
RENDER = "import sys; from deformrf.commands.render import main; sys.exit(main())"
PULL = np.array([0.30, 0.05, -0.06])  # object sizes
CRUMBS = 0.05  # model units: lower, there is no toy
PULL_TICKS, FREE_TICKS = 50, 50
GRAY = (0.72, 0.77, 0.84)
FILM = ["--size", "320x300", "--fps", "10", "--samples", "8", "--hide-handles", "--device", "cpu"]


def run(code, *arguments):
    subprocess.run([sys.executable, "-c", code, *map(str, arguments)], check=True)


def keep(image, path, box=None):
    """Write a picture, or the part of it in a box, in the page's size."""
    image = image.convert("RGB").crop(box) if box else image.convert("RGB")
    height = round(image.height * WIDTH / image.width)
    image.resize((WIDTH, height), Image.Resampling.LANCZOS).save(path, quality=QUALITY, method=6)
    print(f"{path}: {path.stat().st_size // 1000} kB")


class Pictures:
    def __init__(self, photos, model, out):
        self.photos, self.model, self.out = photos, model, out
        self.folder = Path(tempfile.mkdtemp(prefix="own-object-"))

    def page(self):
        """The page of --check: photographs, cameras and points."""
        run(TRAIN, self.photos, "-o", self.folder / "toy.npz", "--check")
        page = Image.open(self.folder / "toy-check.png")
        keep(page, self.out / "check.webp", (0, 0, page.width, 2 * page.width // 3))

    def training(self):
        """The window while a model is trained."""
        from deformrf.viewer.window import open_window

        window, context = open_window(SIZE, headless=True)
        from deformrf.viewer.app import App  # imports pyglet's window, which is possible now
        from deformrf.viewer.events import EventLog
        from deformrf.viewer.training import TrainJob

        output, few = self.folder / "live.npz", ("--preset", "tiny", "--device", "cpu")
        job = TrainJob([str(self.photos), "-o", str(output), *few], output, "cpu")
        app = App(window, context, EventLog(False))
        app.watcher.begin(job)

        def turn():
            if app.scene is None:
                app.watcher.follow()
                time.sleep(0.1)
            else:
                app.run(app.frame_count + 1)

        while job.progress is None or (job.progress["stage"], job.progress["step"]) < SHOWN:
            turn()
        job.pause(True)
        for _ in range(20):
            turn()
        self.shoot(app, "training")
        app.close()

    def shoot(self, app, name):
        """A picture of the window with its panels."""
        path = self.folder / f"{name}.png"
        app.scene.settings.panel_in_screenshots = True
        app.recorder.say = lambda *_: None  # messages name this machine's folders
        app.frame(0.0, whole=True)
        app.recorder.screenshot(path)
        app.frame(0.0, whole=True)
        keep(Image.open(path), self.out / f"{name}.webp")

    def window(self):
        """The found box, the brush, the bent toy, and a film."""
        from deformrf.core import field as fields

        studio = Studio(fields.load(self.model), "toy")
        app = studio.app
        app.scene.orbit = replace(app.scene.orbit, yaw=app.scene.orbit.yaw + np.pi)
        app.scene.settings.show_box = True
        studio.frames(2)
        self.shoot(app, "box")
        app.scene.settings.show_box = False
        self.brush(studio)
        self.bend(studio)
        session = self.folder / "session.jsonl"
        app.recorder.save_session(app.scene, app.session_start, session)
        app.end()
        app.close()
        film = self.out / "film.webp"
        film.unlink(missing_ok=True)
        last = PULL_TICKS + FREE_TICKS
        part = ["--from", str(self.ticks - last), "--to", str(self.ticks)]
        run(RENDER, self.model, "--session", session, *part, *FILM, "-o", film)
        print(f"{film}: {film.stat().st_size // 1000} kB")

    def brush(self, studio):
        """Crumbs of the table around the feet, half of them deleted by a stroke; then all."""
        app = studio.app
        scene, controls = app.scene, app.controls
        scene.settings.tool, scene.settings.brush_radius = "delete", 40.0
        scene.settings.show_handles, first = False, scene.orbit
        low = scene.center - np.array([0.0, 0.0, 0.3 * scene.size])
        scene.orbit = replace(first, target=low, distance=0.55 * first.distance, pitch=0.45)
        white, scene.settings.background = scene.settings.background, GRAY  # crumbs are white
        scene.settings.show_floor = False  # so is the ground
        app.frame(0.0, whole=True)
        start, end = np.array([130.0, 165.0]), np.array([400.0, 100.0])
        controls.on_mouse_motion(*start, 0, 0)
        controls.on_mouse_press(*start, 1, 1)  # with Shift
        controls.on_mouse_drag(*end, *(end - start), 1, 1)
        self.shoot(app, "brush")
        controls.on_mouse_release(*end, 1, 1)
        # What is left of the table, in a box along the window's lower edge, is around the feet.
        height = subtet_middles(scene.field.mesh)[..., 2]
        scene.cuts.delete(pack_mask(height < CRUMBS))
        scene.cuts.delete_specks()
        scene.settings.tool, scene.settings.show_handles = "grab", True
        scene.orbit, scene.settings.background = first, white
        scene.settings.show_floor = True

    def bend(self, studio):
        """The head is dragged aside, and let go for the film."""
        app, handles = studio.app, studio.app.scene.handles
        scene = app.scene
        scene.viewpoint.focus()
        handle = studio.top()[0]
        handles.grab(handle)
        handles.hover = handle
        start = handles.grabbed.start
        for tick in range(1, PULL_TICKS + 1):
            share = min(tick / 30.0, 1.0)
            handles.drag_to(start + share * share * (3.0 - 2.0 * share) * scene.size * PULL)
            scene.clock.advance(1 / 60)
        self.shoot(app, "bent")
        handles.release()
        for _ in range(FREE_TICKS):
            scene.clock.advance(1 / 60)
        self.ticks = scene.journal.tick


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("--model", type=Path, default=Path("toy.npz"))
    parser.add_argument("--out", type=Path, default=Path("docs/figures/own"))
    parser.add_argument("--only", nargs="+", choices=["page", "training", "window"])
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if not arguments.model.exists():
        run(TRAIN, arguments.photos, "-o", arguments.model, "--preset", "tiny")
    pictures = Pictures(arguments.photos, arguments.model, arguments.out)
    for name in arguments.only or ["page", "training", "window"]:
        getattr(pictures, name)()


if __name__ == "__main__":
    main()
