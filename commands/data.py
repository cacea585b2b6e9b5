"""deformrf data: something to train on.

    toy     72 photographs of a made-up toy, which come with the program
    chair   where the data set NeRF-synthetic is to be had, and a check of a folder of it

Nothing is fetched.
"""

import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from ..core import training
from ..core.base.arguments import Arg, writable_file
from ..core.base.paths import ASSETS, kind_of, whole_files
from ..core.base.streams import printable
from .options import OnCpu, parsed_one
from .running import FAILED, run

PROGRAM = "deformrf data"
TOY = ASSETS / "toy"
PROJECT_PAGE = "https://www.matthewtancik.com/nerf"
SPLITS = {"train": "training", "test": "test"}

NewFolder = Annotated[Path, Arg("FOLDER", positional=True)]
DataSet = Annotated[Path | None, Arg("FOLDER", positional=True)]


@dataclass(frozen=True)
class ToyArguments(OnCpu):
    """Write 72 photographs of a toy on a table into a folder, to train on."""

    folder: NewFolder = Path("toy")
    """A folder that is new or empty."""


@dataclass(frozen=True)
class ChairArguments(OnCpu):
    """Say where NeRF-synthetic's chair is to be had, or check a folder that has it."""

    folder: DataSet = None
    """The folder that has transforms_train.json and transforms_test.json."""


def main() -> int:
    program, arguments, prepare = parsed_one(PROGRAM, "Something to train on.", COMMANDS)
    return run(program, lambda: prepare(arguments))


def prepare_toy(arguments: ToyArguments):
    folder, photographs = arguments.folder, sorted(TOY.glob("*.jpg"))
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is {kind_of(folder)}: give a new or an empty folder")
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} is not empty: give a new or an empty folder")
    paths = [folder / photograph.name for photograph in photographs]
    writable_file(paths[0], ".jpg")  # makes the folder

    def job():
        with whole_files(paths) as partials:
            for photograph, partial in zip(photographs, partials, strict=True):
                shutil.copyfile(photograph, partial)
        size = sum(path.stat().st_size for path in paths) / 1e6
        print(printable(f"Wrote {folder}: {len(paths)} photographs, {size:.1f} MB (CC0 1.0)."))
        print(f"Train on them: {training_command(folder, 'toy')} --preset tiny")
        return 0

    return job


def prepare_chair(arguments: ChairArguments):
    folder = arguments.folder
    if folder is None:
        return tell_origin
    listings = {split: listing_of(folder, split) for split in SPLITS}

    def job():
        for split, listing in listings.items():
            missing, images = len(listing.missing), listing.images
            width, height = training.size_of(images[0])
            line = f"{len(images)} of {len(images) + missing} {SPLITS[split]} images are there"
            print(f"{line}, the first of {width}x{height} pixels.")
            if missing:
                print(printable(f"The first that is missing is {listing.missing[0]}."))
        if any(listing.missing for listing in listings.values()):
            return FAILED
        print(f"Train on them: {training_command(folder, folder.resolve().name)}")
        return 0

    return job


def tell_origin() -> int:
    print(
        f"The chair is one of the eight objects of the data set NeRF-synthetic, made by the "
        f"authors of NeRF: {PROJECT_PAGE} links to it. 100 images to train on and 200 "
        f"to test with, of 800x800 pixels, with a clear background and known cameras.\n"
        f"This program fetches nothing. Unpack nerf_synthetic.zip, then check the folder: "
        f"{PROGRAM} chair nerf_synthetic/chair"
    )
    return 0


def listing_of(folder: Path, split: str):
    """The images of a split; ValueError unless there are some, and the first can be read."""
    if not folder.is_dir():
        raise ValueError(f"{folder} is no folder: give the one of NeRF-synthetic's chair")
    path = folder / f"transforms_{split}.json"
    if not path.is_file():
        inner = sorted(other.parent for other in folder.glob(f"*/{path.name}"))
        advice = f"give {inner[0]}" if inner else "give the folder that has it, as .../chair"
        raise ValueError(f"{folder} is no object of NeRF-synthetic, without {path.name}: {advice}")
    listing = training.list_images(folder, split)
    training.check_some(listing.images, listing.missing, split)
    width, height = training.size_of(listing.images[0])
    training.read_image(listing.images[0], width, height)
    return listing


def training_command(folder: Path, name: str) -> str:
    return f"deformrf train {shlex.quote(str(folder))} -o {shlex.quote(f'{name}.npz')}"


COMMANDS = {  # subcommand: its arguments, and what prepares it
    "toy": (ToyArguments, prepare_toy),
    "chair": (ChairArguments, prepare_chair),
}
