"""One row of the table of omissions: a switch is measured with and without what is left out.

Runs with and without it take turns, and the saving is the difference from turn to turn
(stopwatch.in_turns).  A saving counts as measured only if its spread excludes 0 and, after
few turns, the ranges with and without do not overlap.  The change is the difference of the
results; "none, bit by bit" means that they were compared and are equal.
"""

import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ....core.field import ModelFileError
from ..rendering.pictures import image_error
from ..stopwatch import Spread

RENDERING, DYNAMICS, FILE, START = "rendering", "dynamics", "file", "start"
SAVES, NOTHING, COSTS, NOT_MEASURED = "saves", "nothing measurable", "costs", "not measured"
NONE = "none, bit by bit"
ENOUGH_TURNS = 5  # fewer have one sign by chance too often: 3 in one of 4 cases
# Failures of the machine, such as a full disk or a deleted file.
FAILURES = OSError, RuntimeError, subprocess.SubprocessError, ModelFileError
FOLDERS = re.compile(  # of absolute paths, in quotes or not
    r"""(?<=['"])(?:[A-Za-z]:)?[/\\][^'"]*[/\\]|(?<!\S)(?:[A-Za-z]:)?[/\\]\S*[/\\]"""
)
Turns = tuple[Spread, Spread, Spread]  # with it, without it, and the saving


@dataclass(frozen=True)
class Switch:
    """Something that is left out."""

    name: str
    group: str  # RENDERING, DYNAMICS, FILE or START
    unit: str  # of what is measured
    why: str  # the reason to leave it out
    measure: Callable[[], tuple[Turns, str]]  # also says what its absence changes


@dataclass(frozen=True)
class Omission:
    """A measured switch; numbers are None if `verdict` is NOT_MEASURED."""

    name: Annotated[str, "what"]
    group: str
    unit: Annotated[str, "unit"]  # "ms" a frame, "MB", or "s"
    with_it: Annotated[Spread | None, "with it"]
    without: Annotated[Spread | None, "without it"]
    saving: Annotated[Spread | None, "saving"]  # from turn to turn
    change: Annotated[str, "what its absence changes"]
    verdict: Annotated[str, "leaving it out"]
    why: Annotated[str, "why"]

    @property
    def percent(self) -> Spread:
        """The saving, relative to the whole `with_it` [%]."""
        whole = max(self.with_it.median, 1e-12) / 100.0
        saving = self.saving
        return Spread(saving.median / whole, saving.low / whole, saving.high / whole, saving.count)


def measured(switch: Switch) -> Omission:
    """The switch's row; if the machine fails, it has the error instead of numbers."""
    head = switch.name, switch.group, switch.unit
    try:
        turns, change = switch.measure()
    except FAILURES as error:
        lines = str(error).strip().splitlines() or [type(error).__name__]
        reason = FOLDERS.sub("", lines[-1]).rstrip(".")  # the last line names the error
        why = f"Measuring it failed: {reason}."
        return Omission(*head, None, None, None, "", NOT_MEASURED, why)
    return Omission(*head, *turns, change, verdict(*turns), switch.why)


def verdict(with_it: Spread, without: Spread, saving: Spread) -> str:
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
    """The difference of two lists of images ([H, W, 4] uint8 each), in words."""
    if np.array_equal(with_it, without):
        return NONE
    error = image_error(*(np.stack(images)[..., :3] / 255.0 for images in (with_it, without)))
    return f"{error.psnr:.1f} dB, at most {error.largest:.0f}/255"


def pose_change(with_it, without, size: float) -> str:
    """The difference of two poses [V, 3], in words and object sizes."""
    if np.array_equal(with_it, without):
        return NONE
    away = np.linalg.norm(np.asarray(with_it, float) - without, axis=1)
    return f"at most {away.max() / size:.2g} sizes"
