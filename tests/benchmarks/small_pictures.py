"""The six small pictures of README's "What it can do".

    python tests/benchmarks/small_pictures.py --fox FOX.npz --toy TOY.npz [--out docs/figures/can]

FOX.npz is a model with a rig that has the clip Run, TOY.npz one of the toy of own_object.py.
Frames are rendered in full without a display, on the CPU.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import screenshots
from PIL import Image

from deformrf.core import field as fields
from deformrf.core.base.paths import DEFAULT_MODEL

WINDOW, SIZE = (720, 480), (480, 320)  # [pixels]: words of the window stay legible
RENDER = "import sys; from deformrf.commands.render import main; sys.exit(main())"
FILM = ["--clip", "Run", "--size", "480x320", "--fps", "12", "--samples", "8", "--device", "cpu"]
SECONDS = 4.2  # of the film: six times the clip
PULL = (0.36, -0.1, -0.12)  # object sizes
STROKE = np.array([[455.0, 330.0], [520.0, 330.0]])  # [pixels from the lower left corner]


def look(studio, yaw=0.0, distance=1.0):
    """Turn about the object and approach it, without points on it."""
    orbit, settings = studio.app.scene.orbit, studio.app.scene.settings
    changes = {"yaw": orbit.yaw + yaw, "distance": distance * orbit.distance}
    studio.app.scene.orbit, settings.show_handles = replace(orbit, **changes), False


def bend(studio):
    studio.drag(studio.top()[0], PULL)


def strain(studio):
    studio.app.scene.settings.mesh_surface = "strain"
    look(studio, distance=1.1)
    studio.drag(studio.top()[0], PULL)


def bones(studio):
    look(studio, distance=0.68)
    studio.app.scene.settings.tool = "bones"  # with which they show
    studio.app.scene.posing.scrub_clip("Run", 0.35)


def delete(studio):
    """The brush goes over an ear, through all that is behind it."""
    app, (start, end) = studio.app, STROKE
    app.scene.settings.tool, app.scene.settings.brush_radius = "delete", 34.0
    look(studio, yaw=np.pi + 0.8)
    app.frame(0.0, whole=True)
    app.controls.on_mouse_motion(*start, 0, 0)
    app.controls.on_mouse_press(*start, 1, 1)  # with Shift
    app.controls.on_mouse_drag(*end, *(end - start), 1, 1)


def still(act, model, path, folder):
    """A picture of the window without its panel."""
    studio = screenshots.Studio(fields.load(model), path.stem, WINDOW)
    app = studio.app
    app.scene.settings.show_panel = False
    app.recorder.say = lambda *_: None  # messages name this machine's folders
    act(studio)
    studio.frames(1)
    studio.picture(folder / "picture.png")
    picture = Image.open(folder / "picture.png").convert("RGB")
    picture.resize(SIZE, Image.Resampling.LANCZOS).save(path, quality=60, method=6)
    app.end()
    app.close()


def film(model, path, folder):
    """The fox runs while the camera goes around it."""
    keys = []
    for turn in np.linspace(0.0, 2.0 * np.pi, 25):
        position = [0.5 + 2.1 * np.sin(turn), 0.5 - 2.1 * np.cos(turn), 1.05]
        key = {"t": SECONDS * turn / (2.0 * np.pi), "position": position}
        keys.append(key | {"target": [0.5, 0.5, 0.47], "fov": 20})
    (folder / "path.json").write_text(json.dumps(keys))
    path.unlink(missing_ok=True)
    options = [*FILM, "--frames", str(round(12 * SECONDS)), "--camera", folder / "path.json"]
    subprocess.run([sys.executable, "-c", RENDER, model, *options, "-o", path], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fox", type=Path, required=True)
    parser.add_argument("--toy", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path("docs/figures/can"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    helmets = bend, strain, screenshots.timeline
    models = dict.fromkeys(helmets, DEFAULT_MODEL) | {bones: arguments.fox, delete: arguments.toy}
    with tempfile.TemporaryDirectory() as name:
        for act, model in models.items():
            still(act, model, arguments.out / f"{act.__name__}.webp", Path(name))
        film(arguments.fox, arguments.out / "film.webp", Path(name))
    for path in sorted(arguments.out.glob("*.webp")):
        print(f"{path}: {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
