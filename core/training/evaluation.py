"""Compare a model with images that it has not seen: PSNR, SSIM and opacity, view by view.

Render and truth are composited over white.  A pixel of a photograph is a mean over the pixel's
area, and so is a pixel of a scored render, as in the viewer at rest.  A second score is that of an
image with one ray a pixel, as in the viewer while things move.  The time in seconds is that of one
such image and its copy to the host, without the first compilation of the kernels.

If a mask does not tell whether a pixel shows the object (data/masks.py), that pixel is left out.
SSIM and LPIPS look at windows: they are given the render's color there.

Beside each view's scores stands its angle to the nearest training view, seen from the point that
the training views look at: scores fall with it.
"""

import json
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from PIL import Image

from ..base.device import thread_count
from ..base.paths import whole_file
from ..base.reading import read_text
from ..field import TetField, bytes_of_file, occupied_share
from ..render import Camera, Renderer, RenderOptions, camera_rays, in_space, spread
from .data.datasets import Dataset, track, white_composite
from .data.masks import UNTOLD
from .data.scene_box import learns_surroundings
from .data.sector import SECTOR
from .metrics import check_size, psnr, ssim
from .nearness import Nearness, median_and_largest

REPORT = "report.json"
REPORT_KEYS = {"model", "split", "mean", "views"}
# Of a view.
FIGURES = ("psnr", "ssim", "lpips", "alpha_error", "psnr_one_ray", "seconds", "angle")
SURROUNDINGS_RAYS = 1 << 14  # at once: 64 samples each
WAITING_VIEWS = 32  # at most, rendered and not scored yet: images would fill the memory
DIFFERENCE_GAIN = 4.0  # errors of a few percent have to be visible


def evaluate(
    field: TetField,
    dataset: Dataset,
    out_dir: str | Path | None = None,
    device: str = "cpu",
    options: RenderOptions | None = None,
    model_path: str | Path | None = None,
    lpips: Callable[[np.ndarray, np.ndarray], float] | None = None,
    samples: int = 4,
) -> dict[str, Any]:
    """Render every view of a data set and score it.

    Ctrl-C ends it early: the report then holds the views that are done, and "complete" is False.
    If a file can't be written, the scores go on without files, and "not_written" names the file
    and the reason.

    Args:
        out_dir: Folder of report.json and an image per view: render, truth, their difference
            and the render's accumulation (opacity).
        options: RenderOptions; their background is replaced by white.
        model_path: The file that the field came from; the report then says its size.
        lpips: An Lpips with its weights; None leaves that metric out.
        samples: Rays a pixel of the scored renders, spread over it.

    Returns:
        The report, plain JSON values.

    Raises:
        ValueError: An image is too small for SSIM, or `out_dir` holds another program's files.
    """
    for lens in dataset.lenses:
        check_size(lens.height, lens.width)
    paths = output_paths(out_dir, dataset) if out_dir is not None else None
    if paths:
        check_replaceable(*paths)
        paths[0].parent.mkdir(parents=True, exist_ok=True)
    options = replace(options or RenderOptions(), background=(1.0, 1.0, 1.0))
    facts = {
        "model": model_facts(field, model_path),
        "split": dataset.split,
        "sizes": sorted({f"{lens.width}x{lens.height}" for lens in dataset.lenses}),
        "device": str(device),
        "step_factor": options.step_factor,
        "samples": samples,
    }
    scoring = Scoring(dataset, Nearness.of(field, dataset), paths, lpips, facts)
    renderer, around = Renderer(field, device=device), surroundings_of(field, device)
    poses = in_space(dataset.poses, field.world_to_model)
    views = [Camera(pose, lens) for pose, lens in zip(poses, dataset.lenses, strict=True)]
    small = Camera(poses[0], dataset.lenses[0].resized(8, 8))
    render_view(renderer, around, small, options)  # compiles the kernels
    scoring.report([])  # if the run is killed, it shows that the pictures are ours

    def render(camera):
        """The scored image, the one with one ray a pixel, and the seconds of that one."""
        begin = time.perf_counter()
        one_ray = render_view(renderer, around, camera, options)
        seconds = time.perf_counter() - begin
        image = render_view(renderer, around, camera, options, samples) if samples > 1 else one_ray
        return image, one_ray, seconds

    # On a GPU SSIM takes longer than a render.  On the CPU it would slow the render down.
    waiting = WAITING_VIEWS if wp.get_device(device).is_cuda else 1
    report = scoring.report(score_views(views, render, scoring, waiting))
    if scoring.failures:
        report["not_written"] = scoring.failures[0]
    return report


class Scoring:
    """The scores of views, and the files that they are written to.

    Attributes:
        nearness: Of the views to those of the training.
        paths: As `output_paths` gives them; None writes no files.
        facts: The first entries of the report.
        failures: Files that couldn't be written, with the reasons.
    """

    def __init__(
        self, dataset: Dataset, nearness: Nearness, paths: list[Path] | None, lpips, facts: dict
    ):
        self.dataset, self.nearness = dataset, nearness
        self.paths, self.lpips, self.facts = paths, lpips, facts
        self.failures: list[str] = []
        self._has_alpha = dataset.has_alpha

    def score(self, index: int, rendered, one_ray, seconds: float) -> dict:
        """The row of a view in the report; writes its picture."""
        truth = self.dataset.image(index)
        if self.paths:
            picture = Image.fromarray(side_by_side(rendered, truth))
            self._write(self.paths[1 + index], lambda partial: picture.save(partial, "PNG"))
        told = (truth[..., 3] != UNTOLD) | (not self.dataset.masked)
        scores = score_view(rendered, truth, told, self._has_alpha, self.lpips)
        scores["psnr_one_ray"] = psnr_of(one_ray, truth, told)
        scores |= {"seconds": seconds, **self.nearness.of_view(index)}
        return {"name": self.dataset.names[index], **scores}

    def report(self, rows: list[dict]) -> dict:
        """The report of these views; writes it."""
        report = self.facts | {
            "complete": len(rows) == self.dataset.view_count,
            **summary(rows),
            "views": rows,
        }
        if self.nearness.inside is not None:
            report["sector"] = {
                word: summary([row for row in rows if row["in_sector"] == inside])
                for word, inside in (("inside", True), ("outside", False))
            }
        if self.paths:
            text = as_json(report)
            self._write(self.paths[0], lambda partial: partial.write_text(text, encoding="utf-8"))
        return report

    def _write(self, path: Path, save) -> None:
        try:
            with whole_file(path) as partial:
                save(partial)
        except OSError as error:
            self.failures.append(f"{path}: {error.strerror or error}")


def summary(rows: list[dict]) -> dict:
    """What a report says of several views together."""
    return {
        "view_count": len(rows),
        "mean": {name: mean([row[name] for row in rows]) for name in FIGURES},
        "angles": median_and_largest([row["angle"] for row in rows]),
    }


def scores_of(reports: dict[str, dict]) -> dict[str, Any]:
    """What a model's file keeps of its evaluations, by split: docs/model-format.md has the keys.

    Those that were interrupted are left out.
    """
    reports = {split: report for split, report in reports.items() if report["complete"]}
    scores, keys = {}, ("view_count", "mean", "angles")
    if test := reports.get("test"):
        scores = {f"test_{key}": test[key] for key in keys}
    if sector := reports.get(SECTOR):
        parts = {"held_out": sector}
        parts |= {f"test_{word}": part for word, part in (test or {}).get("sector", {}).items()}
        scores["sector_scores"] = {
            word: {key: part[key] for key in keys} for word, part in parts.items()
        }
    return scores


def score_views(views, render, scoring: Scoring, waiting: int) -> list[dict]:
    """The rows of the views, rendered one after the other and scored beside that.

    Ctrl-C ends it early, with the rows of the views that are done.

    Args:
        render: Gives a camera's images and seconds, as `Scoring.score` takes them.
        waiting: Views that are rendered and not scored yet, at most.
    """
    jobs = []
    with ThreadPoolExecutor(thread_count()) as pool:
        try:
            for index, camera in enumerate(track(views, len(views), "Evaluating")):
                jobs.append(pool.submit(scoring.score, index, *render(camera)))
                if len(jobs) >= waiting:
                    jobs[-waiting].result()
            wait(jobs)
        except KeyboardInterrupt:
            pass  # the report says that it is not complete
    return [job.result() for job in jobs]


def surroundings_of(field: TetField, device):
    """The field's surroundings on the device; None without any."""
    if field.surroundings is None:
        return None
    from .run.surroundings import LearnedSurroundings  # with torch

    return LearnedSurroundings(field.surroundings, device)


def output_paths(out_dir: str | Path, dataset: Dataset) -> list[Path]:
    """The files that `evaluate` writes: the report, then a picture of each view."""
    names = (f"{index:03d}_{name}.png" for index, name in enumerate(dataset.names))
    return [Path(out_dir) / name for name in (REPORT, *names)]


def check_replaceable(report_path: Path, *picture_paths: Path) -> None:
    """Raise ValueError if a file with content exists that `evaluate` did not write."""
    if is_report(report_path):
        return  # the pictures beside it are ours too
    for path in (report_path, *picture_paths):
        if path.exists() and path.stat().st_size:
            raise ValueError(
                f"{path} exists and is not a file of deformrf eval, which would overwrite it: "
                f"give another name"
            )


def is_report(path: Path) -> bool:
    try:
        content = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.keys() >= REPORT_KEYS


def render_view(renderer, around, camera, options, samples=1):
    """Color over white, or over the surroundings if there are any, and α.  uint8 [H, W, 4]"""
    if samples > 1:
        cameras = spread(camera, samples)
        images = (render_view(renderer, around, c, options).astype(np.uint16) for c in cameras)
        return np.round(sum(images) / samples).astype(np.uint8)
    if around is None:
        return renderer.render(camera, options).color_array()
    import torch

    from .run.differentiable import on_warp_stream
    from .run.surroundings import over

    black = replace(options, background=(0.0, 0.0, 0.0))
    origins, directions = camera_rays(camera)
    color, opacity, _ = renderer.render_rays(origins, directions, black)
    colors = []
    with torch.no_grad(), on_warp_stream(renderer.device):
        still = wp.zeros(1, dtype=int, device=renderer.device)
        for first in range(0, len(origins), SURROUNDINGS_RAYS):
            some = slice(first, first + SURROUNDINGS_RAYS)
            rays = [
                wp.array(a[some].astype(np.float32), dtype=wp.vec3, device=renderer.device)
                for a in (origins, directions)
            ]
            front, behind = around(*rays, still)
            mine = [torch.from_numpy(a[some]).to(behind.device) for a in (color, opacity)]
            colors.append(over(front, *mine, behind).cpu().numpy())
    pixels = np.column_stack([np.concatenate(colors), opacity])
    image = np.round(255.0 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8)
    return image.reshape(camera.height, camera.width, 4)


def lacks_surroundings(field: TetField, dataset: Dataset) -> bool:
    """Whether photographs show surroundings that training learned and the model does not hold."""
    options = field.meta.get("options")
    choice = options.get("surroundings", "auto") if isinstance(options, dict) else "auto"
    if field.surroundings is not None or dataset.has_alpha:
        return False
    return learns_surroundings(choice, dataset)


def score_view(rendered, truth, told, has_alpha, lpips=None) -> dict:
    """Compare a render (color over white, α in the last channel) with straight-alpha RGBA.

    Args:
        told: Pixels that are compared.  [H, W] bool

    Returns:
        "psnr" in dB (None for equal images: JSON has no infinity), "ssim", "lpips" (None
        without that metric) and "alpha_error", the mean of |Δα| (None without alpha).  Where no
        pixel is told, "psnr" and "alpha_error" are None.
    """
    a, b = rendered[..., :3] / 255.0, white_composite(truth).astype(np.float64)
    b = np.where(told[..., None], b, a)
    alpha_error = None
    if has_alpha and told.any():
        difference = rendered[told, 3].astype(np.float64) - truth[told, 3]
        alpha_error = float(np.abs(difference).mean() / 255.0)
    return {
        "psnr": psnr_of(rendered, truth, told),
        "ssim": ssim(a, b),
        "lpips": lpips(a, b) if lpips else None,
        "alpha_error": alpha_error,
    }


def psnr_of(rendered, truth, told) -> float | None:
    """PSNR of a render as in `score_view`."""
    if not told.any():
        return None
    a, b = rendered[told, :3] / 255.0, white_composite(truth)[told].astype(np.float64)
    decibels = psnr(a, b)
    return decibels if np.isfinite(decibels) else None


def mean(values) -> float | None:
    """The mean; None without values, or if one of them is None."""
    return float(np.mean(values)) if values and None not in values else None


def model_facts(field, path=None) -> dict:
    """Sizes of a model, and of its file if it has one."""
    facts = {
        "vertices": field.mesh.vertex_count,
        "tets": field.mesh.tet_count,
        "levels": field.options.level_count,
        "entries": list(field.layout.entry_counts),
        "occupied_share": occupied_share(field.occupancy),
    }
    if path is not None:
        path = Path(path)
        facts |= {"file": path.name, "bytes": path.stat().st_size, **bytes_of_file(path)}
    known = ("seconds", "stage_1_seconds", "peak_memory_bytes", "levels_left_out", "device")
    return facts | {f"training_{k}": field.meta[k] for k in known if k in field.meta}


def side_by_side(rendered, truth):
    """Render, truth over white, their amplified difference, accumulation.  [H, 4 W, 3] uint8"""
    a, b = rendered[..., :3] / 255.0, white_composite(truth)
    difference = np.minimum(DIFFERENCE_GAIN * np.abs(a - b), 1.0)
    accumulation = np.repeat(rendered[..., 3:] / 255.0, 3, axis=2)
    picture = np.concatenate([a, b, difference, accumulation], axis=1)
    return np.round(255.0 * picture).astype(np.uint8)


def write_report(report: dict[str, Any], path: Path) -> None:
    with whole_file(path) as partial:
        partial.write_text(as_json(report), encoding="utf-8")


def as_json(report: dict) -> str:
    return json.dumps(report, indent=1, allow_nan=False) + "\n"
