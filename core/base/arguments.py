"""Options that several commands have: how --help shows them, and their checks."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple

from .claims import claim
from .paths import BUNDLED, DEFAULT_MODEL, WriteError, discard, reserved, target_of

SMALLEST_SIZE, LARGEST_SIZE = 1e-4, 1e4  # m, of an object's longest side


class Arg(NamedTuple):
    """How an option is written, as a note of the type of its field."""

    value: str = ""  # what stands for its value in --help
    short: str = ""
    name: str = ""  # without dashes; "" for the field's
    positional: bool = False


Count = Annotated[int | None, Arg("N")]
Model = Annotated[Path, Arg("MODEL", positional=True)]
Data = Annotated[Path, Arg("DATA", positional=True)]
Output = Annotated[Path, Arg("FILE", short="-o")]
Name = Annotated[str | None, Arg("NAME")]
Demo = Name
Share = Annotated[float, Arg("SHARE")]  # 0 to 1
Meters = Annotated[float | None, Arg("METERS")]
File = Annotated[Path | None, Arg("PATH")]
Folder = Annotated[Path | None, Arg("FOLDER")]
Point = Annotated[tuple[(float,) * 3] | None, Arg("X Y Z")]
Box = Annotated[tuple[(float,) * 6] | None, Arg("X0 Y0 Z0 X1 Y1 Z1")]


def plain_message(error: Exception) -> str:
    """An error's text, without the operating system's error number."""
    named = isinstance(error, OSError) and not isinstance(error, WriteError)
    if named and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def at_least(smallest: int, name: str, value: int | None) -> None:
    """A ValueError that calls the value by its name if it is smaller; None is good."""
    if value is not None and value < smallest:
        raise ValueError(f"{name} is {value}: it has to be at least {smallest}")


def at_most(largest: int, name: str, value: int | None) -> None:
    """A ValueError that calls the value by its name if it is larger; None is good."""
    if value is not None and value > largest:
        raise ValueError(f"{name} is {value}: it has to be at most {largest}")


def object_size(name: str, meters: float | None) -> None:
    """A ValueError that calls the length by its name if no object has it; None is good."""
    if meters is not None and not SMALLEST_SIZE <= meters <= LARGEST_SIZE:
        raise ValueError(
            f"{name} is {meters}: it has to be from {SMALLEST_SIZE:g} to {LARGEST_SIZE:g} m"
        )


def positive(name: str, value: float | None) -> None:
    """A ValueError that calls the value by its name if it isn't a positive number; None is good."""
    if value is not None and not 0.0 < value < float("inf"):
        raise ValueError(f"{name} is {value}: it has to be a positive number")


def chosen_model(model: Path, demo: str | None) -> Path:
    """The model, or the bundled one of --demo; a ValueError if there is none, or both are given.

    Args:
        model: DEFAULT_MODEL if the command line names none.
    """
    if demo is None:
        return model
    if demo not in BUNDLED:
        raise ValueError(f"--demo is {demo!r}; it is one of {', '.join(BUNDLED)}")
    if model != DEFAULT_MODEL:
        raise ValueError(f"--demo opens a bundled model: leave it out, or {model}")
    return BUNDLED[demo]


def with_size(field, meters: float | None):
    """A TetField that states the length of the object's longest side [m], if one is given."""
    return field if meters is None else replace(field, meta={**field.meta, "size": meters})


def writable_file(path: Path, ending: str, source: Path | None = None) -> Path:
    """The path, if a file can be written there: better known now than after an hour.

    Args:
        source: A file that is read, and has to stay.

    Raises:
        ValueError: Its ending is another one, it is the source, or another process writes there.
        OSError: It can't be written; something else than a file is there.
    """
    if path.suffix != ending:
        raise ValueError(f"the file to write, {path}, has to end in {ending}")
    if source is not None and os.path.realpath(path) == os.path.realpath(source):
        raise ValueError(f"{path} is read, and would be lost: give another file to write")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        target = target_of(path)
        discard(reserved(target))
        if target.exists():  # its owner may have protected it
            target.open("ab").close()
    except OSError as error:
        named = error.filename if path.parent.is_dir() else path.parent
        raise WriteError(error.errno, error.strerror or str(error), str(named or path)) from error
    claim(path)
    return path
