"""What the flags of deformrf train make of a preset, and whether they fit a run that is resumed."""

from dataclasses import replace
from pathlib import Path

from ..core import training
from ..core.base.arguments import at_least, at_most, positive

SURROUNDED_STEPS = 0.76  # of the default preset's, where each takes several times as long
LARGEST_SEED, MOST_STEPS = 2**63 - 1, 10**8  # torch's; a year on a GPU
SPACINGS = 0.005, 0.25  # at 0.005 the lattice of the whole box has 6 million tets
COLOR_WIDTHS = 16, 256
SAME_NAMED = (
    "seed",
    "color_width",
    "aabb",
    "scene_radius",
    "spacing",
    "surroundings",
    "view_dependence",
    "leave_out",
)


def train_options(arguments):
    """The preset, and what the flags change in it.

    Args:
        arguments: TrainArguments.

    Raises:
        ValueError: A flag has a bad value.
    """
    at_least(0, "--seed", arguments.seed)
    at_most(LARGEST_SEED, "--seed", arguments.seed)
    positive("--scene-radius", arguments.scene_radius)
    low, high = SPACINGS
    if arguments.spacing is not None and not low <= arguments.spacing <= high:
        raise ValueError(
            f"--spacing is {arguments.spacing}: it has to be from {low} to {high} of the box"
        )
    low, high = COLOR_WIDTHS
    if arguments.color_width is not None and not low <= arguments.color_width <= high:
        raise ValueError(f"--color-width is {arguments.color_width}: give {low} to {high}")
    if arguments.color_width is not None and "ray-color" in arguments.leave_out:
        raise ValueError("--color-width is for the color of a ray, which --leave-out leaves out")
    given = {name: getattr(arguments, name) for name in SAME_NAMED}
    given = {name: value for name, value in given.items() if value is not None}
    options = training.preset(arguments.preset, **given)
    at_least(2, "--steps", arguments.steps)
    at_most(MOST_STEPS, "--steps", arguments.steps)
    return options if arguments.steps is None else with_steps(options, arguments.steps)


def for_views(options, arguments, views):
    """The options for these views: the default preset has fewer steps with surroundings."""
    given = arguments.preset != "default" or arguments.steps is not None
    if given or not training.learns_surroundings(options.surroundings, views):
        return options
    coarse = 0 if "coarse-stage" in options.leave_out else options.coarse_steps
    return with_steps(options, round(SURROUNDED_STEPS * (coarse + options.fine_steps)))


def with_steps(options, steps: int):
    """The options with this many steps in all, at least one in each stage."""
    if "coarse-stage" in options.leave_out:
        return replace(options, fine_steps=steps)
    share = options.coarse_steps / (options.coarse_steps + options.fine_steps)
    coarse_steps = max(1, round(share * steps))
    return replace(options, coarse_steps=coarse_steps, fine_steps=steps - coarse_steps)


def resumed_run(arguments, path: Path):
    """The checkpoint of an interrupted run, if no flag contradicts its options.

    Only isolation can still be left out.
    """
    resumed = training.load_checkpoint(path)
    if "isolation" in arguments.leave_out:  # it comes after all that is trained
        left_out = tuple(dict.fromkeys((*resumed.options.leave_out, "isolation")))
        resumed = replace(resumed, options=replace(resumed.options, leave_out=left_out))
        if {*arguments.leave_out} == {"isolation"}:
            arguments = replace(arguments, leave_out=())
    if flag := contradiction(arguments, resumed.options):
        raise ValueError(
            f"--resume keeps the options of the interrupted run, from which {flag} differs: "
            f"drop {flag}"
        )
    return resumed


def contradiction(arguments, options) -> str | None:
    """The first flag that was given and differs from these options."""
    if set(arguments.leave_out) == set(options.leave_out):  # in any order
        arguments = replace(arguments, leave_out=options.leave_out)
    known = {name: getattr(options, name) for name in SAME_NAMED}
    for name, value in known.items():
        not_given = getattr(type(arguments), name)
        if getattr(arguments, name) not in (not_given, value):
            no = "no-" if name == "view_dependence" else ""
            return f"--{no}{name.replace('_', '-')}"
    # They are 0 in older checkpoints, and no flag gives them.
    known |= {"depth_cost": options.depth_cost, "strong_decay": options.strong_decay}
    asked = replace(training.preset(arguments.preset), **known)
    if arguments.steps is not None:
        if with_steps(options, arguments.steps) != options:
            return "--steps"
        asked = with_steps(asked, arguments.steps)
    return "--preset" if arguments.preset != "default" and asked != options else None


def check_resumed_views(report: dict, views):
    """Raise ValueError if these are not the images of the interrupted run."""
    before = (report["view_count"], *report["image_size"])
    largest = max((lens.width, lens.height) for lens in views.lenses)  # as the report has it
    if before != (now := (views.view_count, *largest)):
        raise ValueError(
            "--resume needs the same images and --image-size: the interrupted run had {} views, "
            "up to {}x{} pixels, these are {}, up to {}x{}".format(*before, *now)
        )
