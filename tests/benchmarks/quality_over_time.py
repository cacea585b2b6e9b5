"""PSNR on test views over the seconds of a training run, as a curve for each data set.

    python tests/benchmarks/quality_over_time.py DATA ... [--device cuda:0] [--preset default]
        [--steps N] [--views 10] [--image-size PIXELS] [--line 35.1] [--out out/quality]

Each data set is trained in a process of its own, so each curve has its cold start: loading the
kernels counts, importing the program and reading the images don't.  The clock stops while
views are scored.  Prints when each whole dB, and --line, was first passed; writes
quality.json and quality.png.
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from math import floor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from deformrf.commands.train_choices import with_steps
from deformrf.core.base.device import start_warp
from deformrf.core.render import Camera, Renderer, RenderOptions, in_space
from deformrf.core.training import load_dataset, preset, trainer, white_composite
from deformrf.core.training.evaluation import render_view
from deformrf.core.training.metrics import psnr
from deformrf.core.training.run.surroundings import LearnedSurroundings

INTERVAL, SHARE = 0.5, 0.05  # seconds from score to score, and at least that share of all so far


def mean_psnr(field, views, device) -> float:
    """Over the views, on white."""
    renderer, options = Renderer(field, device), RenderOptions(background=(1.0, 1.0, 1.0))
    around = field.surroundings and LearnedSurroundings(field.surroundings, device)
    poses = in_space(views.poses, field.world_to_model)
    scores = []
    for index, (pose, lens) in enumerate(zip(poses, views.lenses, strict=True)):
        image = render_view(renderer, around, Camera(pose, lens), options)
        truth = white_composite(views.image(index)).astype(np.float64)
        scores.append(psnr(image[..., :3] / 255.0, truth))
    return float(np.mean(scores))


def curve(data, arguments) -> dict:
    """Train on one data set: the curve and what it is of, plain JSON values."""
    start_warp()
    options = preset(arguments.preset)
    if arguments.steps is not None:
        options = with_steps(options, arguments.steps)
    train_views = load_dataset(data, "train", arguments.image_size)
    test_views = load_dataset(data, "test", arguments.image_size, arguments.views)
    points, due = [], 0.0

    def score(pause):
        nonlocal due
        seconds = pause.seconds
        if seconds >= due:
            value = mean_psnr(pause.export(), test_views, arguments.device)
            points.append({"seconds": seconds, "psnr": value, "stage": pause.stage})
            due = seconds + max(INTERVAL, SHARE * seconds)

    begin = time.perf_counter()
    trained = trainer.train(train_views, options, arguments.device, on_pause=score)
    elapsed = time.perf_counter() - begin
    value = mean_psnr(trained.field, test_views, arguments.device)
    points.append({"seconds": trained.report["seconds"], "psnr": value, "stage": 2})
    return {
        "data": Path(data).resolve().name,
        "complete": trained.complete,
        "device": trained.report["device"],
        "stage_1_seconds": trained.report.get("stage_1_seconds"),
        "seconds_with_scoring": elapsed,
        "sizes": sorted({f"{lens.width}x{lens.height}" for lens in test_views.lenses}),
        "views": test_views.view_count,
        "options": asdict(options),
        "points": points,
    }


def first_passed(points, threshold):
    """Seconds after which the curve was first there, None if it never was."""
    return next((p["seconds"] for p in points if p["psnr"] >= threshold), None)


def thresholds(points, line):
    """Whole dB from the first score to the best one, and the line."""
    values = [point["psnr"] for point in points]
    whole = range(floor(min(values)) + 1, floor(max(values)) + 1)
    return sorted({*map(float, whole), *([] if line is None else [line])})


def report(result, line):
    points = result["points"]
    print(f"{result['data']}: {points[-1]['psnr']:.2f} dB after {points[-1]['seconds']:.1f} s")
    for threshold in thresholds(points, line):
        seconds = first_passed(points, threshold)
        print(f"  {threshold:5.1f} dB  " + ("never" if seconds is None else f"{seconds:7.1f} s"))


def plot(results, line, path):
    """A line per data set, dotted where stage 1 ends; and the line to pass."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4), layout="constrained")
    for result in results:
        points = result["points"]
        seconds, values = ([point[name] for point in points] for name in ("seconds", "psnr"))
        (drawn,) = axes.plot(seconds, values, ".-", label=result["data"])
        if result["stage_1_seconds"] is not None:
            axes.axvline(result["stage_1_seconds"], color=drawn.get_color(), linestyle=":")
    if line is not None:
        axes.axhline(line, color="gray", linestyle="--", label=f"{line:g} dB")
    axes.set(xlabel="seconds of training", ylabel="PSNR [dB]", xlim=(0.0, None))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=150)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="+")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--preset", default="default", choices=("fast", "tiny", "default"))
    parser.add_argument("--steps", type=int, help="of both stages together")
    parser.add_argument("--views", type=int, default=10, help="test views to score")
    parser.add_argument("--image-size", type=int)
    parser.add_argument("--line", type=float, help="dB to mark")
    parser.add_argument("--out", type=Path, default=Path("out/quality"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    results = []
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        for result in pool.map(curve, arguments.data, [arguments] * len(arguments.data)):
            results.append(result)
            report(result, arguments.line)
            text = json.dumps(results, indent=1, allow_nan=False) + "\n"
            (arguments.out / "quality.json").write_text(text, encoding="utf-8")
    plot(results, arguments.line, arguments.out / "quality.png")


if __name__ == "__main__":
    main()
