"""Options of all commands: one meaning each, old spellings, what --help shows."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest

from deformrf.commands import evaluate, view
from deformrf.commands.completion import arguments_of_all
from deformrf.commands.options import OLD, OnCpu, help_of, options_of, parsed, respelled
from deformrf.commands.training import TrainArguments
from deformrf.core.base.arguments import Arg
from deformrf.core.base.paths import ROOT

KINDS = arguments_of_all()
PAGE = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Group:
    """A group."""

    deep: bool = False
    """A flag in a group."""


@dataclass(frozen=True)
class Some(OnCpu):
    """Show
    what there is.

    And more.
    """

    path: Annotated[Path, Arg("PATH", positional=True)]
    """A path."""
    output: Annotated[Path, Arg("FILE", short="-o")]
    """A file
    to write."""
    box: Annotated[tuple[float, float] | None, Arg("LOW HIGH")] = None
    """Two numbers."""
    words: Annotated[tuple[str, ...], Arg("WORD ...")] = ()
    """Any number."""
    bits: Literal[8, 16] = 8
    """One of two."""
    shine: bool = True
    """Without shine."""
    share: Annotated[float, Arg("SHARE")] = 0.5
    """A share."""
    inner: Group = Group()

    GROUPS = {"Numbers": ("box", "bits", "share")}  # noqa: RUF012


def test_words_become_a_dataclass():
    words = "a.npz -o b.npz --box -1e-3 2 --words x y --bits 16 --no-shine --deep --device cpu"
    found = parsed("x", Some, words.split())
    assert found == Some(
        *(Path("a.npz"), Path("b.npz"), (-1e-3, 2.0), ("x", "y"), 16, False, 0.5, Group(True)),
        device="cpu",
    )
    assert parsed("x", Some, ["a", "-o", "b"]) == Some(Path("a"), Path("b"))
    found = parsed("x", Some, ["-o", "-2.npz", "--box", "-inf", "-.5", "--", "-3d.npz"])
    assert found == Some(Path("-3d.npz"), Path("-2.npz"), (-float("inf"), -0.5))


def test_help_has_all_of_it():
    page = help_of("x", Some)
    assert page.startswith("usage: x PATH -o FILE [OPTIONS]\n\nShow what there is.\n\nAnd more.\n")
    for line in (
        "  -o, --output FILE     A file to write.\n",
        "  --no-shine            Without shine.\n",
        "Numbers:\n  --box LOW HIGH        Two numbers.\n",
        "  --bits 8|16           One of two. Default: 8.\n",
        "A group:\n  --deep                A flag in a group.\n",
        "In every command:\n  --device auto|cpu|cuda\n",
    ):
        assert line in page, page


def test_a_command_of_the_cpu_says_so(capsys):
    parsed("x", Some, ["a", "-o", "b", "--device", "cuda"])
    assert capsys.readouterr().err == "x: works on the CPU; --device changes nothing\n"


@pytest.mark.parametrize("name", KINDS)
def test_help_shows_no_types_and_no_markup(name):
    page = help_of(f"deformrf {name}", KINDS[name])
    types = r"None[,}|]|: None|\(default|False|True|INT|FLOAT|STR\b|`|\*\*|::"
    assert not re.search(types, page)
    assert max(map(len, page.splitlines())) <= 100
    for option in options_of(KINDS[name]):
        assert option.text.endswith(".") and (option.value or option.kind is bool), option
    for common in ("--device", "--version", "--verbose", "--help"):
        assert f"{common} " in page


def test_an_option_has_one_meaning_in_all_commands():
    """Its value looks the same in all of them: WxH is no length in meters, a count no folder."""
    values = {}
    for kind in KINDS.values():
        for option in options_of(kind):
            for name in option.names:
                values.setdefault(name, set()).add(option.value)
    several = {name: found for name, found in values.items() if len(found) > 1}
    assert several == {"-o": {"FILE", "FOLDER"}, "--output": {"FILE", "FOLDER"}}
    assert values["--size"] == {"WxH"} and values["--object-size"] == {"METERS"}


def test_old_spellings_name_options_that_are_there():
    for program, old in OLD.items():
        names = {name for option in options_of(KINDS[program[9:]]) for name in option.names}
        for before, now in old.items():
            opposite = now or before.replace("--no-", "--")
            assert before not in names
            assert opposite in names or f"--no-{before[2:]}" in names


def test_the_size_in_meters_has_another_name_and_says_so(capsys):
    chosen = parsed("deformrf train", TrainArguments, ["a", "-o", "b.npz", "--size=0.3"])
    assert chosen.object_size == 0.3
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "taken as --object-size" in said and "meters" in said
    assert parsed("deformrf view", view.ViewArguments, ["--size", "64x48"]).size == "64x48"
    assert capsys.readouterr().err == ""


def test_other_old_spellings_are_read_in_silence(capsys):
    words = ["m.npz", "d", "--json", "s.json", "--images", "p", "--image_size", "9"]
    chosen = parsed("deformrf eval", evaluate.EvaluateArguments, words)
    assert (chosen.output, chosen.pictures, chosen.image_size) == (Path("s.json"), Path("p"), 9)
    old = ["--resume", "--no-view-dependence", "--no-resume", "--view-dependence", "--seed", "1"]
    assert respelled("deformrf train", old) == ["--seed", "1"]
    assert capsys.readouterr().err == ""


def test_the_page_of_commands_names_each_and_no_option_that_is_not_there():
    names = {
        name for kind in KINDS.values() for option in options_of(kind) for name in option.names
    }
    names |= {name for old in OLD.values() for name in old}
    names |= {"--version", "--verbose", "--help", "--doctor", "--standalone", "--nproc-per-node"}
    names |= {"--no-python"}
    named = set(re.findall(r"(?<![\w-])--?[a-z][a-z-]*", PAGE))
    assert named and not named - names
    for command in KINDS:
        assert f"`deformrf {command}" in PAGE, command
