"""The options of a command, read from its dataclass: parsing, --help, completion, old spellings.

A field is an option; the text below it is what --help says of it, the class's own text is the
command's.  A field whose type is a dataclass is a group of options; a class attribute GROUPS, the
names of fields by title, makes groups of a flat class, too.
"""

import argparse
import ast
import dataclasses
import inspect
import logging
import re
import shutil
import sys
import textwrap
from difflib import get_close_matches
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from ..core.base.arguments import Arg
from ..core.base.device import Choice
from ..core.base.streams import keep_going, printable
from .dispatch import HELP, INPUT_ERROR, VERBOSE, VERSION, chosen

EVERYWHERE = "In every command"
COMMON = f"""
  {VERBOSE}             Print on stderr what the program notes.
  {VERSION}             Print the version.
  -h, --help            Print this."""
COLUMN, NARROWEST, WIDEST = 24, 60, 100
# Spellings that go on working: what each is now; None of a flag that takes its opposite back.
OLD = {
    "deformrf train": {
        "--size": "--object-size",
        "--no-keep-surroundings": None,
        "--no-outside-images": None,
        "--no-resume": None,
        "--view-dependence": None,
    },
    "deformrf eval": {
        "--json": "--output",
        "--images": "--pictures",
        "--no-outside-images": None,
    },
    "deformrf rig check": {"--frames-per-second": "--fps"},
    "deformrf rig import": {"--frames-per-second": "--fps"},
    "deformrf rig quality": {"--no-untangle": None},
}
MOVED = {  # said when an old spelling is used, because it means something else elsewhere
    "--size": "--size is a size in pixels; taken as {new}, the object's longest side in meters",
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class OnCpu:
    """For a command that works on the CPU alone."""

    device: Choice = "auto"
    """Accepted as by the other commands; this one works on the CPU by default, and always."""


class Option(NamedTuple):
    """An option, or what is given without a name.

    Attributes:
        field: Name of the dataclass's field.
        names: "--size", "-o"; empty for what has no name.
        value: What stands for the value in --help; "" of a flag.
        kind: Of a value; of each value if there are several.
        count: Of values: None for one, "*" for any number.
        choices: The values, if they are but a few.
        group: Title.
    """

    field: str
    names: tuple[str, ...]
    value: str
    kind: type
    count: int | str | None
    choices: tuple
    required: bool
    default: object
    text: str
    group: str


class Parser(argparse.ArgumentParser):
    """Ends with one sentence where argparse prints the usage, too."""

    def error(self, message):
        message = printable(message.removeprefix("argument "))
        print(f"{self.prog}: {message}; {self.prog} --help lists the options", file=sys.stderr)
        raise SystemExit(INPUT_ERROR)


def parsed(program: str, kind: type, words: list[str] | None = None):
    """The arguments of a command; from now on it logs to stderr.

    Args:
        kind: A dataclass of arguments.
        words: Of the command line; None takes those of the process.

    Raises:
        SystemExit: --help was asked for, or the words are not the command's.
    """
    keep_going()
    words = respelled(program, sys.argv[1:] if words is None else words)
    if {*HELP} & {*words}:
        print(help_of(program, kind))
        raise SystemExit(0)
    parser = Parser(prog=program, allow_abbrev=False, add_help=False)
    names = [name for option in options_of(kind) for name in option.names]
    for option in options_of(kind):
        _add(parser, option)
    # argparse takes -1 for a number, but -1e-3 for an option.
    parser._negative_number_matcher = re.compile(r"-(\.?\d|inf)")
    found, unknown = parser.parse_known_args(words)
    if unknown:
        word = unknown[0].partition("=")[0]
        what = f"there is no option {word}" if word.startswith("-") else f"{word!r} is one too many"
        near = get_close_matches(word, names, 1) if word.startswith("-") else []
        parser.error(what + "".join(f" (did you mean {name}?)" for name in near))
    arguments = _filled(kind, vars(found))
    if isinstance(arguments, OnCpu) and arguments.device == "cuda":
        print(f"{program}: works on the CPU; --device changes nothing", file=sys.stderr)
    logging.basicConfig(level=logging.WARNING, format=f"{program}: %(message)s")
    return arguments


def _add(parser, option: Option):
    """Tell argparse of an option."""
    given = {"dest": option.field, "default": option.default, "required": option.required}
    if not option.value:
        action = "store_false" if option.default is True else "store_true"
        parser.add_argument(*option.names, action=action, **given)
        return
    given |= {"type": _converter(option.kind), "metavar": option.value, "nargs": option.count}
    given |= {"choices": option.choices or None}
    if not option.names:
        given["nargs"] = None if given.pop("required") else "?"
    parser.add_argument(*option.names, **given)


def _converter(kind: type):
    """What makes a value of a word; its error names no type of Python."""

    def convert(word):
        try:
            return kind(word)
        except ValueError:
            what = "whole number" if kind is int else "number"
            raise argparse.ArgumentTypeError(f"{word!r} is no {what}") from None

    return convert


def _filled(kind: type, values: dict):
    """A dataclass of these values, with its groups."""
    own = {}
    for field in dataclasses.fields(kind):
        inner = field.type if dataclasses.is_dataclass(field.type) else None
        value = _filled(inner, values) if inner else values[field.name]
        own[field.name] = tuple(value) if isinstance(value, list) else value
    return kind(**own)


def parsed_one(program: str, about: str, commands: dict):
    """The subcommand that the process's words name.

    Args:
        about: What the command does, in a sentence.
        commands: By name, pairs of a dataclass of arguments and what prepares their work.

    Returns:
        Program with the subcommand, arguments, and the second of the pair.

    Raises:
        SystemExit: As `parsed` and `chosen`.
    """
    keep_going()
    listed = {
        name: (None, kind.__doc__[0].lower() + inspect.cleandoc(kind.__doc__)[1:].rstrip("."))
        for name, (kind, _) in commands.items()
    }
    around = f"usage: {program} COMMAND ...\n\n{about}", f"{program} COMMAND --help lists options."
    name, words = chosen(program, sys.argv[1:], listed, around)
    kind, prepare = commands[name]
    return f"{program} {name}", parsed(f"{program} {name}", kind, words), prepare


def respelled(program: str, words: list[str]) -> list[str]:
    """The words with options as they are spelled now: with dashes, and without old names."""
    old, now = OLD.get(program, {}), []
    for word in words:
        name, equals, value = word.partition("=")
        name = name.replace("_", "-") if name.startswith("--") else name
        new = old.get(name, name)
        if new is None and not equals:
            opposite = f"--{name[5:]}" if name.startswith("--no-") else f"--no-{name[2:]}"
            now = [earlier for earlier in now if earlier != opposite]
            continue
        if new != name and name in MOVED:
            print(f"{program}: {MOVED[name].format(new=new)}", file=sys.stderr)
        now.append((new or name) + equals + value)
    return now


def help_of(program: str, kind: type) -> str:
    """The page of --help."""
    width = min(max(shutil.get_terminal_size().columns, NARROWEST), WIDEST)
    found = options_of(kind)
    usage = ["usage:", program]
    for option in found:
        if not option.names:
            usage.append(option.value if option.required else f"[{option.value}]")
        elif option.required:
            usage.append(f"{option.names[0]} {option.value}")
    page = [" ".join([*usage, "[OPTIONS]"]), ""]
    for paragraph in inspect.cleandoc(kind.__doc__).split("\n\n"):
        page += [*textwrap.wrap(" ".join(paragraph.split()), width), ""]
    groups = {}
    for option in found:
        groups.setdefault(option.group, []).append(option)
    groups[EVERYWHERE] = groups.pop(EVERYWHERE, [])
    for title, members in groups.items():
        page += [f"{title}:", *(line for one in members for line in _lines(one, width)), ""]
    return "\n".join(page).rstrip() + COMMON


def _lines(option: Option, width: int) -> list[str]:
    """An option of --help: names and value, then the text in a column of its own."""
    left = "  " + ", ".join(option.names)
    left += (" " if option.names else "") + option.value if option.value else ""
    indent = " " * COLUMN
    lines = textwrap.wrap(option.text, width, initial_indent=indent, subsequent_indent=indent)
    if len(left) > COLUMN - 2 or not lines:
        return [left, *lines]
    return [f"{left:{COLUMN}}{lines[0].strip()}", *lines[1:]]


@cache
def options_of(kind: type) -> tuple[Option, ...]:
    """All options of a command's dataclass, in the order of --help."""
    titles = getattr(kind, "GROUPS", {})
    groups = {name: title for title, names in titles.items() for name in names}
    hints, texts, found = get_type_hints(kind, include_extras=True), _texts(kind), []
    for field in dataclasses.fields(kind):
        if dataclasses.is_dataclass(hint := hints[field.name]):
            title = inspect.cleandoc(hint.__doc__).rstrip(".")
            found += [one._replace(group=title) for one in options_of(hint)]
        else:
            group = groups.get(field.name, EVERYWHERE if field.name == "device" else "Options")
            found.append(_option(field, hint, texts.get(field.name, ""), group))
    order = {title: place for place, title in enumerate(["Arguments", "Options", *titles])}
    return tuple(sorted(found, key=lambda one: order.get(one.group, len(order))))


def _option(field, hint, text: str, group: str) -> Option:
    """The Option of a dataclass's field."""
    required, default = field.default is dataclasses.MISSING, field.default
    if required:
        default = None
    kind, arg = _bare(hint), Arg()
    for note in getattr(hint, "__metadata__", ()):  # the outer ones count
        arg = arg._replace(**{name: value for name, value in note._asdict().items() if value})
    name = (arg.name or field.name).replace("_", "-")
    names = (*filter(None, [arg.short]), f"--no-{name}" if default is True else f"--{name}")
    count, choices = None, ()
    if get_origin(kind) is Literal:
        choices = get_args(kind)
        kind = type(choices[0])
    elif get_origin(kind) is tuple:
        inner = get_args(kind)
        kind, count = inner[0], "*" if inner[-1] is ... else len(inner)
    value = "" if kind is bool else arg.value or "|".join(map(str, choices))
    if kind is not bool and isinstance(default, str | int | float | Path) and "default" not in text:
        text = f"{text} Default: {f'{default:g}' if isinstance(default, float) else default}."
    if arg.positional:
        names, group = (), "Arguments"
    return Option(field.name, names, value, kind, count, choices, required, default, text, group)


def _bare(hint):
    """A type without notes, and without None."""
    if get_origin(hint) is Annotated:
        return _bare(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType):
        return _bare(next(one for one in get_args(hint) if one is not NoneType))
    return hint


def _texts(kind: type) -> dict[str, str]:
    """The text below each field of a dataclass and of those that it inherits from, in one line."""
    texts = {}
    for one in reversed(kind.__mro__[:-1]):
        body = ast.parse(textwrap.dedent(inspect.getsource(one))).body[0].body
        for statement, below in pairwise(body):
            if isinstance(statement, ast.AnnAssign) and isinstance(below, ast.Expr):
                texts[statement.target.id] = " ".join(below.value.value.split())
    return texts
