"""Makes the film of bones in docs/window.md: a fox that runs, and the helmet bent by two bones.

    python tests/benchmarks/rig_films.py FOX.npz -o docs/figures/bones.webp

FOX.npz is a model with a rig that has the clip Run (deformrf rig bind).  Both films have as many
frames and are put side by side.
"""

import argparse
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from deformrf.core import field as fields
from deformrf.core.base.paths import DEFAULT_MODEL
from deformrf.wings import rig as rigs

SIDE, FPS, SAMPLES = 320, 20, 4
FOX = 192, 170, 696, 506  # of a picture of 960x640 pixels: the fox fills a part of it
BENDS = ((0.0, 0.0), (0.5, 0.4), (-0.3, -0.5), (0.0, 0.0))  # of both bones [radians]


def bent_helmet(duration: float):
    """The bundled model with two bones and a clip that bends them."""
    field = fields.load(DEFAULT_MODEL)
    rest = field.mesh.rest_vertices
    low, high = rest.min(axis=0), rest.max(axis=0)
    middle = 0.5 * (low + high)
    heights = low[2] + np.array([0.15, 0.5, 0.9]) * (high - low)[2]
    joints = [(*middle[:2], height) for height in heights]
    skeleton = rigs.make_skeleton(("stand", "head"), (-1, 0), joints[:2], joints[1:])
    poses = []
    for lower, upper in BENDS:
        pose = rigs.turned(skeleton, skeleton.rest_pose, 0, (0.0, 0.5 * lower, 0.0))
        poses.append(rigs.turned(skeleton, pose, 1, (0.0, 0.0, upper)))
    times = np.linspace(0.0, duration, len(poses))
    clip = rigs.clip_of_poses("Bend", times, poses)
    rig = rigs.Rig(skeleton, rigs.automatic_weights(field.mesh, skeleton), (clip,))
    return replace(field, rig_arrays=rigs.arrays_of(rig))


def frames(model, clip, size, folder):
    """A clip's frames as the command deformrf render makes them."""
    command = "from deformrf.commands.render import main; raise SystemExit(main())"
    options = ["--fps", str(FPS), "--samples", str(SAMPLES), "-o", str(folder)]
    arguments = [str(model), "--clip", clip, "--size", size, *options]
    subprocess.run([sys.executable, "-c", command, *arguments], check=True)
    return [Image.open(file).convert("RGB") for file in sorted(folder.glob("*.png"))]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("fox", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    fox = fields.load(arguments.fox)
    run = rigs.rig_from(fox.rig_arrays, fox.mesh.vertex_count).clip("Run")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fields.save(bent_helmet(2.0 * run.duration), folder / "helmet.npz")
        left = frames(arguments.fox, "Run", f"{3 * SIDE}x{2 * SIDE}", folder / "fox")
        left = [picture.crop(FOX).resize((3 * SIDE // 2, SIDE)) for picture in left]
        right = frames(folder / "helmet.npz", "Bend", f"{SIDE}x{SIDE}", folder / "bend")
        pictures = []
        for n, helmet in enumerate(right):
            picture = Image.new("RGB", (left[0].width + SIDE, SIDE), "white")
            picture.paste(left[n % len(left)], (0, 0))
            picture.paste(helmet, (left[0].width, 0))
            pictures.append(picture)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    settings = {"duration": round(1000 / FPS), "loop": 0, "quality": 75, "method": 6}
    pictures[0].save(arguments.output, save_all=True, append_images=pictures[1:], **settings)
    print(f"wrote {arguments.output}: {len(pictures)} frames, {arguments.output.stat().st_size} B")


if __name__ == "__main__":
    main()
