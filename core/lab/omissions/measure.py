"""Measures all omissions for a model on a device, one part after another."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ...field import ModelFileError, TetField
from ..effort import Effort
from .files import file_rows
from .frames import Frames, frame_switches
from .rows import DYNAMICS, FILE, RENDERING, START, Bench, Omission, not_measured
from .starts import import_rows, kernel_row
from .steps import change, step_switches

# Failures of the machine, such as a full disk or a deleted file.
FAILURES = OSError, RuntimeError, subprocess.SubprocessError, ModelFileError
FOLDERS = re.compile(  # of absolute paths, in quotes or not
    r"""(?<=['"])(?:[A-Za-z]:)?[/\\][^'"]*[/\\]|(?<!\S)(?:[A-Za-z]:)?[/\\]\S*[/\\]"""
)


class Part(NamedTuple):
    """Rows that are measured together."""

    title: str
    group: str
    seconds: float  # roughly: those of the bundled model on two CPU cores
    measure: Callable[[], list[Omission]]

    def run(self) -> list[Omission]:
        """The rows, or one row with the error if the machine fails."""
        try:
            return self.measure()
        except FAILURES as error:
            why = f"Measuring it failed: {_reason(error)}."
            return [not_measured(self.title, self.group, why, left_out=None)]


def parts(field: TetField, model_path, device: str, effort: Effort) -> list[Part]:
    """All parts of a field and its file, in order; nothing is measured before they run."""
    frames = Frames(field, device, effort.frame_size, effort.view_count)
    rendering = Bench(RENDERING, device, effort.frame_turns, frames.change)
    dynamics = Bench(DYNAMICS, device, effort.step_turns, change)
    path = Path(model_path).absolute()  # so that FOLDERS removes folders from errors
    switched = [
        Part(f"{bench.group}: {switch.name}", bench.group, seconds, _one(switch, bench))
        for bench, switches, seconds in (
            (rendering, frame_switches(frames), 6.0),
            (dynamics, step_switches(field, device), 1.2),
        )
        for switch in switches
    ]
    return [
        *switched,
        Part("the model file", FILE, 1.5, lambda: file_rows(frames, path)),
        Part(
            "starts with what others import",
            START,
            16.0,
            lambda: import_rows(path, device, effort.start_turns),
        ),
        Part(
            "kernels of another device",
            START,
            15.0,
            lambda: [kernel_row(device, effort.compilations)],
        ),
    ]


def _one(switch, bench):
    return lambda: [switch.measured(bench)]


def _reason(error) -> str:
    """The last line of an error's text, which names the error, without folders."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return FOLDERS.sub("", lines[-1]).rstrip(".")
