"""deformrf-report: error against run time, stability, and what was left out, for one model.

Sections are measured one after the other and written together.  Ctrl-C, or an error, writes
those that are done.  Whatever a report says, also that something failed, its exit code is 0 if it
was written whole.  Slow imports wait until the arguments are known to be good.
"""

import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Annotated, NamedTuple

import tyro

from ..arguments import File, plain_message, writable_file
from ..commands import INPUT_ERROR, require, run
from ..device import Choice, device_name
from ..paths import DEFAULT_MODEL

PROGRAM = "deformrf-report"
TETS = 5000  # that the estimates of time are for
SECONDS = {  # full on two CPU cores, on one H100, quick on the one and on the other
    "rendering": (140, 39, 20, 10),
    "dynamics": (68, 80, 16, 10),
    "training": (1, 1, 1, 1),
    "stability": (28, 24, 16, 10),
    "left out": (110, 65, 30, 25),
}
GROWING = ("dynamics", "stability")  # with the number of tets
TRUST = 0.2  # in these estimates, as if so much of them were done in time
LONG = 150  # seconds: what takes longer is told in minutes
TEST_SPLIT = "test"

Model = Annotated[
    tyro.conf.Positional[Path], tyro.conf.arg(metavar="[MODEL]", help_behavior_hint="")
]
Folder = Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")]


@dataclass(frozen=True)
class ReportArguments:
    """Measure a model on this machine: error against run time, stability, what was left out."""

    model: Model = DEFAULT_MODEL
    """Model file, an .npz; the bundled one by default."""
    output: Folder = Path("report")
    """Folder of report.html, report.md, report.json, tables and pictures."""
    data: File = None
    """Data set whose test views the renderings are compared with, too."""
    device: Choice = "auto"
    """auto takes CUDA if there is any."""
    quick: bool = False
    """Fewer settings, pixels and repeats: 5,000 tets take under two minutes on two CPU cores."""


class Effort(NamedTuple):
    """How much is measured.

    Attributes:
        size: Of images, both sides [pixels].
        view_count: Views from all around.
        pixel_count: Compared with the reference in each view.
        turns: Of timing.
        photo_count: Test views.
        photo_pixels: Compared in each of them.
    """

    size: int
    view_count: int
    pixel_count: int
    turns: int
    photo_count: int
    photo_pixels: int


EFFORTS = {  # (on a CPU, quick)
    (True, True): Effort(150, 2, 250, 4, 4, 400),
    (True, False): Effort(200, 3, 800, 16, 10, 1000),
    (False, True): Effort(400, 2, 250, 8, 4, 400),
    (False, False): Effort(800, 3, 800, 24, 10, 1000),
}


class Job(NamedTuple):
    """A section to measure.

    Attributes:
        title: Of the progress bar.
        seconds: About how long it takes.
        section: Measures; takes a function to call with the share that is done.
    """

    title: str
    seconds: float
    section: Callable


def main():
    """The command deformrf-report."""
    arguments = tyro.cli(ReportArguments, prog=PROGRAM, config=(tyro.conf.FlagCreatePairsOff,))
    sys.exit(run(PROGRAM, lambda: prepare(arguments)))


def prepare(arguments: ReportArguments) -> Callable[[], int]:
    """Find what is wrong with the arguments; returns the work."""
    require("scipy", "matplotlib", "jinja2")
    from ..field import modelfile

    field = modelfile.load(arguments.model)
    device = device_name(arguments.device)
    effort = EFFORTS[device == "cpu", arguments.quick]
    photos = photographs_for(field, arguments.data, effort)
    writable_file(arguments.output / "report.html", ".html")

    def work():
        from .report import machine

        command = machine.without_folders(printable(shlex.join([PROGRAM, *sys.argv[1:]])))
        # Before it has work to do.
        about_machine = machine.section(device, seeds(), command, arguments.model)
        jobs = plan(field, arguments, device, effort, photos)
        begun, found, failure = time.perf_counter(), [], None
        try:
            for section in measured(jobs):
                found.append(section)
        except (KeyboardInterrupt, Exception) as error:  # what is done is written first
            failure = error
        from .report import Report, is_complete, write

        if failure is not None and not found:
            print(f"{PROGRAM}: nothing was measured yet, nothing is written", file=sys.stderr)
            raise failure
        output = arguments.output
        if failure is not None and is_complete(output):  # keep it
            output = output.resolve()  # "." has no name
            output = output.with_name(f"{output.name}-interrupted")
        missing = [job.title for job in jobs[len(found) :]]
        name = printable(arguments.model.stem)
        facts = {
            "model": f"{name}, {field.mesh.tet_count} tets, {field.layout.level_count} levels",
            "device": _device_words(device),
            "effort": "quick" if arguments.quick else "full",
            "date": date.today().isoformat(),
            "duration": f"{time.perf_counter() - begun:.0f} s",
            "command": command,
        }
        title, complete = f"Report on {name}", failure is None
        report = Report(title, facts, [*found, about_machine], complete, tuple(missing))
        try:
            paths = write(report, output)
        except OSError as error:
            print(f"{PROGRAM}: {plain_message(error)}", file=sys.stderr)
            return INPUT_ERROR
        tell(found, paths[-1], missing)
        if failure is not None:
            raise failure
        return 0

    return work


def photographs_for(field, data, effort: Effort):
    """Pixels of the data set's test views; None without data, or if they can't be compared."""
    if data is None:
        return None
    from ..training import lacks_surroundings, load_dataset
    from .rendering import photographs

    dataset = load_dataset(data, TEST_SPLIT, view_count=effort.photo_count)
    if field.surroundings is not None or lacks_surroundings(field, dataset):
        print(
            "The photographs show what surrounds the object, and the report is about the object "
            "alone: they are left out of it.",
            file=sys.stderr,
            flush=True,
        )
        return None
    return photographs(field, dataset, effort.photo_pixels)


def plan(field, arguments: ReportArguments, device: str, effort: Effort, photos) -> list[Job]:
    """What there is to measure."""
    from .dynamics import tell as dynamics
    from .omissions import measure as omissions
    from .omissions import tell as left_out
    from .rendering import RenderingStudy
    from .rendering import tell as rendering
    from .stability import tell as stability
    from .training import tell as training

    quick, name = arguments.quick, arguments.model.stem

    def render(step):
        study = RenderingStudy(*(field, device, effort.size, effort.view_count, effort.pixel_count))
        return rendering.section(study, effort.turns, photos, step)

    def omit(step):
        chosen = omissions.effort(device, quick)
        parts, rows = omissions.omissions(field, arguments.model, device, chosen), []
        whole, done = sum(part.seconds for part in parts), 0.0
        for part in parts:
            rows += part.run()
            done += part.seconds
            step(done / whole)
        return left_out.section(rows, chosen)

    sections = {
        "rendering": render,
        "dynamics": lambda step: dynamics.section(name, field.mesh, device, quick, step),
        "training": lambda step: training.section(field),
        "stability": lambda step: stability.section(field, device, quick, step),
        "left out": omit,
    }
    size, column = max(field.mesh.tet_count / TETS, 0.2), 2 * quick + (device != "cpu")
    return [
        Job(title, SECONDS[title][column] * (size if title in GROWING else 1.0), section)
        for title, section in sections.items()
    ]


def measured(jobs: list[Job]):
    """The sections, one by one, under a progress bar."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    whole = sum(job.seconds for job in jobs)
    print(f"This takes about {_duration(whole)}.", flush=True)
    columns = (
        TextColumn("{task.description:10}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("elapsed, about {task.fields[left]} left"),
    )
    start = time.perf_counter()
    with Progress(*columns) as bar:
        task = bar.add_task("", total=whole, left=_duration(whole))
        before = 0.0

        def show(done):
            # By what this machine took so far, the less of it there is the less.
            pace = (time.perf_counter() - start + TRUST * whole) / (done + TRUST * whole)
            bar.update(task, completed=done, left=_duration(pace * (whole - done)))

        for job in jobs:
            bar.update(task, description=job.title)

            def step(share, before=before, job=job):
                show(before + share * job.seconds)

            begun = time.perf_counter()
            section = job.section(step)
            before += job.seconds
            show(before)
            yield replace(section, seconds=time.perf_counter() - begun)


def _duration(seconds):
    return f"{seconds:.0f} s" if seconds < LONG else f"{seconds / 60:.0f} min"


def printable(words: str) -> str:
    """Without what a file's name may have and no text can."""
    return words.encode("utf-8", "replace").decode()


def tell(sections, path, missing=()):
    """A line for each section, what is missing, and where the whole of it is."""
    words = {None: "", True: "pass  ", False: "FAIL  "}
    for section in sections:
        print(f"{section.title}: {words[section.passed]}{section.findings[0]}")
    if missing:
        print(f"Missing: {', '.join(missing)}")
    print(f"Wrote {path}")


def seeds() -> dict[str, int | str]:
    """Of everything random in a report."""
    from .stability import SEED

    return {"pixels": "the view's number", "order of settings": 0, "stress cases and poses": SEED}


def _device_words(device):
    import warp as wp

    return "CPU" if device == "cpu" else wp.get_device(device).name
