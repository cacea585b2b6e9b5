"""deformrf eval: a model's scores on views that it was not trained on."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from rich.console import Console
from rich.table import Table

from ..core import field as fields
from ..core import render, training
from ..core.base.arguments import Arg, Count, Data, File, Folder, Model, writable_file
from ..core.base.device import Choice, device_name
from .options import parsed
from .running import INTERRUPTED, complain, load_views, require, run

PROGRAM = "deformrf eval"
MOST_SAMPLES = 256


@dataclass(frozen=True)
class EvaluateArguments:
    """Score a model on images that it has not seen: PSNR and SSIM over white."""

    model: Model
    """Model file, an .npz."""
    data: Data
    """Folder of the data set, as for deformrf train."""
    output: Annotated[File, Arg("FILE", short="-o")] = None
    """File to write, a .json: the scores of each view, and their mean."""
    pictures: Folder = None
    """Folder to write pictures of each view to: render, truth, difference (x4), accumulation."""
    lpips_weights: File = None
    """Weights of VGG-16 for LPIPS: torchvision's vgg16-397923af.pth, a folder that holds it, or
    one file of the package lpips. None come with this program."""
    split: Literal["train", "val", "test", "sector"] = "test"
    """Which views of the data set; sector: those that deformrf train --hold-out sector left out."""
    views: Count = None
    """Score that many views, spread evenly, instead of all."""
    image_size: Count = None
    """Shrink the images to this longer side [pixels]."""
    step_factor: Annotated[float, Arg("FACTOR")] = 1.0
    """Length of the steps along a ray, over the model's: 0.5 takes longer and comes closer."""
    samples: Annotated[int, Arg("N")] = 4
    """Rays a pixel of the scored images: cameras average over a pixel, too. Beside that stands the
    PSNR of images with one ray a pixel, and what one of them takes."""
    outside_images: bool = False
    """Read images that lie outside DATA, too."""
    device: Choice = "auto"
    """Where the work is done; auto, the default, takes CUDA if there is any."""


def main() -> int:
    arguments = parsed(PROGRAM, EvaluateArguments)
    return run(PROGRAM, lambda: prepare(arguments))


def prepare(arguments: EvaluateArguments):
    """Check the arguments and read images and model; returns the work."""
    check_numbers(arguments)
    if arguments.lpips_weights:
        require("torch", "lpips", "torchvision")
    field = fields.load(arguments.model)
    dataset = load_views(
        arguments.data,
        arguments.split,
        arguments.image_size,
        arguments.views,
        outside=arguments.outside_images,
        sector=sector_of(field, arguments),
    )
    check_places(arguments, dataset)
    device = device_name(arguments.device)
    lpips = None
    if arguments.lpips_weights:
        lpips = training.Lpips(arguments.lpips_weights, device)
    if field.surroundings is not None:
        require("torch")

    def job():
        if training.lacks_surroundings(field, dataset):
            print(
                "The object alone is scored, over white, against photographs with their "
                "surroundings; deformrf train --keep-surroundings keeps them in the model.",
                file=sys.stderr,
                flush=True,
            )
        report = training.evaluate(
            field,
            dataset,
            out_dir=arguments.pictures,
            device=device,
            options=render.RenderOptions(step_factor=arguments.step_factor),
            model_path=arguments.model,
            lpips=lpips,
            samples=arguments.samples,
        )
        return tell(report, arguments.output)

    return job


def sector_of(field, arguments: EvaluateArguments):
    """The sector that the model's training held out, if its views are asked for, else None."""
    if arguments.split != training.SECTOR:
        return None
    sector = training.Sector.of_report(field.meta)
    if sector is None:
        raise ValueError(
            f"the training of {arguments.model} held no sector out: train with --hold-out sector, "
            f"then --split sector scores what it left out"
        )
    return sector


def check_numbers(arguments: EvaluateArguments) -> None:
    """Raise a ValueError if a number can't be."""
    if not 0.01 <= arguments.step_factor <= 100.0:
        raise ValueError(f"--step-factor is {arguments.step_factor:g}; give 0.01 to 100")
    if not 1 <= arguments.samples <= MOST_SAMPLES:
        raise ValueError(f"--samples is {arguments.samples}; give 1 to {MOST_SAMPLES}")


def check_places(arguments: EvaluateArguments, dataset) -> None:
    """Raise a ValueError or OSError if images are too small, or files can't be written."""
    for lens in dataset.lenses:
        training.check_size(lens.height, lens.width)
        if arguments.lpips_weights:
            training.check_size(lens.height, lens.width, "LPIPS", training.LPIPS_SIZE_MIN)
    if arguments.output:
        training.check_replaceable(writable_file(arguments.output, ".json"))
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
        training.check_replaceable(*training.output_paths(arguments.pictures, dataset))


def tell(report: dict, path: Path | None) -> int:
    """Print the report, and write it to a path; returns the exit code."""
    print_report(report)
    not_written = report.get("not_written")
    if path:
        try:
            training.write_report(report, path)
        except OSError as error:
            not_written = f"{path}: {error.strerror or error}"
    if not_written:
        return complain(PROGRAM, f"can't write {not_written}")
    return 0 if report["complete"] else INTERRUPTED


def print_report(report):
    """A table: a line for each view, then the mean."""

    columns = {
        "psnr": ("PSNR (dB)", "{:.2f}"),
        "ssim": ("SSIM", "{:.4f}"),
        "lpips": ("LPIPS", "{:.4f}"),
        "alpha_error": ("alpha error", "{:.4f}"),
        "psnr_one_ray": ("one ray (dB)", "{:.2f}"),
        "seconds": ("seconds", "{:.3f}"),
        "angle": ("nearest (°)", "{:.1f}"),
    }
    if report["angles"] is None:
        del columns["angle"]
    if report["mean"]["lpips"] is None:
        del columns["lpips"]
    if report["samples"] == 1:
        del columns["psnr_one_ray"]

    def cells(row):
        values = ((row[name], form) for name, (_, form) in columns.items())
        return ["-" if value is None else form.format(value) for value, form in values]

    facts = report["model"]
    title = f"{facts['tets']} tets, {facts['levels']} levels, {', '.join(report['sizes'])}"
    table = Table("view", title=title)
    for heading, _ in columns.values():
        table.add_column(heading, justify="right")
    for row in report["views"]:
        table.add_row(row["name"], *cells(row))
    table.add_section()
    table.add_row("mean", *cells(report["mean"]))
    console = Console()
    console.print(table)
    if not report["complete"]:
        done = len(report["views"])
        console.print(f"Interrupted: the mean is that of the {done} views done.", soft_wrap=True)
    if report["samples"] > 1:
        rays = f"Scored with {report['samples']} rays a pixel; seconds are of an image with one."
        console.print(rays, soft_wrap=True)
    for line in angle_lines(report):
        console.print(line, soft_wrap=True)
    if report["mean"]["lpips"] is None:
        console.print("LPIPS: not computed; --lpips-weights names its weights.")
    console.print(model_line(facts), soft_wrap=True)


def angle_lines(report) -> list[str]:
    """How far the views are from those of the training, and what that means for their scores."""
    lines = []
    if told := training.angles_told(report["angles"]):
        lines.append(f"The views are {told}.")
    parts = report.get("sector", {})
    if parts and all(part["mean"]["psnr"] is not None for part in parts.values()):
        inside, outside = parts["inside"], parts["outside"]
        lines.append(
            f"{inside['view_count']} of the views lie in the sector that training held out: "
            f"{inside['mean']['psnr']:.2f} dB there, {outside['mean']['psnr']:.2f} dB elsewhere."
        )
    return lines


def model_line(facts) -> str:
    """The size of the model and the cost of its training."""
    said = []
    if "bytes" in facts:
        said.append(f"{facts['bytes'] / 1e6:.2f} MB")
        said.append(f"mesh {facts['mesh_bytes'] / 1e3:.0f} KB")
        said.append(f"tables {facts['table_bytes'] / 1e6:.2f} MB")
    said.append(f"{facts['occupied_share']:.1%} of the sub-tets occupied")
    if "training_seconds" in facts:
        said.append(f"trained in {facts['training_seconds']:.0f} s")
    memory = facts.get("training_peak_memory_bytes")
    if isinstance(memory, list):
        stages = " and ".join(f"{used / 2**30:.2f}" for used in memory)
        said.append(f"{stages} GiB of GPU memory in stages 1 and 2")
    return "Model: " + ", ".join(said)
