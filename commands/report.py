"""deformrf report: error against run time, stability, and omissions, for one model.

Sections are measured one after the other and written together.  After Ctrl-C or an error,
those that are done are written.  The exit code is 0 if the report was written whole, even if
it says that something failed.  Slow imports wait until the arguments are known to be good.
"""

import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Annotated, NamedTuple

from ..core import field as fields
from ..core.base.arguments import Arg, File, Folder, Model, plain_message, writable_file
from ..core.base.device import Choice, device_name
from ..core.base.paths import DEFAULT_MODEL
from ..core.base.streams import printable
from ..wings.lab.effort import EFFORTS, Effort
from .options import parsed
from .running import complain, require, run

PROGRAM = "deformrf report"
TETS = 5000  # that the estimates of time are for
SECONDS = {  # full on two CPU cores, on one H100, quick on the one and on the other
    "rendering": (90, 28, 14, 8),
    "dynamics": (50, 60, 12, 8),
    "training": (1, 1, 1, 1),
    "stability": (28, 24, 16, 10),
    "left out": (60, 40, 20, 18),
    "another": (8, 2, 3, 1),
}
GROWING = ("dynamics", "stability")  # with the number of tets
LONG = 150  # seconds: what takes longer is told in minutes
TEST_SPLIT = "test"


@dataclass(frozen=True)
class ReportArguments:
    """Measure a model on this machine: error against run time, stability, what was left out."""

    model: Model = DEFAULT_MODEL
    """Model file, an .npz; the bundled one by default."""
    output: Annotated[Folder, Arg(short="-o")] = Path("report")
    """Folder to write: report.html, report.md, report.json, tables and pictures."""
    data: Folder = None
    """Data set whose test views the renderings are compared with, too."""
    outside_images: bool = False
    """Read images of --data that lie outside its folder, too."""
    device: Choice = "auto"
    """Where the work is done; auto, the default, takes CUDA if there is any."""
    compare: Annotated[File, Arg("MODEL")] = None
    """Another model of the same object, as one that was trained with --leave-out ray-color: the
    report shows what each was trained without, scores, time of a frame, and size."""
    quick: bool = False
    """Fewer settings, pixels and repeats: 5,000 tets take under two minutes on two CPU cores."""


class Job(NamedTuple):
    """A section to measure."""

    title: str  # of the progress bar
    seconds: float  # about how long it takes
    section: Callable  # measures; takes a function to call with the share that is done


def main() -> int:
    arguments = parsed(PROGRAM, ReportArguments)
    return run(PROGRAM, lambda: prepare(arguments))


def prepare(arguments: ReportArguments) -> Callable[[], int]:
    """Find what is wrong with the arguments; returns the work."""
    require("scipy", "matplotlib", "markdown_it")

    field = fields.load(arguments.model)
    device = device_name(arguments.device)
    effort = EFFORTS[device == "cpu", arguments.quick]
    photos = photographs_for(field, arguments.data, effort, arguments.outside_images)
    other = other_model(arguments, effort)
    writable_file(arguments.output / "report.html", ".html")
    jobs = plan(field, arguments, device, effort, photos, other)
    return lambda: report(field, arguments, device, jobs)


def report(field, arguments: ReportArguments, device: str, jobs: list[Job]) -> int:
    """Measure, write, and print a summary; returns the exit code."""
    import warp as wp

    from ..wings.lab.report import machine
    from ..wings.lab.report.contents import Report
    from ..wings.lab.report.writing import is_complete, write

    command = machine.without_folders(printable(f"{PROGRAM} {shlex.join(sys.argv[1:])}"))
    about_machine = machine.section(device, command, arguments.model)  # before it has work to do
    begun, found, failure = time.perf_counter(), [], None
    try:
        for section in measured(jobs):
            found.append(section)
    except (KeyboardInterrupt, Exception) as error:  # what is done is written first
        failure = error
        if not found:
            if isinstance(error, KeyboardInterrupt):
                raise
            complain(PROGRAM, "nothing was measured yet, nothing is written")
            raise
    output = arguments.output
    if failure is not None and is_complete(output):  # keep it
        output = output.resolve()  # "." has no name
        output = output.with_name(f"{output.name}-interrupted")
    missing = tuple(job.title for job in jobs[len(found) :])
    name = printable(arguments.model.stem)
    facts = {
        "model": f"{name}, {field.mesh.tet_count} tets, {field.layout.level_count} levels",
        "device": "CPU" if device == "cpu" else wp.get_device(device).name,
        "effort": "quick" if arguments.quick else "full",
        "date": date.today().isoformat(),
        "duration": f"{time.perf_counter() - begun:.0f} s",
        "command": command,
    }
    sections = [*found, about_machine]
    try:
        paths = write(
            Report(f"Report on {name}", facts, sections, failure is None, missing), output
        )
    except OSError as error:
        return complain(PROGRAM, plain_message(error))
    words = {None: "", True: "pass  ", False: "FAIL  "}
    for section in found:
        print(f"{section.title}: {words[section.passed]}{section.findings[0]}")
    if missing:
        print(f"Missing: {', '.join(missing)}")
    print(f"Wrote {paths[-1]}")
    if failure is not None:
        raise failure
    return 0


def photographs_for(field, data, effort: Effort, outside=False):
    """Pixels of the data set's test views; None without data, or if they can't be compared."""
    if data is None:
        return None
    from ..core.training import lacks_surroundings, load_dataset
    from ..wings.lab.rendering.pictures import photographs

    dataset = load_dataset(data, TEST_SPLIT, view_count=effort.photo_count, outside=outside)
    if field.surroundings is not None or lacks_surroundings(field, dataset):
        print(
            "The photographs show what surrounds the object, but the report is about the object "
            "alone: it leaves them out.",
            file=sys.stderr,
            flush=True,
        )
        return None
    return photographs(field, dataset, effort.photo_pixels)


def other_model(arguments: ReportArguments, effort: Effort):
    """The model of --compare, and its photographs as `photographs_for`; None without one."""
    if arguments.compare is None:
        return None
    field = fields.load(arguments.compare)
    return field, photographs_for(field, arguments.data, effort, arguments.outside_images)


def plan(field, arguments: ReportArguments, device: str, effort: Effort, photos, other):
    """The Jobs of the sections to measure; `other`: see other_model."""
    from ..wings.lab import another, training
    from ..wings.lab.dynamics import section as dynamics
    from ..wings.lab.omissions import section as omissions
    from ..wings.lab.rendering import section as rendering
    from ..wings.lab.stability import section as stability

    quick, model = arguments.quick, arguments.model
    sections = {
        "rendering": lambda step: rendering.section(field, device, effort, photos, step),
        "dynamics": lambda step: dynamics.section(field.mesh, device, quick, step),
        "training": lambda step: training.section(field),
        "stability": lambda step: stability.section(field, device, quick, step),
        "left out": lambda step: omissions.section(field, model, device, effort, step),
    }
    if other is not None:
        models = [(field, model), (other[0], arguments.compare)]
        sections["another"] = lambda step: another.section(
            models, device, effort, [photos, other[1]]
        )
    size, column = max(field.mesh.tet_count / TETS, 0.2), 2 * quick + (device != "cpu")
    return [
        Job(title, SECONDS[title][column] * (size if title in GROWING else 1.0), section)
        for title, section in sections.items()
    ]


def measured(jobs: list[Job]):
    """The sections, one by one, under a progress bar."""
    from rich.progress import Progress

    whole = sum(job.seconds for job in jobs)
    about = f"{whole:.0f} s" if whole < LONG else f"{whole / 60:.0f} min"
    print(f"This takes about {about}.", flush=True)
    with Progress() as bar:
        task, before = bar.add_task("", total=whole), 0.0
        for job in jobs:
            bar.update(task, description=f"{job.title:10}")

            def step(share, before=before, job=job):
                bar.update(task, completed=before + share * job.seconds)

            begun = time.perf_counter()
            section = job.section(step)
            step(1.0)
            before += job.seconds
            yield replace(section, seconds=time.perf_counter() - begun)
