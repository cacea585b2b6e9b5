"""Everything that the program leaves out for a model on a device: one job after another."""

import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from ...field import ModelFileError, TetField
from .of_dynamics import DYNAMICS_ROWS, Steps
from .of_files import file_rows
from .of_rendering import Frames, rendering_rows
from .of_start import import_rows, kernel_row
from .rows import DYNAMICS, FILE, RENDERING, START, Omission, not_measured

# Of the machine, such as a full disk, or a file that is gone.
FAILURES = OSError, RuntimeError, subprocess.SubprocessError, ModelFileError
UNITS = {RENDERING: "ms", DYNAMICS: "ms", FILE: "MB", START: "s"}
FOLDERS = re.compile(  # of absolute paths, in quotes or not
    r"""(?<=['"])(?:[A-Za-z]:)?[/\\][^'"]*[/\\]|(?<!\S)(?:[A-Za-z]:)?[/\\]\S*[/\\]"""
)


class Job(NamedTuple):
    """Something to measure.

    Attributes:
        title: What is being measured.
        group: Of its rows.
        seconds: How long it takes, roughly: that of the bundled model on two CPU cores.
        measure: Measures it.
    """

    title: str
    group: str
    seconds: float
    measure: Callable[[], list[Omission]]

    def run(self) -> list[Omission]:
        """The rows; where the machine fails, one that says how."""
        try:
            return self.measure()
        except FAILURES as error:
            why = f"Measuring it failed: {_reason(error)}."
            return [not_measured(self.title, self.group, why, None, UNITS[self.group])]


@dataclass(frozen=True)
class Effort:
    """How thoroughly to measure.

    Attributes:
        image_size: Width and height [pixels].
        view_count: Views that images are compared in.
        image_turns, step_turns, start_turns: Repeats of a row of rendering, dynamics, start.
        compilations: Repeats of that of kernels, which take long.
        job_seconds: Of a job of rendering, dynamics, files, imports, kernels.
    """

    image_size: int
    view_count: int
    image_turns: int
    step_turns: int
    start_turns: int
    compilations: int
    job_seconds: tuple[float, float, float, float, float]


def effort(device: str, quick: bool) -> Effort:
    """A quick look, or numbers to quote."""
    if quick:
        return Effort(120 if device == "cpu" else 400, 2, 9, 60, 2, 1, (1.0, 0.7, 1.0, 12.0, 4.0))
    return Effort(300 if device == "cpu" else 800, 3, 15, 150, 3, 3, (6.0, 1.2, 1.5, 16.0, 15.0))


def omissions(field: TetField, model_path, device: str, effort: Effort) -> list[Job]:
    """The jobs, in order; nothing is done before they run.

    Args:
        field: What the file at `model_path` holds.
        device: "cpu" or "cuda:0".
    """
    size, views, turns = effort.image_size, effort.view_count, effort.image_turns
    frames = Frames(field, device, size, views, turns)
    steps = Steps(field, device, effort.step_turns)
    images, stepping, files, imports, kernels = effort.job_seconds
    model_path = Path(model_path).absolute()  # so that no failure names a folder: FOLDERS
    starts = model_path, device, effort.start_turns
    return [
        *(
            Job(f"rendering: {_title(row)}", RENDERING, images, partial(_one, row, frames))
            for row in rendering_rows(device)
        ),
        *(
            Job(f"dynamics: {_title(row)}", DYNAMICS, stepping, partial(_one, row, steps))
            for row in DYNAMICS_ROWS
        ),
        Job("the model file", FILE, files, lambda: list(file_rows(frames, model_path))),
        Job("starts with what others import", START, imports, partial(import_rows, *starts)),
        Job(
            *("kernels of another device", START, kernels),
            lambda: [kernel_row(device, effort.compilations)],
        ),
    ]


def _one(row, of) -> list[Omission]:
    return [row(of)]


def _title(row) -> str:
    return row.__name__.replace("_", " ")


def _reason(error) -> str:
    """The last line of what an error says, which is the one that names it, without folders."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return FOLDERS.sub("", lines[-1]).rstrip(".")
