"""What is remembered from one start to the next, and files that can't be trusted."""

import json
import os

import pytest

from deformrf.viewer import preferences as p
from deformrf.viewer.settings import Settings


@pytest.fixture
def path(tmp_path):
    return tmp_path / "folder" / "preferences.json"


def write(path, values):
    path.parent.mkdir(exist_ok=True)
    path.write_text(values if isinstance(values, str) else json.dumps(values))


def test_what_is_saved_is_loaded(path, tmp_path):
    kept, problem = p.load(path)
    assert kept == p.Preferences(path=path) and problem == ""
    settings = Settings(background=(0.1, 0.2, 0.3), panel_side="right", show_panel=False)
    settings.target_fps, settings.has_dragged = 24.0, True
    p.take(kept, settings, usual_fps=10.0)
    kept.window_size = (640, 480)
    kept.opened(tmp_path / "a.npz")
    assert kept.save() == ""
    loaded, problem = p.load(path)
    assert loaded == kept and problem == ""
    fresh = Settings()
    p.apply(loaded, fresh)
    assert fresh == settings


def test_the_devices_own_frame_rate_is_not_remembered(path):
    kept = p.Preferences()
    p.take(kept, Settings(target_fps=10.0), usual_fps=10.0)
    assert kept.target_fps is None
    settings = Settings(target_fps=60.0)
    p.apply(kept, settings)
    assert settings.target_fps == 60.0


def test_files_that_were_opened_are_named_once_the_last_one_first(tmp_path):
    kept = p.Preferences()
    for name in "abcab":
        kept.opened(tmp_path / name)
    assert [os.path.basename(one) for one in kept.recent] == ["b", "a", "c"]
    for number in range(50):
        kept.opened(tmp_path / str(number))
    assert len(kept.recent) == p.MOST_RECENT


HEADER = {p.KEY: p.VERSION}


@pytest.mark.parametrize(
    "content",
    [
        "",
        "not JSON",
        "[" * 10**5,
        "[]",
        "{}",
        HEADER | {p.KEY: 99},
        "x" * (p.LARGEST_FILE + 1),
        HEADER | {"window_size": [0, 0]},
        HEADER | {"window_size": [1200, "800"]},
        HEADER | {"window_size": [True, 800]},
        HEADER | {"background": [0.0, 0.0, 2.0]},
        HEADER | {"background": [float("nan")] * 3},
        HEADER | {"target_fps": float("inf")},
        HEADER | {"panel_side": ["left"]},
        HEADER | {"interop": {}},
        HEADER | {"recent": ["a"] * 1000},
        HEADER | {"recent": ["a\0b"]},
        HEADER | {"recent": 3},
    ],
    ids=str,
)
def test_a_damaged_file_is_moved_aside_with_a_message(path, content):
    write(path, content)
    before = path.read_bytes()
    kept, problem = p.load(path)
    (aside,) = path.parent.iterdir()
    assert str(aside) in problem and aside != path and aside.read_bytes() == before
    assert kept == p.Preferences(path=path)
    assert kept.save() == "" and p.load(path) == (kept, "")


def test_good_values_of_a_damaged_file_are_kept(path):
    write(path, HEADER | {"panel_side": "right", "grab_radius": -1, "unknown": 3})
    kept, problem = p.load(path)
    assert kept.panel_side == "right" and "grab_radius = -1" in problem


def test_a_folder_that_cant_be_written_ends_in_a_sentence(tmp_path):
    (tmp_path / "file").touch()
    kept, problem = p.load(tmp_path / "file" / "preferences.json")
    assert problem and kept.path is None  # it is a path through a file
    assert kept.save() == ""
    kept.path = tmp_path / "file" / "preferences.json"
    assert "can't keep the preferences" in kept.save()


def test_the_folder_is_the_users(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    if os.name == "posix":
        assert tmp_path in p.file().parents


@pytest.mark.gl
@pytest.mark.parametrize("size", [None, "400x300"])
def test_a_viewer_begins_as_the_last_one_ended_unless_the_command_line_says_otherwise(
    window, ball, path, size
):
    from types import SimpleNamespace

    from deformrf.commands import view as command
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    kept = p.load(path)[0]
    kept.panel_side, kept.background = "right", (0.1, 0.2, 0.3)
    app = App(*window, EventLog(False), gui=False, kept=kept)
    app.load(ball, "ball", "cpu")
    settings = app.scene.settings
    assert settings.panel_side == "right" and settings.background == (0.1, 0.2, 0.3)
    settings.grab_radius, settings.panel_width = 0.2, 1e9  # this one can't be
    command._remember(app, SimpleNamespace(size=size))
    app.close()
    again, problem = p.load(path)
    assert problem == "" and again.grab_radius == 0.2
    assert again.panel_width == p.Preferences().panel_width and again.target_fps is None
    assert again.window_size == ((320, 240) if size is None else p.Preferences().window_size)
