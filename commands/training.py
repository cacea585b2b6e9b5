"""deformrf train: photographs with known cameras in, a model file out."""

import os
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from platformdirs import user_state_path

from ..core import field as fields
from ..core import training
from ..core.base import kernel_cache
from ..core.base.arguments import (
    Arg,
    Box,
    Count,
    Data,
    Folder,
    Meters,
    Output,
    object_size,
    with_size,
    writable_file,
)
from ..core.base.device import Choice, device_name
from ..core.base.paths import free_name
from .capturing import check_masks, needs_cameras, prepared
from .checking import check
from .options import parsed
from .running import (
    FAILED,
    INTERRUPTED,
    complain,
    interrupts_waiting,
    is_first,
    load_views,
    require,
    run,
)
from .train_choices import check_resumed_views, for_views, resumed_run, train_options

PROGRAM = "deformrf train"

Number = Annotated[float | None, Arg("R")]
Words = Annotated[tuple[str, ...], Arg("WORD ...")]


@dataclass(frozen=True)
class TrainArguments:
    """Train a model from photographs, or from images with cameras: Blender, nerfstudio,
    instant-ngp, NSVF or COLMAP.

    On N GPUs of one host: torchrun --standalone --nproc-per-node N --no-python deformrf train
    DATA -o FILE
    """

    data: Data
    """Folder of photographs, or a video; or a folder with transforms_train.json, transforms.json,
    rgb/ and pose/, or sparse/0/; or a scan of Polycam or Record3D."""
    output: Output
    """Model file to write, an .npz."""
    preset: Literal["default", "fast", "small", "tiny"] = "default"
    """default: a GPU, minutes; fast: a GPU, a first look; small: a GPU, a quarter of the file,
    quicker to render; tiny: two CPU cores, minutes."""
    device: Choice = "auto"
    """Where the work is done; auto, the default, takes CUDA if there is any."""
    steps: Count = None
    """Optimization steps, divided between the two stages as in the preset."""
    seed: Count = None
    """Seed of all random numbers."""
    image_size: Count = None
    """Shrink the images to this longer side [pixels]; photographs whose cameras are found first,
    by default to 1600."""
    aabb: Box = None
    """The object's box, lowest and highest corner [the data's units]. By default the data's own,
    the one that is found in photographs, or one around the place that the cameras look at."""
    scene_radius: Number = None
    """The same, for a box from -R to R around the data's origin."""
    spacing: Annotated[float | None, Arg("DX")] = None
    """Unit of the mesh's lattice [of the box's longest side]; by default 0.02, or 0.04 with the
    preset tiny. With half of it the mesh bends more finely, and has some six times the tets."""
    surroundings: Literal["auto", "learnt", "white"] = "auto"
    """What is around the object: learnt, by a field of its own; white, or cut out by alpha; auto,
    the default, decides by the images."""
    keep_surroundings: bool = False
    """Store the surroundings in the model, and all that is in the object's box: deformrf eval then
    compares whole images."""
    color_width: Count = None
    """Width of the color network's hidden layers; by default 256, or 128 with the preset small, 64
    with tiny. Narrower is quicker to draw, above all on a CPU, and shows less of what shines."""
    view_dependence: bool = True
    """Colors look the same from all sides, and cost less."""
    leave_out: Words = ()
    """Train without: coarse-stage (one stage; the model then holds the whole grid), subtet-mask
    (tets are occupied as a whole), dense-levels (all are hashed), ray-color (each sample has a
    color, instead of each ray), distortion, table-decay, depth-cost (no such loss), strong-decay
    (it isn't tried), found-box (the object isn't sought: its box is where the cameras look),
    isolation (what it stands and leans on stays), exposure (photographs have one for all),
    blur-weights (blurred photographs count like others)."""
    entry_bits: Literal[8, 16] = 8
    """Bits of each number in the model's tables; 8 halves the file, keeps the few numbers of coarse
    levels in 16, and costs less than 0.01 dB."""
    object_size: Meters = None
    """The object's longest side [m], which the model states: the viewer's material and gravity
    follow it. By default one model unit, about the width of the box, is 1 m."""
    masks: Folder = None
    """Folder of the images' masks, white where the object is: of the same names, or with _mask
    behind them; without it, those that transforms.json names, if it does."""
    mask_with: Annotated[str | None, Arg('"PROGRAM ARG ..."')] = None
    """Instead of --masks: a program that makes masks where cameras are found, such as "rembg i". It
    runs once for each photograph, without a shell, reads the image {in} and writes {out}, which
    come last if no word has them. What it gets wrong is mended by votes of all photographs."""
    hold_out: Literal["sector"] | None = None
    """sector: don't train on the photographs of 60° around the object. Their scores tell how
    well the model shows a side that no training view shows; test images lie between others.
    deformrf eval --split sector scores them, too."""
    check: bool = False
    """Don't train: find the cameras of photographs, and write a page about them, NAME-check.png
    beside NAME.npz."""
    outside_images: bool = False
    """Read images that lie outside DATA, too."""
    resume: bool = False
    """Continue the interrupted run that was to write FILE. Finding cameras always goes on where
    it was interrupted."""
    view: bool = False
    """Show the model while it is trained, in a window where it can be dragged. Training goes on
    when the window is closed."""

    GROUPS = {  # noqa: RUF012
        "The photographs": (
            "image_size",
            "masks",
            "mask_with",
            "hold_out",
            "outside_images",
            "check",
        ),
        "The object": (
            "aabb",
            "scene_radius",
            "object_size",
            "surroundings",
            "keep_surroundings",
        ),
        "The method": (
            "steps",
            "seed",
            "spacing",
            "color_width",
            "view_dependence",
            "entry_bits",
            "leave_out",
        ),
    }


def train_command(prepare: Callable[[TrainArguments], Callable[[], int]]) -> int:
    """Run the command; returns its exit code.

    Args:
        prepare: Checks the arguments and returns the work, as prepare_training does.
    """
    arguments = parsed(PROGRAM, TrainArguments)
    code = run(PROGRAM, lambda: prepare(arguments))
    if "torch.distributed" in sys.modules and training.was_worker():
        # All is written.  A thread of torch's that outlives the group of workers aborts one of them
        # now and then, when Python ends; torchrun would say that the training failed.
        kernel_cache.remove_temporary()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def check_simple(arguments: TrainArguments) -> None:
    """Raise an error for what can be known before anything is read."""
    if not arguments.data.exists():
        raise ValueError(f"there is no {arguments.data}")
    object_size("--object-size", arguments.object_size)
    check_masks(arguments.masks, arguments.mask_with)
    require("torch")


def prepare_training(
    arguments: TrainArguments,
    on_pause: Callable | None = None,
    on_trained: Callable = lambda trained: None,
) -> Callable[[], int]:
    """Check the arguments and read the images; returns the work.

    Args:
        on_pause: For training.train.
        on_trained: Called with its result, before that is written.
    """
    check_simple(arguments)
    output = writable_file(arguments.output, ".npz")
    checkpoint_path = output.with_suffix(".checkpoint")
    # A run that was interrupted while it sought cameras has no checkpoint yet.
    begun = arguments.resume and not needs_cameras(arguments.data)
    resumed = resumed_run(arguments, checkpoint_path) if begun else None
    check_checkpoint(checkpoint_path)
    options = resumed.options if resumed else train_options(arguments)
    arguments = with_cameras(arguments, output, begun)
    sector = held_out(arguments, resumed)
    if arguments.check:
        return lambda: check(arguments.data, output, arguments.outside_images)
    train_views = load_train_views(arguments, options, resumed, sector)
    options = options if resumed else for_views(options, arguments, train_views)
    scored_views = load_scored_views(arguments, sector)
    with interrupts_waiting():  # what an exception ends halfway can't be imported again
        import torch  # noqa: F401
    device = device_name(arguments.device, for_training=True)
    existed = output.exists()

    def job():
        if is_first():
            announce(arguments, device, checkpoint_path)
        try:
            with training.torchrun_workers(device) as workers:
                trained = training.train(
                    train_views,
                    options,
                    device,
                    arguments.data.resolve().name,
                    checkpoint_path,
                    resumed,
                    on_pause=on_pause,
                    workers=workers,
                )
        except training.CheckpointError as error:
            return complain(PROGRAM, str(error))
        on_trained(trained)
        if not workers.is_first:
            return 0  # the first process reports; torchrun would end it if this one failed
        path = output
        if existed and not trained.complete:  # an unfinished model never replaces a finished one
            path = output.with_stem(output.stem + "-interrupted")
        try:
            scores = save(trained, path, arguments, scored_views, device)
        except OSError as error:
            second = second_place(trained, path, arguments)
            kept = checkpoint_path if trained.resumable else None
            return complain(PROGRAM, lost(error, path, second, kept))
        print(summary(trained, path, scores) + keep_whole(trained, path, arguments))
        if "coarse-stage" in options.leave_out:
            print("Without the coarse stage the model holds the whole grid, empty tets too.")
        return ended(trained, scores, checkpoint_path)

    return job


def with_cameras(arguments: TrainArguments, output: Path, begun: bool) -> TrainArguments:
    """The same for the folder of the data set: cameras, and masks, are found first if need be.

    Args:
        begun: The run goes on from its checkpoint, so what made masks then makes none now.
    """
    folder, image_size = prepared(
        arguments.data,
        output,
        arguments.image_size,
        arguments.masks,
        None if begun else arguments.mask_with,
        arguments.device,
    )
    return replace(arguments, data=folder, image_size=image_size)


def check_checkpoint(path: Path) -> None:
    """Raise a ValueError if something else is where the run would write its checkpoints."""
    if path.exists() and not training.is_checkpoint(path):
        raise ValueError(
            f"this run would write its checkpoints to {path}, which is no checkpoint "
            f"of this program: move it, or give the model another name"
        )


def ended(trained, scores: dict, checkpoint_path: Path) -> int:
    """Say how a run ended whose model is written, and what goes on; returns the exit code."""
    if trained.diverged:
        complain(PROGRAM, trained.diverged)
        return FAILED
    if trained.out_of_memory:
        return complain(PROGRAM, trained.out_of_memory)
    if trained.interrupted and trained.resumable:
        print("Continue with the same command and --resume.")
    if trained.complete:
        checkpoint_path.unlink(missing_ok=True)
    for report in scores.values():
        if "not_written" in report:
            return complain(PROGRAM, f"can't add the scores to {report['not_written']}")
    all_done = trained.complete and all(report["complete"] for report in scores.values())
    return 0 if all_done else INTERRUPTED


def held_out(arguments: TrainArguments, resumed):
    """The sector that this run holds out, which is said; None without one.

    A run that goes on keeps what it held out.
    """
    if resumed:
        sector = training.Sector.of_report(resumed.report)
        if arguments.hold_out and not sector:
            raise ValueError("--resume keeps what the interrupted run trained on: drop --hold-out")
    elif arguments.hold_out:
        sector = training.find_sector(arguments.data, arguments.outside_images)
    else:
        sector = None
    if sector and is_first():
        print(f"Held out: {sector.told()}.", file=sys.stderr)
    return sector


def load_train_views(arguments: TrainArguments, options, resumed, sector):
    """The views to train on; a ValueError if they have no box, or are not those of the run."""
    views = load_views(
        arguments.data,
        "train",
        arguments.image_size,
        for_training=True,
        outside=arguments.outside_images,
        masks=arguments.masks,
        sector=sector,
    )
    if resumed:
        check_resumed_views(resumed.report, views)
    training.world_to_unit_cube(views, options.aabb, options.scene_radius)  # raises the error
    return views


def load_scored_views(arguments: TrainArguments, sector) -> dict:
    """The views that score the model, by split: those held out, and the data's own for tests.

    Those for tests are left out if the data set names none, or none of their images is there.
    """
    splits, found = [training.SECTOR] * bool(sector) + ["test"], {}
    for split in splits:
        try:
            found[split] = load_views(
                arguments.data,
                split,
                arguments.image_size,
                outside=arguments.outside_images,
                masks=arguments.masks,
                sector=sector,
            )
        except training.NoSplitError:
            continue
        except training.NoImagesError as error:
            if is_first():
                print(f"The model will not be scored: {error}", file=sys.stderr)
            continue
        for lens in found[split].lenses:
            training.check_size(lens.height, lens.width)
    return found


def announce(arguments: TrainArguments, device: str, checkpoint_path: Path):
    """Say what the user may not expect of this run."""
    if device == "cpu" and arguments.preset != "tiny":
        print("No GPU is used: this takes hours; --preset tiny takes minutes.", flush=True)
    if checkpoint_path.exists() and not arguments.resume:
        print(
            f"An interrupted run left {checkpoint_path}. --resume continues it; without --resume "
            f"this run overwrites it after a minute.",
            flush=True,
        )


def save(trained, path: Path, arguments: TrainArguments, scored_views: dict, device) -> dict:
    """Write the model; if it is complete, score it and write it again with its scores.

    The first writing keeps the model if the evaluation is interrupted; an OSError says that it
    failed.  Returns the reports of the evaluation, by split, without those that Ctrl-C left out.
    """
    kept = model_of(trained, arguments)
    fields.save(kept, path, entry_bits=arguments.entry_bits)
    reports = {}
    for split, views in scored_views.items() if trained.complete else ():
        scored = scored_field(trained, path, views)
        report = training.evaluate(scored, views, None, device, model_path=path, samples=1)
        reports[split] = report
        if not report["complete"]:
            break
    if scores := training.scores_of(reports):
        try:
            fields.save(kept, path, scores, arguments.entry_bits)
        except OSError as error:
            for report in reports.values():
                report["not_written"] = f"{path}: {error.strerror or error}"
    return reports


def scored_field(trained, path: Path, views):
    """The field that these views score.

    It is the file's rounded one, in front of the surroundings of the photographs.  Views without
    alpha show what the object stands on, too, which only the whole field has.
    """
    if trained.whole is not None and not views.has_alpha:
        return trained.whole
    without = views.has_alpha and trained.report.get("object_box")
    surroundings = None if without else trained.field.surroundings
    return replace(fields.load(path), surroundings=surroundings)


def model_of(trained, arguments: TrainArguments):
    """The TetField that is written."""
    shown = trained.whole if arguments.keep_surroundings else None
    kept = with_size(shown or trained.field, arguments.object_size)
    return kept if arguments.keep_surroundings else replace(kept, surroundings=None)


def keep_whole(trained, path: Path, arguments: TrainArguments) -> str:
    """Write the model with what was cut off, if any was, beside the one at `path`; a line of it.

    A file that is there is replaced, or removed, only if it is what an earlier run kept of that
    model.
    """
    place = path.with_stem(path.stem + "-whole")
    if trained.uncut is None or arguments.keep_surroundings:
        return removed_whole(place, path) if trained.complete else ""
    whole = with_size(replace(trained.uncut, surroundings=None), arguments.object_size)
    said = f"\nLeft out what the object stands or leans on: {trained.left_out:.0%} of the matter"
    try:
        if place.exists() and not is_whole_of(place, path):
            place = free_name(place.with_suffix(""), ".npz")
        fields.save(whole, place, {fields.WHOLE_OF: path.name}, arguments.entry_bits)
    except OSError as error:
        return f"{said}; it is lost, can't write {place}: {error.strerror or error}"
    return f"{said}; {place} has all: deformrf view {place}, Isolate."


def removed_whole(place: Path, path: Path) -> str:
    """Remove what an earlier run kept of the model that was at `path`, if it did; a line of it."""
    if not is_whole_of(place, path):
        return ""
    try:
        place.unlink()
    except OSError as error:
        return f"\n{place} is of an earlier model; can't remove it: {error.strerror or error}"
    return f"\nRemoved {place}, which was of an earlier model: from this one nothing was cut off."


def is_whole_of(place: Path, path: Path) -> bool:
    """Whether a file is what an earlier run kept of the model at `path`, as it wrote it."""
    try:
        return fields.load(place).meta.get(fields.WHOLE_OF) == path.name
    except fields.ModelFileError:
        return False


def second_place(trained, path: Path, arguments: TrainArguments) -> Path | None:
    """Write a model that can't be written to `path` elsewhere; returns where, None if nowhere."""
    for folder in (user_state_path("deformrf") / "models", Path(tempfile.gettempdir())):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            place = free_name(folder / path.stem, path.suffix)
            fields.save(model_of(trained, arguments), place, entry_bits=arguments.entry_bits)
        except OSError:  # as full as the first
            continue
        return place
    return None


def lost(error: OSError, path: Path, second: Path | None, checkpoint_path: Path | None) -> str:
    """Why the model could not be written, where it is instead, and the run's checkpoint."""
    said = [f"can't write {path}: {error.strerror or error}"]
    if second:
        said.append(f"the model is in {second}, without scores")
    if checkpoint_path:
        said.append(f"the run is kept in {checkpoint_path}: make room, then add --resume")
    elif not second:
        said.append("the run has no checkpoint to continue from")
    return "; ".join(said)


def score_line(scores: dict) -> str:
    """The mean scores of views, as text; "" if they are unknown."""
    mean = scores["mean"]
    if mean["psnr"] is None:
        return ""
    return f"{mean['psnr']:.2f} dB and SSIM {mean['ssim']:.4f}"


def angle_line(scores: dict) -> str:
    """How far views are from those of the training, to follow a text about them."""
    told = training.angles_told(scores["angles"])
    return told and f", {told}"


def summary(trained, path: Path, scores: dict) -> str:
    """The written file and the model's figures, as text."""
    begun = "Wrote" if trained.complete else "Stopped early; wrote the unfinished model"
    size, minutes = path.stat().st_size / 1e6, trained.report["seconds"] / 60
    text = f"{begun}: {path}, {trained.field.mesh.tet_count} tets, {size:.1f} MB"
    text += f", {minutes:.1f} minutes of training"
    complete = {split: report for split, report in scores.items() if report["complete"]}
    test, sector = complete.get("test"), complete.get(training.SECTOR)
    if told := test and score_line(test):
        text += f", {told} on the test views"
    if told := sector and score_line(sector):
        text += (
            f"\nHeld-out sector: {told} on its {sector['view_count']} views{angle_line(sector)}."
        )
    other = test and test.get("sector", {}).get("outside")
    if told := other and score_line(other):
        text += f"\nTest views elsewhere: {told} on {other['view_count']} views{angle_line(other)}."
    if spread := trained.report.get("exposure_spread"):
        left = trained.report.get("exposure_left")
        look = "colors follow them" if left else "the model has the mean one"
        text += f"\nThe photographs' exposures differ by {spread:.1%}; {look}."
    if out := trained.report.get("levels_left_out"):
        text += f"\nFinest levels left out, because no image shows them: {out}."
    return text
