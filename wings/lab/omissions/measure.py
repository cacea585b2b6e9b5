"""Rows of the report on omissions: each omitted part is measured by switching it on.

Runs with and without it take turns, and the saving is the difference from turn to turn
(stopwatch.in_turns).  A saving counts as measured only if its spread excludes 0 and, after
few turns, the ranges with and without do not overlap.  The change is the difference of the
results; "none, bit by bit" means that they were compared and are equal.
"""

import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ....core.field import ModelFileError
from ..rendering.pictures import image_error
from ..stopwatch import Timing, compared

RENDERING, DYNAMICS, FILE, START = "rendering", "dynamics", "file", "start"
UNITS = {RENDERING: "ms", DYNAMICS: "ms", FILE: "MB", START: "s"}  # of each group, as a rule
SAVES, NOTHING, COSTS, NOT_MEASURED = "saves", "nothing measurable", "costs", "not measured"
NONE = "none, bit by bit"
ENOUGH_TURNS = 5  # fewer have one sign by chance too often: 3 in one of 4 cases
# Failures of the machine, such as a full disk or a deleted file.
FAILURES = OSError, RuntimeError, subprocess.SubprocessError, ModelFileError
FOLDERS = re.compile(  # of absolute paths, in quotes or not
    r"""(?<=['"])(?:[A-Za-z]:)?[/\\][^'"]*[/\\]|(?<!\S)(?:[A-Za-z]:)?[/\\]\S*[/\\]"""
)


@dataclass(frozen=True)
class Omission:
    """Something that is left out, or could be.

    If it cannot be measured, numbers are None and `verdict` is NOT_MEASURED; if measuring
    failed, `left_out` is None, too.
    """

    name: Annotated[str, "what"]
    group: str  # one of UNITS
    left_out: Annotated[bool | None, "left out"]
    unit: Annotated[str, "unit"]  # "ms" a frame, "MB", or "s"
    with_it: Annotated[Timing | None, "with it"]
    without: Annotated[Timing | None, "without it"]
    saving: Annotated[Timing | None, "saving"]  # from turn to turn
    change: Annotated[str, "what its absence changes"]
    verdict: Annotated[str, "leaving it out"]
    why: Annotated[str, "why"]

    @property
    def percent(self) -> Timing:
        """The saving, relative to the whole `with_it` [%]."""
        whole = max(self.with_it.median, 1e-12) / 100.0
        saving = self.saving
        return Timing(saving.median / whole, saving.low / whole, saving.high / whole, saving.count)


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
            lines = str(error).strip().splitlines() or [type(error).__name__]
            reason = FOLDERS.sub("", lines[-1]).rstrip(".")  # the last line names the error
            why = f"Measuring it failed: {reason}."
            return [not_measured(self.title, self.group, why, left_out=None)]


class Bench(NamedTuple):
    """Where rows of a group are measured."""

    group: str
    device: str
    turns: int
    seconds: float  # of a row, see Part
    change: Callable[..., str]  # compares what a Switch makes, in words


@dataclass(frozen=True)
class Switch:
    """A row to be measured: how to run with the part and without it."""

    name: str
    with_it: Callable  # makes an object whose method `turn` is timed
    without: Callable
    why: str  # the reason to omit or to keep it
    left_out: bool = True
    change: Callable | None = None  # compares both results; None: that of the bench
    missing: str = ""  # the reason, if it can't be measured here

    def part(self, bench: Bench) -> Part:
        """The row as a part of the section."""
        title = f"{bench.group}: {self.name}"
        return Part(title, bench.group, bench.seconds, lambda: [self.measured(bench)])

    def measured(self, bench: Bench) -> Omission:
        """The measured row."""
        if self.missing:
            return not_measured(self.name, bench.group, self.missing, left_out=False)
        with_it, without = self.with_it(), self.without()
        times = compared(with_it.turn, without.turn, bench.device, bench.turns)
        change = (self.change or bench.change)(with_it, without)
        return omission(self.name, bench.group, times, change, self.why, self.left_out)


def omission(name, group, turns, change, why, left_out=True, unit=None) -> Omission:
    """A measured row, of what stopwatch.in_turns returned."""
    unit = unit or UNITS[group]
    return Omission(name, group, left_out, unit, *turns, change, verdict(*turns), why)


def not_measured(name, group, why, left_out=True, unit=None) -> Omission:
    """A row without numbers, with the reason."""
    unit = unit or UNITS[group]
    return Omission(name, group, left_out, unit, None, None, None, "", NOT_MEASURED, why)


def verdict(with_it: Timing, without: Timing, saving: Timing) -> str:
    """The verdict on a saving, given its spread and its number of turns.

    A single turn is exact, because such values (file sizes) do not vary.
    """
    few = 1 < saving.count < ENOUGH_TURNS
    if saving.low > 0.0:
        return NOTHING if few and with_it.low <= without.high else SAVES
    if saving.high < 0.0:
        return NOTHING if few and without.low <= with_it.high else COSTS
    return NOTHING


def image_change(with_it, without) -> str:
    """The difference of two lists of images ([H, W, 3 or 4] uint8 each), in words."""
    if np.array_equal(with_it, without):
        return NONE
    error = image_error(*(np.stack(way)[..., :3] / 255.0 for way in (with_it, without)))
    return f"{error.psnr:.1f} dB, at most {error.largest:.0f}/255"


def pose_change(with_it, without, size: float) -> str:
    """The difference of two poses [V, 3], in words and object sizes."""
    if np.array_equal(with_it, without):
        return NONE
    away = np.linalg.norm(np.asarray(with_it, float) - without, axis=1)
    return f"at most {away.max() / size:.2g} sizes"
