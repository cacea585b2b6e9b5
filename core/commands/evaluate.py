"""deformrf-eval: a model's scores on views that it was not trained on."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ..arguments import Count, File, writable_file
from ..device import Choice, device_name
from .running import INPUT_ERROR, INTERRUPTED, require, run
from .train import warn_of_missing

PROGRAM = "deformrf-eval"
SPLITS = ("train", "val", "test")


@dataclass(frozen=True)
class EvaluateArguments:
    """Score a model on images that it has not seen: PSNR and SSIM over white."""

    model: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="MODEL")]
    """Model file, an .npz."""
    data: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DATA")]
    """Folder of the data set, as for deformrf-train."""
    json: File = None
    """Write the scores of each view and their mean to this file."""
    images: File = None
    """Write render, truth, difference (x4) and accumulation of each view to this folder."""
    lpips_weights: File = None
    """Weights of LPIPS with VGG-16: one file of the package lpips, or a folder with
    vgg16-397923af.pth and vgg.pth.  None come with this program."""
    split: str = "test"
    """Which views: train, val or test."""
    views: Count = None
    """Score that many views, spread evenly, instead of all."""
    image_size: Count = None
    """Shrink the images to this longer side [pixels]."""
    step_factor: float = 1.0
    """March with that part of the model's step: 0.5 takes longer and comes closer."""
    device: Choice = "auto"
    """auto takes CUDA if there is any."""


def main():
    """The command deformrf-eval."""
    arguments = tyro.cli(EvaluateArguments, prog=PROGRAM)
    sys.exit(run(PROGRAM, lambda: prepare(arguments)))


def prepare(arguments: EvaluateArguments):
    """Check the arguments and read images and model; returns the work."""
    from ..training import check_size, load_dataset

    if not 0.01 <= arguments.step_factor <= 100.0:
        raise ValueError(f"--step-factor is {arguments.step_factor:g}; give 0.01 to 100")
    if arguments.split not in SPLITS:
        raise ValueError(f"--split is {arguments.split!r}; give {', '.join(SPLITS)}")
    # The cheap checks first: importing the renderer takes a second.
    dataset = load_dataset(arguments.data, arguments.split, arguments.image_size, arguments.views)
    warn_of_missing(dataset)
    for lens in dataset.lenses:
        check_size(lens.height, lens.width)
    json_path = arguments.json and writable_file(arguments.json, ".json")
    if arguments.images:
        arguments.images.mkdir(parents=True, exist_ok=True)
    device = device_name(arguments.device)
    lpips = None
    if arguments.lpips_weights:
        from ..training import Lpips

        for lens in dataset.lenses:
            Lpips.check_size(lens.height, lens.width)
        lpips = Lpips(arguments.lpips_weights, device)

    from ..field import load
    from ..render import RenderOptions
    from ..training import evaluate, lacks_surroundings, print_report, write_report

    field = load(arguments.model)
    options = RenderOptions(step_factor=arguments.step_factor)

    def job():
        if lacks_surroundings(field, dataset):
            print(
                "The object alone is scored, over white, against photographs with their "
                "surroundings; deformrf-train --keep-surroundings keeps them in the model.",
                file=sys.stderr,
                flush=True,
            )
        report = evaluate(
            field, dataset, arguments.images, device, options, arguments.model, lpips
        )
        print_report(report)
        if json_path:
            write_report(report, json_path)
        return 0 if report["complete"] else INTERRUPTED

    return job
