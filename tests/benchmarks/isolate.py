"""Isolate on a capture whose object alone is known: after a click, and after strokes by a hand.

    python tests/benchmarks/isolate.py PHOTOS MODEL [--strokes 4] [--pictures FOLDER] [--json FILE]

MODEL was trained of PHOTOS with all that stands around, for example by

    deformrf train capture_pillar/photos -o MODEL --preset tiny --leave-out found-box

and is trained so if the file isn't there.  PHOTOS/../truth has poses.json (the photographs' true
cameras) and transforms_test.json with images of the object alone.

A click: where the middle of a test image meets the model's surface, if the object is there.  All
such clicks are tried.  From the median one a hand goes on: in the image with the largest wrong
region it draws a stroke along that region, "not this" where something is left that isn't the
object's, or "this" where the object lacks something, on the surface that the preview shows; it
stops where no region has 1 % of the object.  A row of the table has the IoU of {alpha >= 1/2} over
all test images, and the seconds of a clock from the stroke to the preview's masks, without a
picture.
"""

import argparse
import json
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from capture_trouble import COMMAND, similarity
from PIL import Image
from scipy import ndimage

from deformrf.core.base.device import start_warp
from deformrf.core.field import modelfile
from deformrf.core.field.isolation import isolating
from deformrf.core.render import Camera, Renderer, RenderOptions, camera_rays, in_space
from deformrf.core.training import load_dataset

WHITE = RenderOptions(background=(1.0, 1.0, 1.0))
STROKE_POINTS = 40
BRUSH = 4.0  # pixels
LEAST = 0.01  # of the object in an image: the hand leaves what is smaller
CLICK_SIZE = 160, 120  # of the images that many clicks are scored on


@dataclass(frozen=True)
class View:
    """A test image and its camera in model space."""

    camera: Camera
    truth: np.ndarray  # [H, W] bool, where the object is


def views_of(photos: Path, model) -> list[View]:
    """The test images' views."""
    truth = photos.parent / "truth"
    known = json.loads((truth / "poses.json").read_text())["frames"]
    known = {Path(f["file_path"]).stem: np.array(f["transform_matrix"]) for f in known}
    frames = json.loads((photos / "transforms.json").read_text())["frames"]
    frames = [f for f in frames if Path(f["file_path"]).stem in known]
    found = np.array([f["transform_matrix"] for f in frames])
    real = np.array([known[Path(f["file_path"]).stem] for f in frames])
    scale, turn, shift = similarity(found[:, :3, 3], real[:, :3, 3])
    back = np.eye(4)  # from the true world to the data's
    back[:3, :3], back[:3, 3] = turn.T / scale, -turn.T @ shift / scale
    views = load_dataset(truth, "test")
    poses = in_space(in_space(views.poses, back), model.world_to_model)
    return [
        View(Camera(pose, lens), views.image(i)[..., 3] >= 128)
        for i, (pose, lens) in enumerate(zip(poses, views.lenses, strict=True))
    ]


def small(view: View) -> View:
    truth = Image.fromarray(view.truth).resize(CLICK_SIZE, Image.Resampling.NEAREST)
    camera = replace(view.camera, lens=view.camera.lens.resized(*CLICK_SIZE))
    return View(camera, np.asarray(truth))


def drawn(field, views):
    """Renders of a field: color and alpha [H, W, 4] and depth [H, W] of each view."""
    renderer = Renderer(field)
    images = (renderer.render(view.camera, WHITE) for view in views)
    return [(image.color_array().copy(), image.depth_array().copy()) for image in images]


def iou(images, views) -> float:
    """The mean over the views."""
    inside = [color[..., 3] >= 128 for color, _ in images]
    pairs = list(zip(inside, (view.truth for view in views), strict=True))
    return float(np.mean([(a & b).sum() / max((a | b).sum(), 1) for a, b in pairs]))


def places(camera, depth, pixels):
    """The surface at pixels (row, column) [n, 2]; those without any are left out.  [m, 3]"""
    origins, directions = (a.reshape(*depth.shape, 3) for a in camera_rays(camera))
    row, column = pixels.T
    t = depth[row, column]
    seen = np.isfinite(t)
    return (origins[row, column] + t[:, None] * directions[row, column])[seen]


def middle_click(view, depth):
    """The surface in the middle of an image [3]; None if the object isn't there."""
    middle = np.array([np.array(depth.shape) // 2])
    found = places(view.camera, depth, middle)
    return found[0] if view.truth[tuple(middle[0])] and len(found) else None


def in_hull(points, views):
    """Which points lie within the object in every view.  [n] bool"""
    inside = np.ones(len(points), bool)
    for view in views:
        pose, lens = view.camera.camera_to_world, view.camera.lens
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        x = lens.focal[0] * local[:, 0] / -local[:, 2] + lens.center[0]
        y = -lens.focal[1] * local[:, 1] / -local[:, 2] + lens.center[1]
        row = np.clip(y, 0, lens.height - 1).astype(int)
        column = np.clip(x, 0, lens.width - 1).astype(int)
        inside &= view.truth[row, column]
    return inside


def largest(wrong):
    """The largest connected region, without its rim.  [H, W] bool"""
    inner = ndimage.binary_erosion(wrong, iterations=2)
    labels, count = ndimage.label(inner)
    if not count:
        return inner
    return labels == np.bincount(labels.ravel())[1:].argmax() + 1


def along(region):
    """Pixels (row, column) of a stroke along a region's longer axis.  [n, 2]"""
    pixels = np.argwhere(region)
    middle = pixels.mean(axis=0)
    axis = np.linalg.svd(pixels - middle, full_matrices=False)[2][0]
    along = (pixels - middle) @ axis
    steps = np.linspace(*np.percentile(along, [5, 95]), STROKE_POINTS)
    depth = ndimage.distance_transform_edt(region)[tuple(pixels.T)]
    chosen = []
    for step in steps:  # the deepest pixel across
        near = np.flatnonzero(abs(along - step) <= 1.0)
        if len(near):
            chosen.append(pixels[near[depth[near].argmax()]])
    return np.array(chosen)


def next_stroke(whole, alone, views):
    """Where the hand draws: points at rest [n, 3], whether they are "this", and a radius."""
    best = None
    for view, (_, depth), (color, own_depth) in zip(views, whole, alone, strict=True):
        kept = color[..., 3] >= 128
        for this, wrong, surface in (
            (False, kept & ~view.truth, own_depth),
            (True, view.truth & ~kept, depth),
        ):
            region = largest(wrong)
            if best is not None and region.sum() <= best[0]:
                continue
            if region.sum() < LEAST * view.truth.sum():
                continue
            points = places(view.camera, surface, along(region))
            if this:
                points = points[in_hull(points, views)]
            if len(points) < 3:
                continue
            away = np.linalg.norm(points - view.camera.camera_to_world[:3, 3], axis=1).mean()
            best = region.sum(), points, this, BRUSH * away / view.camera.lens.focal[0]
    return best[1:] if best else None


def keep_picture(path, whole, alone, views):
    """Renders of the whole above the object alone, with what is wrong in red and blue."""
    rows = []
    for (color, _), (own, _), view in list(zip(whole, alone, views, strict=True))[::3]:
        kept = own[..., 3] >= 128
        marked = own[..., :3].copy()
        marked[kept & ~view.truth] = marked[kept & ~view.truth] // 2 + np.uint8([127, 0, 0])
        marked[view.truth & ~kept] = marked[view.truth & ~kept] // 2 + np.uint8([0, 0, 127])
        rows.append(np.concatenate([color[..., :3], marked]))
    Image.fromarray(np.concatenate(rows, axis=1)).save(path)


def train(photos: Path, model: Path):
    options = ["--preset", "tiny", "--leave-out", "found-box"]
    command = [sys.executable, "-c", COMMAND, str(photos), "-o", str(model), *options]
    subprocess.run(command, check=True)


def clicks_of(prepared, field, whole, views, pictures):
    """The IoU of every click at the middle of a view, and the median click."""
    scored, few = [], [small(view) for view in views]
    for view, (_, depth) in zip(views, whole, strict=True):
        point = middle_click(view, depth)
        if point is not None:
            result = isolating.isolated(prepared, [isolating.Stroke(point[None], True)])
            alone = drawn(isolating.kept_field(field, prepared, result), few)
            scored.append((iou(alone, few), point))
    scored.sort(key=lambda pair: pair[0])
    return [score for score, _ in scored], scored[len(scored) // 2][1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--strokes", type=int, default=4)
    parser.add_argument("--pictures", type=Path, help="folder for a picture after each stroke")
    parser.add_argument("--json", type=Path, help="file for the table")
    arguments = parser.parse_args()
    start_warp()
    if not arguments.model.exists():
        train(arguments.photos, arguments.model)
    field = modelfile.load(arguments.model)
    views = views_of(arguments.photos, field)
    begin = time.perf_counter()
    prepared = isolating.isolation_of(field)
    seconds = time.perf_counter() - begin
    print(f"{len(prepared.matter.tets)} occupied sub-tets, prepared in {seconds:.1f} s")
    whole = drawn(field, views)
    inside = isolating.Isolated(in_hull(prepared.matter.middles, views), ())
    best = iou(drawn(isolating.kept_field(field, prepared, inside), views), views)
    print(f"all of it: IoU {iou(whole, views):.3f}; all sub-tets in every outline: {best:.3f}")
    scores, point = clicks_of(prepared, field, whole, views, arguments.pictures)
    print(f"{len(scores)} clicks: IoU " + " ".join(f"{score:.3f}" for score in scores))
    strokes, rows = [isolating.Stroke(point[None], True)], []
    for number in range(arguments.strokes + 1):
        begin, busy = time.perf_counter(), time.process_time()
        result = isolating.isolated(prepared, strokes)
        seconds, busy = time.perf_counter() - begin, time.process_time() - busy
        alone = drawn(isolating.kept_field(field, prepared, result), views)
        rows.append(
            {"strokes": number, "IoU": iou(alone, views), "seconds": seconds, "CPU seconds": busy}
        )
        said = "click" if not number else "this" if strokes[-1].this else "not this"
        print(
            f"{number:2d} {said:9s} IoU {rows[-1]['IoU']:.3f}  {seconds:.2f} s ({busy:.2f} s CPU)",
            flush=True,
        )
        if arguments.pictures:
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            keep_picture(arguments.pictures / f"{number}.png", whole, alone, views)
        found = next_stroke(whole, alone, views)
        if found is None:
            break
        points, this, radius = found
        strokes.append(isolating.Stroke(points, this, radius))
    if arguments.json:
        table = {
            "clicks": scores,
            "rows": rows,
            "in every outline": best,
            "sub-tets": len(prepared.matter.tets),
        }
        arguments.json.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
