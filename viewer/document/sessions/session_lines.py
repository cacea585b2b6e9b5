"""Write the lines of a session file, without the values that its reader refuses.

A value in memory that can't be written never keeps the rest from being written: it is left out, and
the user is told.
"""

import json
import math
from collections.abc import Callable

from ....core.base.streams import shown
from ..history.journal import EDITS, MAY_BE_INFINITE
from .session_values import bad_arguments

MOST_TOLD = 3  # of what is left out, by name


def line_of(entry) -> str:
    """A header or an event as a line of JSON."""
    return json.dumps(entry, separators=(", ", ": "), allow_nan=False) + "\n"


def event_lines(events, vertex_count: int, left_out: list[str]) -> str:
    """The lines of a journal's events; what they can't have is added to `left_out`."""
    return "".join(
        line_of([event.tick, event.name, kept])
        for event in events
        if (kept := _kept(event.name, event.arguments, vertex_count, left_out)) is not None
    )


def kept_start(start: dict, vertex_count: int, left_out: list[str]) -> dict:
    """What a session begins with, as far as it can be written; the rest is the model's own."""
    return _kept("start", start, vertex_count, left_out) or {}


def tell_left_out(left_out: list[str], tell: Callable) -> None:
    """Say what was left out, if anything was."""
    if left_out:
        more = len(left_out) - MOST_TOLD
        told = ", ".join(left_out[:MOST_TOLD]) + f" and {more} more" * (more > 0)
        tell(f"no session can have {told}: left out, all the rest is kept")


def _kept(name, arguments, vertex_count, left_out):
    """The arguments that a reader takes; None if without the others there is no such edit."""
    optional = name in ("start", "view")
    if not optional and name not in EDITS:
        left_out.append(shown(name))
        return None
    arguments = {key: finite(key, value) for key, value in arguments.items()}
    bad = bad_arguments(name, arguments, vertex_count)
    if not bad:
        return arguments
    left_out += [f"{name} {key} = {shown(arguments[key])}" for key in bad]
    kept = {key: value for key, value in arguments.items() if key not in bad}
    return kept if kept and (optional or EDITS[name].any_names) else None


def finite(key: str, value):
    """JSON has no infinity; what may be infinite is then None."""
    return None if key in MAY_BE_INFINITE and value == math.inf else value
