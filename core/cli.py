"""deformrf-train and deformrf-eval: parse, check, call, print.

A command first prepares: whatever the user can get wrong is found there, and ends in one
sentence on stderr and exit code 2.  Then it works.  Ctrl-C ends it with 130, after what is
done has been written.  Slow imports wait until the arguments are known to be good.
"""

import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from .arguments import Count, File, at_least, plain_message, writable_file
from .device import Choice, device_name

DIVERGED, INPUT_ERROR, INTERRUPTED = 1, 2, 130  # exit codes
FIRST_SECONDS = 10.0  # what the first of several processes may take longer to find an error
SPLITS = ("train", "val", "test")

Number = Annotated[float | None, tyro.conf.arg(metavar="R", help_behavior_hint="")]
Box = Annotated[
    tuple[float, float, float, float, float, float] | None,
    tyro.conf.arg(metavar="X0 Y0 Z0 X1 Y1 Z1", help_behavior_hint=""),
]
Words = Annotated[tuple[str, ...], tyro.conf.arg(metavar="WORD ...", help_behavior_hint="")]
Data = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DATA")]
Model = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="MODEL")]


@dataclass(frozen=True)
class TrainArguments:
    """Train a model from posed images: Blender, nerfstudio, instant-ngp, NSVF or COLMAP.

    On N GPUs of one host: torchrun --standalone --nproc-per-node N --no-python deformrf-train
    DATA -o MODEL.
    """

    data: Data
    """Folder with transforms_train.json, transforms.json, rgb/ and pose/, or sparse/0/."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="MODEL")]
    """Model file to write, an .npz."""
    preset: Literal["default", "fast", "small", "tiny"] = "default"
    """default: a GPU, minutes; fast: a GPU, a first look; small: a GPU, a quarter of the file,
    quicker to render; tiny: two CPU cores, minutes."""
    device: Choice = "auto"
    """auto takes CUDA if there is any."""
    steps: Count = None
    """Optimization steps, shared out between the two stages as in the preset."""
    seed: Count = None
    """Of everything random; the same seed draws the same random numbers."""
    image_size: Count = None
    """Shrink the images to this longer side [pixels]."""
    aabb: Box = None
    """The object's box, lowest and highest corner [the data's units]; else the data's own box,
    or one around the place that the cameras look at."""
    scene_radius: Number = None
    """The same, for a box from -R to R around the data's origin."""
    surroundings: Literal["auto", "learnt", "white"] = "auto"
    """What is around the object: learnt beside it, or white (or cut out by alpha); auto looks
    at the images."""
    keep_surroundings: bool = False
    """Store the surroundings in the model, so that deformrf-eval can compare whole images."""
    view_dependence: bool = True
    """Without it colors look the same from all sides, and cost less."""
    leave_out: Words = ()
    """Train without: coarse-stage (one stage; the model then holds the whole grid), subtet-mask
    (tets are occupied as a whole), dense-levels (all are hashed), distortion (no such loss)."""
    entry_bits: Literal[8, 16] = 8
    """Of each number in the model's tables; 8 halves the file and costs less than 0.01 dB."""
    resume: bool = False
    """Go on with the run that was to write MODEL and was interrupted."""


@dataclass(frozen=True)
class EvaluateArguments:
    """Score a model on images that it has not seen: PSNR and SSIM over white."""

    model: Model
    """Model file, an .npz."""
    data: Data
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


def train():
    """The command deformrf-train."""
    arguments = tyro.cli(TrainArguments, prog="deformrf-train")
    sys.exit(run("deformrf-train", lambda: prepare_training(arguments)))


def evaluate():
    """The command deformrf-eval."""
    arguments = tyro.cli(EvaluateArguments, prog="deformrf-eval")
    sys.exit(run("deformrf-eval", lambda: prepare_evaluation(arguments)))


def run(program: str, prepare: Callable[[], Callable[[], int]]) -> int:
    """Prepare a job, do it, return the exit code.

    ValueErrors (data set and model errors are such) and OSErrors of the preparation are the
    user's to mend, and so is a lack of memory at any time.  So is a DatasetError of the job,
    that learning from the images found nothing; anything else there is a fault of the program
    and keeps its traceback.
    """
    from .training import DatasetError

    mendable = (ValueError, OSError, MemoryError)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # batch systems ask that way
    try:
        job = prepare()
        mendable = (DatasetError, MemoryError)
        return job()
    except mendable as error:
        sentence = plain_message(error) or "the memory is too small"  # Python's own says nothing
        if is_first() or outlives_first():
            print(f"{program}: {sentence}", file=sys.stderr)
        return INPUT_ERROR
    except KeyboardInterrupt:
        if is_first():
            print(f"{program}: interrupted", file=sys.stderr)
        return INTERRUPTED


def is_first() -> bool:
    """Whether this process speaks for all that torchrun started."""
    return os.environ.get("RANK", "0") == "0"


def outlives_first() -> bool:
    """Whether this process's error is its own: not one that ends the first one too.

    The first one's end is that of all, because torchrun then sends a signal to the others.
    """
    try:
        time.sleep(FIRST_SECONDS)
    except KeyboardInterrupt:
        return False
    return True


def prepare_training(arguments: TrainArguments):
    from .training import metrics, world_to_unit_cube
    from .training.data import datasets

    output = writable_file(arguments.output, ".npz")
    checkpoint_path = output.with_suffix(".checkpoint")
    resumed = resumed_run(arguments, checkpoint_path) if arguments.resume else None
    options = resumed.options if resumed else train_options(arguments)
    train_views = datasets.load(arguments.data, "train", arguments.image_size)
    if is_first():
        warn_of_missing(train_views)
    if resumed:
        check_resumed_views(resumed.report, train_views)
    world_to_unit_cube(train_views, options.aabb, options.scene_radius)  # finds what is wrong
    test_views = None
    if datasets.has_test_split(arguments.data):
        test_views = datasets.load(arguments.data, "test", arguments.image_size)
        if is_first():
            warn_of_missing(test_views)
        for lens in test_views.lenses:
            metrics.check_size(lens.height, lens.width)
    device = device_name(arguments.device, for_training=True)
    existed = output.exists()

    def job():
        if device == "cpu" and arguments.preset != "tiny" and is_first():
            print("No GPU is used: this takes hours; --preset tiny takes minutes.", flush=True)
        if checkpoint_path.exists() and not resumed and is_first():
            print(
                f"{checkpoint_path} is of an interrupted run, which --resume would go on with; "
                f"this run overwrites it after a minute.",
                flush=True,
            )
        from .field import modelfile
        from .training import evaluation as evaluate
        from .training import trainer
        from .training.run import distributed

        name, bits = arguments.data.resolve().name, arguments.entry_bits
        with distributed.torchrun_workers(device) as workers:
            trained = trainer.train(
                *(train_views, options, device, name, checkpoint_path, resumed), workers=workers
            )
        if not workers.is_first:
            return 0  # the first one tells how it went; torchrun would end it if this one did
        complete = trained.complete
        # An unfinished model doesn't take a finished one's place.
        spare = output.with_stem(output.stem + "-interrupted")
        path = output if complete or not existed else spare
        around, kept = trained.field.surroundings, trained.field
        if not arguments.keep_surroundings:
            kept = replace(kept, surroundings=None)
        modelfile.save(kept, path, entry_bits=bits)  # first: evaluation may be interrupted
        if complete and test_views:
            # What is scored is what the file holds, before what the images have around it.
            field = replace(modelfile.load(output), surroundings=around)
            report = evaluate.evaluate(field, test_views, None, device, model_path=output)
            complete = report["complete"]
            scores = {"test_view_count": len(report["views"]), "test_mean": report["mean"]}
            modelfile.save(kept, output, scores, bits)
        print(summary(trained, path, report["mean"] if test_views and complete else None))
        if "coarse-stage" in options.leave_out:
            print("Without the coarse stage the model holds the whole grid, empty tets too.")
        if trained.report.get("levels_below_pixel"):
            print(finest_levels(trained))
        if trained.diverged:
            print(f"deformrf-train: {trained.diverged}", file=sys.stderr)
            return DIVERGED
        if trained.interrupted and checkpoint_path.exists():
            print("Go on with the same command and --resume.")
        if trained.complete:
            checkpoint_path.unlink(missing_ok=True)
        return 0 if complete else INTERRUPTED

    return job


def train_options(arguments: TrainArguments):
    """The preset, and what the flags change in it."""
    from .training import preset

    names = ("aabb", "scene_radius", "surroundings", "view_dependence", "leave_out")  # in no preset
    options = preset(arguments.preset, **{name: getattr(arguments, name) for name in names})
    if arguments.steps is not None:
        options = with_steps(options, at_least(2, "--steps", arguments.steps))
    if arguments.seed is not None:
        options = replace(options, seed=at_least(0, "--seed", arguments.seed))
    if options.scene_radius is not None and not 0.0 < options.scene_radius < float("inf"):
        raise ValueError(f"--scene-radius is {options.scene_radius}: it has to be positive")
    return options


def resumed_run(arguments: TrainArguments, path: Path):
    """The checkpoint of an interrupted run, whose options no flag contradicts."""
    from .training.run import checkpoint

    resumed = checkpoint.load(path)
    if flag := contradiction(arguments, resumed.options):
        raise ValueError(
            f"--resume keeps the options of the interrupted run, from which {flag} differs: "
            f"drop {flag}"
        )
    return resumed


def contradiction(arguments: TrainArguments, options) -> str | None:
    """The first flag that was given and is not what these options come from."""
    from .training import preset

    if set(arguments.leave_out) == set(options.leave_out):  # in any order
        arguments = replace(arguments, leave_out=options.leave_out)
    names = ("seed", "aabb", "scene_radius", "surroundings", "view_dependence", "leave_out")
    known = {name: getattr(options, name) for name in names}
    for name, value in known.items():
        mine = getattr(arguments, name)
        if mine not in (getattr(TrainArguments, name), value):  # the first: not given
            no = "no-" if name == "view_dependence" else ""
            return f"--{no}{name.replace('_', '-')}"
    asked = replace(preset(arguments.preset), **known)
    if arguments.steps is not None:
        if with_steps(options, arguments.steps) != options:
            return "--steps"
        asked = with_steps(asked, arguments.steps)
    return "--preset" if arguments.preset != "default" and asked != options else None


def check_resumed_views(report: dict, views):
    """Raise ValueError if these are not the images that the interrupted run had."""
    if report["view_count"] != views.view_count:
        raise ValueError(
            f"the interrupted run had {report['view_count']} views, these are "
            f"{views.view_count}: --resume needs the same images"
        )
    before = tuple(report["image_size"])
    now = max((lens.width, lens.height) for lens in views.lenses)  # as the trainer notes it
    if before != now:
        raise ValueError(
            "the interrupted run's images had {}x{} pixels, these have {}x{}: --resume needs the "
            "same --image-size".format(*before, *now)
        )


def warn_of_missing(dataset):
    """Say how many images were skipped."""
    if dataset.missing:
        total = len(dataset.missing) + dataset.view_count
        print(
            f"{len(dataset.missing)} of {total} {dataset.split} images are missing and were "
            f"skipped, first {dataset.missing[0]}",
            file=sys.stderr,
        )


def summary(trained, output: Path, scores) -> str:
    """What was made, in a line."""
    begun = "Wrote" if trained.complete else "Stopped early; wrote what there is"
    size = output.stat().st_size / 1e6
    minutes = trained.report["seconds"] / 60
    line = f"{begun}: {output}, {trained.field.mesh.tet_count} tets, {size:.1f} MB"
    line += f", {minutes:.1f} minutes of training"
    if scores and scores["psnr"] is not None:
        line += f", {scores['psnr']:.2f} dB and SSIM {scores['ssim']:.4f} on the test views"
    return line


def finest_levels(trained) -> str:
    """Which levels the images can't have taught anything."""
    below = trained.report["levels_below_pixel"]
    return (
        f"Of levels 0 to {trained.field.options.level_count - 1}, these are finer than any pixel "
        f"of the training images and could be left out: {', '.join(map(str, below))}"
    )


def prepare_evaluation(arguments: EvaluateArguments):
    from .training import metrics
    from .training.data import datasets

    if not 0.01 <= arguments.step_factor <= 100.0:
        raise ValueError(f"--step-factor is {arguments.step_factor:g}; give 0.01 to 100")
    if arguments.split not in SPLITS:
        raise ValueError(f"--split is {arguments.split!r}; give {', '.join(SPLITS)}")
    # The cheap checks first: importing the renderer takes a second.
    dataset = datasets.load(
        arguments.data, arguments.split, arguments.image_size, view_count=arguments.views
    )
    warn_of_missing(dataset)
    for lens in dataset.lenses:
        metrics.check_size(lens.height, lens.width)
    json_path = arguments.json and writable_file(arguments.json, ".json")
    if arguments.images:
        arguments.images.mkdir(parents=True, exist_ok=True)
    device = device_name(arguments.device)
    lpips = None
    if arguments.lpips_weights:
        from .training import lpips as metric

        for lens in dataset.lenses:
            metric.check_size(lens.height, lens.width)
        lpips = metric.Lpips(arguments.lpips_weights, device)

    from .field import modelfile
    from .render import RenderOptions
    from .training import evaluation as evaluate

    field = modelfile.load(arguments.model)

    options = RenderOptions(step_factor=arguments.step_factor)

    def job():
        if evaluate.lacks_surroundings(field, dataset):
            print(
                "The object alone is scored, over white, against photographs with their "
                "surroundings; deformrf-train --keep-surroundings keeps them in the model.",
                file=sys.stderr,
                flush=True,
            )
        report = evaluate.evaluate(
            *(field, dataset, arguments.images, device, options),
            model_path=arguments.model,
            lpips=lpips,
        )
        evaluate.print_report(report)
        if json_path:
            evaluate.write_report(report, json_path)
        return 0 if report["complete"] else INTERRUPTED

    return job


def with_steps(options, steps: int):
    """The options with this many steps in all, at least one in each stage."""
    if "coarse-stage" in options.leave_out:
        return replace(options, fine_steps=steps)
    share = options.coarse_steps / (options.coarse_steps + options.fine_steps)
    coarse_steps = max(1, round(share * steps))
    return replace(options, coarse_steps=coarse_steps, fine_steps=steps - coarse_steps)
