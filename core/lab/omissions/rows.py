"""What the program leaves out, measured by switching it on: a row of the report, and its words.

Both ways take turns, and the saving is the difference from turn to turn (stopwatch.compared).
Where it reaches across 0 it is nothing that can be measured; nor is it after few turns, if one
way's range meets the other's.  What the absence changes is what the results differ by; "none,
bit by bit" means that they were compared, and are the same.
"""

from dataclasses import dataclass

import numpy as np

from ..rendering import image_error
from ..stopwatch import Timing, timing_of

RENDERING, DYNAMICS, FILE, START = GROUPS = ("rendering", "dynamics", "file", "start")
SAVES, NOTHING, COSTS, NOT_MEASURED = "saves", "nothing measurable", "costs", "not measured"
NONE = "none, bit by bit"
ENOUGH_TURNS = 5  # fewer have one sign by chance too often: 3 in one of 4 cases

Compared = tuple[Timing, Timing, Timing]  # with it, without it, and the difference


@dataclass(frozen=True)
class Omission:
    """Something that is left out, or could be.

    Attributes:
        name: Of what is left out.
        group: One of GROUPS.
        left_out: Whether it is, for this scene; if not, the row says what that would save.
            None where measuring it failed.
        unit: "ms" a frame, "MB", or "s".
        with_it, without: What both ways take; None where neither could be measured.
        saving: With it less without it, from turn to turn.
        change: What its absence changes in the result.
        verdict: SAVES, NOTHING, COSTS or NOT_MEASURED.
        why: Why it is left out, or isn't.
    """

    name: str
    group: str
    left_out: bool | None
    unit: str
    with_it: Timing | None
    without: Timing | None
    saving: Timing | None
    change: str
    verdict: str
    why: str

    @property
    def percent(self) -> Timing:
        """The saving, of what it is a part of."""
        whole = max(self.with_it.median, 1e-12) / 100.0
        saving = self.saving
        return Timing(saving.median / whole, saving.low / whole, saving.high / whole, saving.count)


def omission(
    name, group, compared: Compared, change, why, otherwise, left_out=True, unit="ms"
) -> Omission:
    """A row of what was measured.

    Args:
        why: The reason, where it saves something.
        otherwise: The reason, where it saves nothing.
    """
    found = verdict(*compared)
    why = why if found == SAVES else otherwise
    return Omission(name, group, left_out, unit, *compared, change, found, why)


def not_measured(name, group, why, left_out=True, unit="ms") -> Omission:
    """A row without numbers, that says why it has none."""
    return Omission(name, group, left_out, unit, None, None, None, "", NOT_MEASURED, why)


def verdict(with_it: Timing, without: Timing, saving: Timing) -> str:
    """What a saving amounts to, given its spread and how many turns it is of.

    A single turn is taken as it is: it is of what doesn't vary, like the size of a file.
    """
    few = 1 < saving.count < ENOUGH_TURNS
    if saving.low > 0.0:
        return NOTHING if few and with_it.low <= without.high else SAVES
    if saving.high < 0.0:
        return NOTHING if few and without.low <= with_it.high else COSTS
    return NOTHING


def compared_once(with_it, without) -> Compared:
    """Numbers that are the same at each repeat."""
    return tuple(timing_of([number]) for number in (with_it, without, with_it - without))


def compared_in_turns(with_it, without) -> Compared:
    """Numbers [n] of n turns."""
    with_it, without = np.asarray(with_it), np.asarray(without)
    return timing_of(with_it), timing_of(without), timing_of(with_it - without)


def image_change(with_it, without) -> str:
    """What images ([H, W, 3 or 4] uint8 each) without something differ by from those with it."""
    pairs = zip(with_it, without, strict=True)
    if all(np.array_equal(a, b) for a, b in pairs):
        return NONE
    error = image_error(*([image[..., :3] / 255.0 for image in way] for way in (with_it, without)))
    return f"{error.psnr:.1f} dB, at most {error.largest:.0f}/255"


def pose_change(with_it, without, size: float) -> str:
    """What poses ([V, 3] each) differ by, in object sizes."""
    if np.array_equal(with_it, without):
        return NONE
    away = np.linalg.norm(np.asarray(with_it, float) - without, axis=1)
    return f"at most {away.max() / size:.2g} sizes"
