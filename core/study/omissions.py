"""Everything that the program leaves out for a model on a device: one job after another."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from ..field.field import TetField
from .omitted import Omission
from .omitted_dynamics import DYNAMICS_ROWS, Steps
from .omitted_files import file_rows
from .omitted_rendering import Frames, rendering_rows
from .omitted_start import import_rows, kernel_row


class Job(NamedTuple):
    """Something to measure.

    Attributes:
        title: What is being measured.
        seconds: How long it takes, roughly: that of the bundled model on two CPU cores.
        run: Measures it.
    """

    title: str
    seconds: float
    run: Callable[[], list[Omission]]


@dataclass(frozen=True)
class Effort:
    """How thoroughly to measure.

    Attributes:
        image_size: Width and height [pixels].
        view_count: Views that images are compared in.
        image_turns, step_turns, start_turns: Repeats of a row of rendering, dynamics, start.
        job_seconds: Of a job of rendering, dynamics, files, imports, kernels.
    """

    image_size: int
    view_count: int
    image_turns: int
    step_turns: int
    start_turns: int
    job_seconds: tuple[float, float, float, float, float]


def effort(device: str, quick: bool) -> Effort:
    """A quick look, or numbers to quote."""
    if quick:
        return Effort(120 if device == "cpu" else 400, 2, 9, 60, 2, (1.0, 0.7, 1.0, 8.0, 4.0))
    return Effort(300 if device == "cpu" else 800, 3, 15, 150, 3, (6.0, 1.2, 1.5, 12.0, 5.0))


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
    starts = model_path, device, effort.start_turns
    compilations = max(1, effort.start_turns // 2)  # which hardly vary, and take long
    return [
        *(
            Job(f"rendering: {_title(row)}", images, partial(_one, row, frames))
            for row in rendering_rows(device)
        ),
        *(
            Job(f"dynamics: {_title(row)}", stepping, partial(_one, row, steps))
            for row in DYNAMICS_ROWS
        ),
        Job("the model file", files, lambda: list(file_rows(frames, model_path))),
        Job("starts with what others import", imports, partial(import_rows, *starts)),
        Job("kernels of another device", kernels, lambda: [kernel_row(device, compilations)]),
    ]


def _one(row, of) -> list[Omission]:
    return [row(of)]


def _title(row) -> str:
    return row.__name__.replace("_", " ")
