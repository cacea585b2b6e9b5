"""The choices for a film, and the arguments of deformrf render that say so."""

from pathlib import Path

import pytest

from deformrf.commands import options
from deformrf.commands.render import RenderArguments, check
from deformrf.viewer.films import FREE, KINDS, SIZES, FilmChoices


@pytest.mark.parametrize(
    "size, window, line",
    [
        ("1920x1080", (5, 5), "1920 x 1080, 16:9"),
        ("1080x1080", (5, 5), "1080 x 1080, 1:1"),
        ("1080x1920", (5, 5), "1080 x 1920, 9:16"),
        ("as the window", (801, 600), "800 x 600, 4:3; a film's sides are even"),
        ("as the window", (1366, 768), "1366 x 768, 1.78:1"),
        ("as the window", (20, 600), "20 x 600: both sides have to be 32 to 8192"),
    ],
)
def test_a_size_is_told(size, window, line):
    assert FilmChoices("a", size).size_line(window) == line


@pytest.mark.parametrize(
    "sides, is_good",
    [((33, 8192), True), ((31, 600), False), ((600, 9000), False), ((-4, 0), False)],
)
def test_two_numbers_are_a_size(sides, is_good):
    choices = FilmChoices("a", FREE, free_size=sides)
    assert (not choices.size_problem((800, 600))) == is_good
    assert all(side % 2 == 0 for side in choices.pixels((800, 600)))
    assert choices.size_line((800, 600))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("what", KINDS)
@pytest.mark.parametrize("handles", [False, True])
def test_what_is_chosen_is_a_command(tmp_path, monkeypatch, size, what, handles):
    monkeypatch.chdir(tmp_path)
    choices = FilmChoices("a", size, what=what, handles=handles, turn_seconds=3.5)
    session = tmp_path / "s.jsonl"
    arguments = choices.arguments((640, 480), session, (3, 9))
    parsed = options.parsed("deformrf render", RenderArguments, [*arguments, "-o", "a.mp4"])
    assert check(parsed) == choices.pixels((640, 480))
    assert parsed.timeline == (what == "timeline")
    assert (parsed.first, parsed.last) == ((3, 9) if what == "take" else (None, None))
    turns = what == "turntable"
    assert (parsed.pose, parsed.session) == ((session, None) if turns else (None, session))
    assert parsed.turntable == (3.5 if turns else None)
    shown = parsed.show_handles or not (parsed.hide_handles or turns)  # as commands/render.py does
    assert shown == handles


def test_a_film_goes_into_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert FilmChoices("a").path == tmp_path / "a.mp4"
    assert FilmChoices("a", folder="films").path == tmp_path / "films" / "a.mp4"
    assert FilmChoices("a", folder="~/films").path == tmp_path / "home" / "films" / "a.mp4"
    assert FilmChoices("a", format="PNG files", folder="/x").path == Path("/x/a")
    assert FilmChoices("b.c", folder="films").session == tmp_path / "films" / "b.c.jsonl"
