"""Photographs with something wrong, through deformrf train: what the program makes of them.

    python tests/benchmarks/capture_trouble.py DATA OUT [OPTION ...]

DATA holds photographs; beside them may lie what is true: ../truth/poses.json (their cameras) and
../truth/transforms_test.json with images of the object alone.  Of each kind a folder is made and
trained (by default as two cores can: --preset tiny); OUT/KIND has it, the model, all that was
printed, and OUT/KIND.png shows photographs above the model from the same cameras.

    whole      all photographs, as they are
    scattered  every third is gone
    arc        a third of the way around is gone
    blurred    every third is blurred by a moving camera, 3 % of the width
    exposed    each has an exposure of its own, up to half a stop, and a white balance
    shadow     a soft shadow falls on each, as somebody's who walks by: elsewhere each time
    beside     another object, the bundled model, stands beside it
    twin       a copy of the object does
    two        as many photographs of --others lie in the folder
    stranger   one photograph of --others does
    bare       nothing has texture but the object
    wall       photographs of a white wall

`beside`, `twin` and `bare` are made with the model of `whole`.  With --every N all kinds but
`whole` have every Nth photograph only.

A row of the table: photographs, those with cameras, the error of centers over their spread and of
rotations (medians after a similarity), PSNR of the object alone on white, IoU of {alpha >= 1/2},
degrees from upright, seconds of a clock and of all cores, and what was
said.  OUT/table.json has the same.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from PIL import Image

from deformrf.core.base import paths
from deformrf.core.base.device import start_warp
from deformrf.core.field import modelfile
from deformrf.core.render import Camera, Renderer, RenderOptions, camera_rays, in_space
from deformrf.core.training import load_dataset, load_points, white_composite
from deformrf.core.training.metrics import psnr
from deformrf.wings.capture import find_photos

COMMAND = "import sys; from deformrf.commands.train import main; sys.exit(main())"
PICTURES = 6
BLACK = RenderOptions(background=(0.0, 0.0, 0.0))
HEADINGS = ("kind", "cameras", "centers", "rotations", "dB", "IoU", "upright", "s", "CPU s")


def write(images, names, folder: Path):
    folder.mkdir(parents=True)
    for image, name in zip(images, names, strict=True):
        Image.fromarray(np.clip(np.round(image), 0, 255).astype(np.uint8)).save(
            folder / name, quality=93
        )


def blurred(image, rng):
    """Moved along a line of 3 % of the width while the shutter was open."""
    angle, length = rng.uniform(0, np.pi), 0.03 * image.shape[1]
    way = np.linspace(-0.5, 0.5, 16)[:, None] * length * [np.cos(angle), np.sin(angle)]
    return np.mean([np.roll(image, np.round(w).astype(int), (1, 0)) for w in way], axis=0)


def exposed(image, rng):
    """Scaled in linear light: half a stop, and each color by up to 8 %."""
    gains = 2.0 ** rng.uniform(-0.5, 0.5) * rng.uniform(0.92, 1.08, 3)
    return 255.0 * np.clip((image / 255.0) ** 2.2 * gains, 0.0, 1.0) ** (1.0 / 2.2)


def shadow(image, rng):
    """Six tenths of the linear light are gone within an ellipse, whose edge is soft."""
    height, width = image.shape[:2]
    radii = width * rng.uniform([0.15, 0.2], [0.2, 0.3])
    places = np.stack(np.mgrid[:height, :width][::-1], axis=-1) - rng.uniform(0, [width, height])
    left = 1.0 - 0.6 * np.exp(-(np.square(places / radii).sum(axis=-1) ** 4))
    return image * left[..., None] ** (1.0 / 2.2)


def seen(renderer, camera):
    """The model's color over black, opacity and depth.  [H, W, 3], [H, W], [H, W]"""
    color, opacity, depth = renderer.render_rays(*camera_rays(camera), BLACK)
    shape = camera.height, camera.width
    return 255.0 * color.reshape(*shape, 3), opacity.reshape(shape), depth.reshape(shape)


def posed(folder: Path, model):
    """Cameras in model space and images of a folder whose cameras were found, by name."""
    for split in ("train", "test"):
        views = load_dataset(folder, split)
        poses = in_space(views.poses, model.world_to_model)
        for view, name in enumerate(views.names):
            yield name, Camera(poses[view], views.lenses[view]), views.image(view)[..., :3]


def beside(folder: Path, model, other):
    """The photographs with another object where fewest points are in the way, by name.

    It stands on the plane, as high as the model's own; the two hide each other by their depths.
    """
    box = np.array(model.meta["object_box"])
    points = load_points(folder).points @ model.world_to_model[:3, :3].T
    points += model.world_to_model[:3, 3]
    ways = [[np.cos(a), np.sin(a), 0.0] for a in np.arange(8) * np.pi / 4]
    ways = 0.8 * (box[1] - box[0])[:2].max() * np.array(ways)

    def in_the_way(way):
        low, high = box + way
        low = low + np.array([0.0, 0.0, 0.08])  # above the table
        return ((points > low) & (points < high)).all(axis=1).sum()

    foot, foot_there = feet(model), feet(other)
    scale = height(model) / height(other)
    into = np.diag([1 / scale] * 3 + [1.0])
    into[:3, 3] = foot_there - (foot + min(ways, key=in_the_way)) / scale
    first, second = Renderer(model), Renderer(other)
    for name, camera, image in posed(folder, model):
        _, hides, before = seen(first, camera)
        there = Camera(in_space(camera.camera_to_world, into), camera.lens)
        color, opacity, behind = seen(second, there)
        shown = ~((hides > 0.5) & (before < scale * behind))[..., None]
        yield name, np.where(shown, color + (1 - opacity[..., None]) * image, image)


def feet(model):
    """The middle of what the object stands on, in its model space.  [3]"""
    x = model.mesh.rest_vertices
    middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
    return np.array([*middle[:2], x[:, 2].min()])


def height(model):
    return np.ptp(model.mesh.rest_vertices[:, 2])


def bare(folder: Path, model, rng):
    """The object alone in front of a smooth wall, by name."""
    renderer = Renderer(model)
    for name, camera, image in posed(folder, model):
        color, opacity, _ = seen(renderer, camera)
        yield name, color + (1 - opacity[..., None]) * wall(image.shape, rng)


def wall(shape, rng):
    """A white wall, darker to one side, with a camera's noise."""
    shade = np.linspace(222, 236, shape[1])[None, :, None]
    return shade + rng.normal(size=shape) * 1.5


def make(kind: str, photos, others, folder: Path, whole: Path, every: int):
    """Write the photographs of a kind into a folder."""
    if kind != "whole":
        photos, others = photos[::every], others[::every]
    rng = np.random.default_rng(sum(map(ord, kind)))
    names = [path.name for path in photos]
    if kind in ("beside", "twin", "bare"):
        model = modelfile.load(whole / "m.npz")
        if kind == "bare":
            source = bare(whole / "photos", model, rng)
        else:
            other = model if kind == "twin" else modelfile.load(paths.DEFAULT_MODEL)
            source = beside(whole / "photos", model, other)
        stems = {path.stem for path in photos}
        made = {name: image for name, image in source if name in stems}
        return write(made.values(), [f"{name}.jpg" for name in made], folder)
    images = [np.asarray(Image.open(path).convert("RGB")) for path in photos]
    keep = np.ones(len(images), bool)
    if kind == "scattered":
        keep[::3] = False
    if kind == "arc":
        keep[: len(keep) // 3] = False
    if kind == "wall":
        images = [wall(image.shape, rng) for image in images]
    change = {"blurred": blurred, "exposed": exposed, "shadow": shadow}.get(kind)
    if change:
        step = 3 if kind == "blurred" else 1
        images = [change(im, rng) if i % step == 0 else im for i, im in enumerate(images)]
    more = {"two": others[: len(photos)], "stranger": others[len(others) // 2 :][:1]}.get(kind, [])
    images = [image for image, kept in zip(images, keep, strict=True) if kept]
    names = [name for name, kept in zip(names, keep, strict=True) if kept]
    images += [np.asarray(Image.open(path).convert("RGB")) for path in more]
    names += [f"x-{path.stem}.jpg" for path in more]
    return write(images, names, folder)


def run(folder: Path, more):
    """Train; what was printed, the exit code, and seconds of a clock and of all cores."""
    arguments = [
        folder / "photos",
        "-o",
        folder / "m.npz",
        *more,
    ]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *map(str, arguments)], capture_output=True, text=True
    )
    seconds, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    told = done.stdout + done.stderr
    (folder / "printed.txt").write_text(told, encoding="utf-8")
    return told, done.returncode, seconds, cpu


def similarity(x, y):
    """Scale, rotation and shift that take points x nearest to y.  [n, 3] both"""
    mx, my = x.mean(axis=0), y.mean(axis=0)
    u, s, vt = np.linalg.svd((y - my).T @ (x - mx))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    turn = u * signs @ vt
    scale = (s * signs).sum() / ((x - mx) ** 2).sum()
    return scale, turn, my - scale * turn @ mx


def score(folder: Path, truth: Path, pictures) -> dict:
    """Of cameras and of the object alone, against what is true."""
    known = json.loads((truth / "poses.json").read_text())["frames"]
    known = {Path(f["file_path"]).stem: np.array(f["transform_matrix"]) for f in known}
    frames = json.loads((folder / "photos" / "transforms.json").read_text())["frames"]
    frames = [f for f in frames if Path(f["file_path"]).stem in known]
    found = np.array([f["transform_matrix"] for f in frames])
    real = np.array([known[Path(f["file_path"]).stem] for f in frames])
    scale, turn, shift = similarity(found[:, :3, 3], real[:, :3, 3])
    off = np.linalg.norm(scale * found[:, :3, 3] @ turn.T + shift - real[:, :3, 3], axis=1)
    spread = np.sqrt(((real[:, :3, 3] - real[:, :3, 3].mean(axis=0)) ** 2).sum(axis=1).mean())
    relative = np.swapaxes(turn @ found[:, :3, :3], 1, 2) @ real[:, :3, :3]
    cosines = (np.trace(relative, axis1=1, axis2=2) - 1) / 2
    scores = {
        "centers": float(np.median(off) / spread),
        "rotations": float(np.degrees(np.median(np.arccos(np.clip(cosines, -1, 1))))),
    }
    model = modelfile.load(folder / "m.npz")
    back = np.eye(4)  # from the true world to the data's
    back[:3, :3], back[:3, 3] = turn.T / scale, -turn.T @ shift / scale
    up = model.world_to_model[:3, :3] @ turn.T[:, 2]
    scores["upright"] = float(np.degrees(np.arccos(up[2] / np.linalg.norm(up))))
    views, renderer, rows = load_dataset(truth, "test"), Renderer(model), []
    poses = in_space(in_space(views.poses, back), model.world_to_model)
    for view, (pose, lens) in enumerate(zip(poses, views.lenses, strict=True)):
        drawn, image = renderer.render(Camera(pose, lens)).color_array(), views.image(view)
        inside, really = drawn[..., 3] >= 128, image[..., 3] >= 128
        white = white_composite(image)
        iou = (inside & really).sum() / (inside | really).sum()
        rows.append((psnr(drawn[..., :3] / 255.0, white), iou))
        if view % 4 == 0:
            pictures.append([np.round(255 * white).astype(np.uint8), drawn[..., :3]])
    scores["dB"], scores["IoU"] = map(float, np.mean(rows, axis=0))
    return scores


def draw(folder: Path, pictures, path: Path):
    """Photographs and true images above the model from the same cameras."""
    model = modelfile.load(folder / "m.npz")
    renderer, views = Renderer(model), list(posed(folder / "photos", model))
    for _, camera, image in views[:: max(1, len(views) // PICTURES)][:PICTURES]:
        pictures.append([image, renderer.render(camera).color_array()[..., :3]])
    columns = []
    for column in pictures:
        small = [Image.fromarray(image) for image in column]
        for image in small:
            image.thumbnail((240, 240))
        columns.append(small)
    height = max(image.height for column in columns for image in column)
    page = Image.new("RGB", (244 * len(columns), 2 * height + 4), "white")
    for number, column in enumerate(columns):
        for row, image in enumerate(column):
            page.paste(image, (244 * number, row * (height + 4)))
    page.save(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    known = [line.split()[0] for line in __doc__.splitlines() if line.startswith("    ")][1:]
    parser.add_argument("--kinds", nargs="+", default=known, choices=known)
    parser.add_argument("--others", type=Path, help="folder with photographs of something else")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--preset", default="tiny", help="of deformrf train")
    parser.add_argument("--device", default="cpu", help="of deformrf train")
    parser.add_argument("--steps", type=int, help="of deformrf train")
    parser.add_argument("--leave-out", nargs="+", help="of deformrf train")
    arguments = parser.parse_args()
    start_warp()
    photos, others = (
        [photo.path for photo in find_photos(folder)[0]] if folder else []
        for folder in (arguments.data, arguments.others)
    )
    truth, table = arguments.data.parent / "truth", arguments.out / "table.json"
    rows = json.loads(table.read_text()) if table.exists() else {}
    print("".join(f"{heading:>11}" for heading in HEADINGS))
    for kind in arguments.kinds:
        folder = arguments.out / kind
        if not (folder / "photos").exists():
            whole = arguments.out / "whole"
            make(kind, photos, others, folder / "photos", whole, arguments.every)
        more = ["--preset", arguments.preset, "--device", arguments.device]
        more += ["--steps", arguments.steps] if arguments.steps else []
        more += ["--leave-out", *arguments.leave_out] if arguments.leave_out else []
        told, code, seconds, cpu = run(folder, more)
        total, pictures = len(find_photos(folder / "photos")[0]), []
        row = {"cameras": f"0/{total}"}
        if code == 0:
            if (truth / "poses.json").exists():
                row = score(folder, truth, pictures)
            frames = json.loads((folder / "photos" / "transforms.json").read_text())["frames"]
            row["cameras"] = f"{len(frames)}/{total}"
            draw(folder, pictures, arguments.out / f"{kind}.png")
        rows[kind] = {"kind": kind, **row, "s": seconds, "CPU s": cpu, "code": code, "told": told}
        table.write_text(json.dumps(rows, indent=1))
        cells = [rows[kind].get(heading, "") for heading in HEADINGS]
        cells = [f"{cell:.4g}" if isinstance(cell, float) else cell for cell in cells]
        print("".join(f"{cell:>11}" for cell in cells), flush=True)
        for line in told.splitlines():
            print(f"           {line}")


if __name__ == "__main__":
    main()
