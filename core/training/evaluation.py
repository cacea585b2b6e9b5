"""A model against images that it has not seen: PSNR, SSIM and opacity, view by view.

Render and truth are composited over white.  The alpha error is the mean of |α − α_truth|; it
is left out where the data have no alpha.  Seconds are those of one render and of its copy to
the host, without the first compilation of the kernels.
"""

import json
import os
import time
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import warp as wp
from PIL import Image
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ..device import thread_count
from ..field import TetField, occupied_share, parts_of_file
from ..render import Camera, Renderer, RenderOptions, camera_rays, in_space
from .data import Dataset, has_white_border, white_composite
from .metrics import check_size, psnr, ssim
from .run import LearntSurroundings, on_warp_stream, over

SURROUNDINGS_RAYS = 1 << 14  # at once: 64 samples each
WAITING_VIEWS = 32  # at most, rendered and not scored yet: images would fill the memory
DIFFERENCE_GAIN = 4.0  # errors of a few percent have to be visible


@dataclass(frozen=True)
class ViewScore:
    """One view: PSNR in dB, SSIM, LPIPS (None without weights), mean |Δα| (None without alpha)."""

    name: str
    psnr: float
    ssim: float
    lpips: float | None
    alpha_error: float | None
    seconds: float


def evaluate(
    field: TetField,
    dataset: Dataset,
    out_dir=None,
    device="cpu",
    options=None,
    model_path=None,
    lpips=None,
) -> dict:
    """Render every view of a data set and score it.

    Ctrl-C ends it early: the report then holds the views that are done, and says so.

    Args:
        out_dir: Where report.json and an image per view go: render, truth, their difference
            and the render's accumulation (opacity).
        device: "cpu" or "cuda:0".
        options: RenderOptions; their background is replaced by white.
        model_path: The file that the field came from; the report then says its size.
        lpips: An Lpips with its weights; None leaves that metric out.

    Returns:
        The report, plain JSON values.
    """
    for lens in dataset.lenses:
        check_size(lens.height, lens.width)
    options = replace(options or RenderOptions(), background=(1.0, 1.0, 1.0))
    renderer = Renderer(field, device=device)
    poses = in_space(dataset.poses, field.world_to_model)
    views = [Camera(pose, lens) for pose, lens in zip(poses, dataset.lenses, strict=True)]
    around = field.surroundings and LearntSurroundings(field.surroundings, device)
    if out_dir is not None:
        out_dir = Path(out_dir)
        out_dir.mkdir(parents=True, exist_ok=True)
    small = Camera(poses[0], dataset.lenses[0].resized(8, 8))
    render_view(renderer, around, small, options)  # compiles the kernels

    has_alpha = dataset.has_alpha

    def score(index, rendered, seconds):
        truth = dataset.image(index)
        if out_dir is not None:
            picture = side_by_side(rendered, truth)
            Image.fromarray(picture).save(out_dir / f"{index:03d}_{dataset.names[index]}.png")
        return score_view(dataset.names[index], rendered, truth, has_alpha, seconds, lpips)

    # On a GPU SSIM takes longer than a render.  On the CPU it would take a render's time.
    waiting = WAITING_VIEWS if wp.get_device(device).is_cuda else 1
    jobs = []
    with ThreadPoolExecutor(thread_count()) as pool:
        try:
            for index, camera in enumerate(track(views)):
                begin = time.perf_counter()
                rendered = render_view(renderer, around, camera, options)
                seconds = time.perf_counter() - begin
                jobs.append(pool.submit(score, index, rendered, seconds))
                if len(jobs) >= waiting:
                    jobs[-waiting].result()
            wait(jobs)
        except KeyboardInterrupt:
            pass  # the report of what is done says that it is not complete
    scores = [job.result() for job in jobs]
    report = {
        "model": model_facts(field, model_path),
        "split": dataset.split,
        "sizes": sorted({f"{lens.width}x{lens.height}" for lens in dataset.lenses}),
        "device": str(device),
        "step_factor": options.step_factor,
        "complete": len(scores) == dataset.view_count,
        "mean": mean_scores(scores),
        "views": [plain(asdict(score)) for score in scores],
    }
    if out_dir is not None:
        write_report(report, out_dir / "report.json")
    return report


def render_view(renderer, around, camera, options):
    """Color over white, or over the surroundings if there are any, and α.  uint8 [H, W, 4]"""
    if around is None:
        return renderer.render(camera, options).color_array()
    import torch

    black = replace(options, background=(0.0, 0.0, 0.0))
    origins, directions = camera_rays(camera)
    color, opacity, _ = renderer.render_rays(origins, directions, black)
    parts = []
    with torch.no_grad(), on_warp_stream(renderer.device):
        still = wp.zeros(1, dtype=int, device=renderer.device)
        for first in range(0, len(origins), SURROUNDINGS_RAYS):
            part = slice(first, first + SURROUNDINGS_RAYS)
            rays = [
                wp.array(a[part].astype(np.float32), dtype=wp.vec3, device=renderer.device)
                for a in (origins, directions)
            ]
            front, behind = around(*rays, still)
            mine = [torch.from_numpy(a[part]).to(behind.device) for a in (color, opacity)]
            parts.append(over(front, *mine, behind).cpu().numpy())
    pixels = np.column_stack([np.concatenate(parts), opacity])
    image = np.round(255.0 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8)
    return image.reshape(camera.height, camera.width, 4)


def lacks_surroundings(field, dataset) -> bool:
    """Whether photographs show what was learnt beside the object and is not in the model.

    As trainer.learns_surroundings decides it, for these images.
    """
    options = field.meta.get("options")
    asked = options.get("surroundings") if isinstance(options, dict) else None
    if field.surroundings is not None or asked == "white" or dataset.has_alpha:
        return False
    return asked == "learnt" or not has_white_border(dataset)


def score_view(name, rendered, truth, has_alpha, seconds, lpips=None) -> ViewScore:
    """Score a render (color over white, α in the last channel) against straight-alpha RGBA."""
    a, b = rendered[..., :3] / 255.0, white_composite(truth).astype(np.float64)
    alpha_error = None
    if has_alpha:
        difference = rendered[..., 3].astype(np.float64) - truth[..., 3]
        alpha_error = float(np.abs(difference).mean() / 255.0)
    distance = lpips(a, b) if lpips else None
    return ViewScore(name, psnr(a, b), ssim(a, b), distance, alpha_error, seconds)


def mean_scores(scores) -> dict:
    """The mean of each figure over the views; None where there is none."""
    means = {}
    for name in ("psnr", "ssim", "lpips", "alpha_error", "seconds"):
        values = [getattr(score, name) for score in scores]
        known = values and None not in values
        means[name] = float(np.mean(values)) if known else None
    return plain(means)


def plain(values: dict) -> dict:
    """JSON has no infinity: the PSNR of equal images becomes None."""
    return {
        k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in values.items()
    }


def model_facts(field, path=None) -> dict:
    """How large a model is; its file too, if it comes from one."""
    facts = {
        "vertices": field.mesh.vertex_count,
        "tets": field.mesh.tet_count,
        "levels": field.options.level_count,
        "entries": list(field.layout.entry_counts),
        "occupied_share": occupied_share(field.occupancy),
    }
    if path is not None:
        facts |= {"file": Path(path).name, "bytes": os.path.getsize(path), **parts_of_file(path)}
    known = ("seconds", "stage_1_seconds", "peak_memory_bytes", "levels_below_pixel", "device")
    return facts | {f"training_{k}": field.meta[k] for k in known if k in field.meta}


def side_by_side(rendered, truth):
    """Render, truth over white, their amplified difference, accumulation.  [H, 4 W, 3] uint8"""
    a, b = rendered[..., :3] / 255.0, white_composite(truth)
    difference = np.minimum(DIFFERENCE_GAIN * np.abs(a - b), 1.0)
    accumulation = np.repeat(rendered[..., 3:] / 255.0, 3, axis=2)
    picture = np.concatenate([a, b, difference, accumulation], axis=1)
    return np.round(255.0 * picture).astype(np.uint8)


def track(views):
    """Yield the views under a progress bar with the time left, if there is a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("Evaluating"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        yield from progress.track(views)


def write_report(report, path):
    Path(path).write_text(json.dumps(report, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def print_report(report):
    """A table: a line for each view, then the mean."""

    def cells(row):
        values = (row["psnr"], row["ssim"], row["lpips"], row["alpha_error"], row["seconds"])
        formats = ("{:.2f}", "{:.4f}", "{:.4f}", "{:.4f}", "{:.3f}")
        return ["-" if v is None else f.format(v) for f, v in zip(formats, values, strict=True)]

    facts = report["model"]
    title = f"{facts['tets']} tets, {facts['levels']} levels, {', '.join(report['sizes'])}"
    table = Table("view", title=title)
    for heading in ("PSNR [dB]", "SSIM", "LPIPS", "alpha error", "seconds"):
        table.add_column(heading, justify="right")
    for row in report["views"]:
        table.add_row(row["name"], *cells(row))
    table.add_section()
    label = "mean" if report["complete"] else f"mean of the {len(report['views'])} views done"
    table.add_row(label, *cells(report["mean"]))
    console = Console()
    console.print(table)
    if report["mean"]["lpips"] is None:
        console.print("LPIPS: not computed; --lpips-weights names its weights.")
    console.print(model_line(facts), soft_wrap=True)


def model_line(facts) -> str:
    """What the model weighs, and what it cost."""
    parts = []
    if "bytes" in facts:
        parts.append(f"{facts['bytes'] / 1e6:.2f} MB")
        parts.append(f"mesh {facts['mesh_bytes'] / 1e3:.0f} KB")
        parts.append(f"tables {facts['table_bytes'] / 1e6:.2f} MB")
    parts.append(f"{facts['occupied_share']:.1%} of the sub-tets occupied")
    if "training_seconds" in facts:
        parts.append(f"trained in {facts['training_seconds']:.0f} s")
    memory = facts.get("training_peak_memory_bytes")
    if isinstance(memory, list):
        stages = " and ".join(f"{used / 2**30:.2f}" for used in memory)
        parts.append(f"{stages} GiB of GPU memory in stages 1 and 2")
    return "Model: " + ", ".join(parts)
