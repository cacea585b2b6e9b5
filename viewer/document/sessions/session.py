"""Session files: what was done to a model, to be played again.

A session is JSON, one object a line.  The first line says what it is:

    {"deformrf session": 1, "model": "helmet", "vertices": 1611, "tets": 5339,
     "rest": "<SHA-256 of the rest vertices and tets>", "device": "cpu", "ticks": 600,
     "start": {"young_modulus": 1e6, ..., "meters": 1.0}}

Each other line is an event: the number of ticks (1/60 s of the object's time) that had passed,
the edit, and its arguments (journal.py; docs/session-format.md lists them):

    [12, "grab", {"vertex": 407, "radius": 0.08, "soft": false}]

Nothing in a file is trusted: names, kinds and ranges are checked before anything is played.
"""

import hashlib
import json
import logging
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np

from ....core.base.paths import BUNDLED, program_version, whole_file
from ....core.base.reading import open_file
from ....core.base.schema import integer
from ....core.base.streams import printable, shown
from ....core.deform import FIRST_INTEGRATOR, XpbdSolver
from ....core.field import TetField
from ...settings import HANDS, Settings
from ..history.journal import EDITS, MAY_BE_INFINITE, Event, Journal
from ..scene import scene  # noqa: F401  its methods and those of its objects are the edits
from ..scene.body import Body
from ..scene.points import ControlPoints
from .session_values import bad_arguments

log = logging.getLogger(__name__)

KEY, VERSION = "deformrf session", 1
LARGEST_FILE = 512 * 2**20  # bytes
LONGEST = 24 * 3600 * 60  # ticks: a day
is_tick = integer(0, LONGEST)
MOST_EVENTS = 2_000_000
MOST_TOLD = 3  # of what is left out, by name
LONGEST_LINE = 32 * 2**20  # bytes; an edit that deletes all of a million tets has as many


class SessionError(ValueError):
    """A file is no session, or not one of this model; the message is one sentence."""


class OpenObject(Protocol):
    """The object that is open, and what was done to it."""

    name: str
    source: Path | None
    field: TetField
    solver: XpbdSolver
    journal: Journal


class WithPoints(Protocol):
    """Handles."""

    points: ControlPoints


class Beginning(Protocol):
    """The object with which a session begins."""

    field: TetField
    solver: XpbdSolver
    body: Body
    handles: WithPoints
    settings: Settings
    pins: np.ndarray  # of a held object  [V] bool
    floor: float


@dataclass(frozen=True)
class Session:
    """A session that was read."""

    header: dict[str, Any]
    events: list[Event]
    path: Path | None = None  # of its file, for sentences; its second line is the first event

    @property
    def ticks(self) -> int:
        """Its length."""
        last = self.events[-1].tick if self.events else 0
        return max(last, self.header.get("ticks", 0))


def mesh_hash(mesh) -> str:
    """A number for the shape of a mesh at rest: SHA-256, hexadecimal."""
    arrays = mesh.rest_vertices.astype("<f4"), mesh.tets.astype("<i4")
    return hashlib.sha256(b"".join(one.tobytes() for one in arrays)).hexdigest()


def hashes_of(field: TetField) -> dict[str, str | None]:
    """What a session's start says of its model's stiffnesses and rig: SHA-256, hexadecimal."""
    told: dict[str, str | None] = dict.fromkeys(("stiffness", "rig"))
    if field.stiffness is not None:
        told["stiffness"] = hashlib.sha256(np.asarray(field.stiffness, "<f4").tobytes()).hexdigest()
    if field.rig_arrays is not None:
        found = hashlib.sha256()
        for name in sorted(field.rig_arrays):
            values = np.ascontiguousarray(field.rig_arrays[name])
            found.update(f"{name} {values.dtype.str} {values.shape}".encode())
            found.update(values.tobytes())
        told["rig"] = found.hexdigest()
    return told


def start_of(begun: Beginning) -> dict:
    """What a session begins with, so that other defaults change nothing when it is played."""
    body, options = begun.body, begun.solver.options
    material = {name: finite(name, value) for name, value in asdict(body.material).items()}
    return material | {
        "meters_per_unit": body.meters_per_unit,
        "substep_count": options.substep_count,
        "automatic_substeps": body.automatic_substeps,
        "contact": options.contact,
        "integrator": options.integrator,
        "pins": np.flatnonzero(begun.pins).tolist(),
        "points": begun.handles.points.rows(),
        "floor": begun.floor,
        "hand": begun.settings.hand,
        **hashes_of(begun.field),
    }


def save_session(opened: OpenObject, start: dict, path: Path, tell: Callable = log.warning) -> Path:
    """Write what was done to an object since it had this `start`.

    What no reader would take is left out: `tell` gets a sentence then.

    Raises:
        SessionError: It is longer than those that can be read.
        OSError: The file can't be written; one that was there before stays.
    """
    text, left_out = session_text(opened, start, name_of_model(opened.source, path))
    with whole_file(Path(path)) as partial, open(partial, "w", encoding="utf-8") as file:
        file.write(text)
    tell_left_out(left_out, tell)
    return Path(path)


def session_text(opened: OpenObject, start: dict, model_file: str | None) -> tuple[str, list[str]]:
    """What `save_session` writes, and what no reader would take, which is left out.

    Args:
        model_file: How the session names the file of its model.

    Raises:
        SessionError: It is longer than those that can be read.
    """
    mesh = opened.field.mesh
    header = {
        KEY: VERSION,
        "program": program_version(),
        "model": opened.name,
        "file": model_file,
        "vertices": mesh.vertex_count,
        "tets": mesh.tet_count,
        "rest": mesh_hash(mesh),
        "device": str(opened.solver.device),
        "ticks": opened.journal.tick,
        "start": _kept("start", start, mesh.vertex_count, left_out := []) or {},
    }
    return _line_of(header) + _event_lines(opened, 0, left_out), left_out


def name_of_model(source: Path | None, session: Path) -> str | None:
    """A model's file as a session names it; None for a bundled one, and without a file."""
    if source is None or Path(source) in BUNDLED.values():
        return None
    try:
        name = os.path.relpath(Path(source).resolve(), Path(session).resolve().parent)
    except ValueError:  # it is on another drive
        return Path(source).name
    return Path(name).as_posix()


def append_events(
    opened: OpenObject, path: Path, written: int, tell: Callable = log.warning
) -> None:
    """Add the events behind the first `written` ones to a session's file, as `save_session` does.

    Raises:
        SessionError: The session is longer than those that can be read.
        OSError: The file can't be written.
    """
    text = _event_lines(opened, written, left_out := [])
    with open(path, "a", encoding="utf-8") as file:
        file.write(text)
    tell_left_out(left_out, tell)


def _line_of(entry) -> str:
    """A header or an event as a line of JSON."""
    return json.dumps(entry, separators=(", ", ": "), allow_nan=False) + "\n"


def _event_lines(opened: OpenObject, first: int, left_out: list[str]) -> str:
    """The lines of its events from the first one on; what they can't have goes to `left_out`.

    What no reader would take never keeps the rest from being written.
    """
    journal, most = opened.journal, MOST_EVENTS - 1  # the header is a line, too
    count = len(journal.events)
    if count > most or journal.tick > LONGEST:
        raise SessionError(
            f"the session is too long for a file: {count:,} events in {journal.tick:,} ticks, and "
            f"{most:,} in {LONGEST:,} are the most; open the model again to begin another one"
        )
    vertex_count = opened.field.mesh.vertex_count
    return "".join(
        _line_of([event.tick, event.name, kept])
        for event in journal.events[first:]
        if (kept := _kept(event.name, event.arguments, vertex_count, left_out)) is not None
    )


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


# -- reading -------------------------------------------------------------------------------------


def load_session(path: str | Path, field: TetField, whole: bool = True) -> Session:
    """Read and check a session of a model.

    Args:
        whole: False if its writer may have been stopped in the middle of the last line, which
            is left out then.

    Raises:
        SessionError: The file is no session, is damaged, or is one of another mesh.
        OSError: It can't be read.
    """
    path = Path(path)
    with open_file(path, LARGEST_FILE) as file:
        return session_of(file, path, field, whole)


def session_of(file: BinaryIO, path: Path, field: TetField, whole: bool = True) -> Session:
    """The same from the lines of a stream; `path` is for sentences."""
    header = header_of(file, path)
    _check_header(path, header, field.mesh)
    events = []
    for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), b""), start=2):
        if not whole and not line.endswith(b"\n"):
            break
        if number > MOST_EVENTS:
            raise SessionError(f"{path} has more than {MOST_EVENTS:,} events")
        parsed = _parsed(path, number, line)
        events.append(_event(path, number, parsed, field.mesh.vertex_count))
    if any(a.tick > b.tick for a, b in pairwise(events)):
        raise SessionError(f"{path}: its events are not in order")
    return Session(header, events, path)


def read_header(path: Path) -> dict:
    """A session's first line, of which nothing but its version is checked.

    Raises:
        SessionError: The file is no session.
        OSError: It can't be read.
    """
    with open_file(path, LARGEST_FILE) as file:
        return header_of(file, path)


def header_of(file: BinaryIO, path: Path) -> dict:
    """The same from a stream; `path` is for sentences."""
    header = _parsed(path, 1, file.readline(LONGEST_LINE))
    if not isinstance(header, dict) or KEY not in header:
        raise SessionError(f"{path} is not a session: its first line doesn't say so")
    if header[KEY] != VERSION:
        version = shown(header[KEY])
        raise SessionError(f"{path} has version {version}; this program reads {VERSION}")
    return header


def fits(field: TetField, header: dict) -> bool:
    """Whether a session with this header begins with a model."""
    wanted, own = start_in(header), hashes_of(field)
    same = all(wanted.get(name, value) == value for name, value in own.items())
    return same and header.get("rest") == mesh_hash(field.mesh)


def start_in(header: dict) -> dict:
    """The `start` of a header that is not checked yet."""
    start = header.get("start")
    return start if isinstance(start, dict) else {}


def _parsed(path, number, line):
    try:
        return json.loads(line.decode(), parse_constant=_refuse)
    except UnicodeDecodeError as error:
        raise SessionError(f"{path} is not a session: it is not text") from error
    except (ValueError, RecursionError) as error:
        raise SessionError(f"{path}, line {number} is not JSON") from error


def _refuse(name):
    raise ValueError(name)


def _check_header(path, header, mesh):
    if header.get("rest") != mesh_hash(mesh):
        name, tets = shown(header.get("model")), shown(header.get("tets"))
        raise SessionError(
            f"{path} is a session of another mesh ({name}, {tets} tets), not of this one of "
            f"{mesh.tet_count} tets"
        )
    start, ticks = header.get("start"), header.get("ticks")
    if not isinstance(start, dict) or not is_tick(ticks):
        raise SessionError(f"{path}: its first line lacks 'start' or 'ticks'")
    _check(path, 1, "start", start, mesh.vertex_count)
    # The first sessions lack these.
    absent = {"automatic_substeps": False, "integrator": FIRST_INTEGRATOR, "hand": HANDS[0]}
    header["start"] = absent | start


# -- events ------------------------------------------------------------------------------------


def _event(path, number, line, vertex_count) -> Event:
    place = f"{path}, line {number}"
    if not (isinstance(line, list) and len(line) == 3):
        raise SessionError(f"{place} is not [tick, name, arguments]")
    tick, name, arguments = line
    if not is_tick(tick):
        raise SessionError(f"{place} has the tick {shown(tick)}")
    if not isinstance(name, str) or (name != "view" and name not in EDITS):
        raise SessionError(f"{place} has the unknown edit {shown(name)}")
    if not isinstance(arguments, dict):
        raise SessionError(f"{place}: the arguments of {name} are not in braces")
    if name != "view" and not EDITS[name].any_names:
        missing = set(EDITS[name].parameters) - set(arguments)
        if missing:
            raise SessionError(f"{place}: {name} lacks {', '.join(sorted(missing))}")
    _check(path, number, name, arguments, vertex_count)
    return Event(tick, name, arguments)


def _check(path, number, name, arguments, vertex_count):
    """Raise a SessionError if an edit has an argument that it can't have."""
    for key in bad_arguments(name, arguments, vertex_count):
        where, value = f"{path}, line {number}", shown(arguments[key])
        raise SessionError(f"{where}: {name} can't have {printable(key)[:60]} = {value}")
