"""Dialogs and lists keep keyboard and mouse to themselves."""

from dataclasses import replace
from functools import partial

import pytest
from asking_app import click, frames, opened, places_of_buttons, press, quit_by, send

from deformrf.viewer.actions import ACTIONS, INPUTS
from deformrf.viewer.camera import picking
from deformrf.viewer.files import FileDialog, Problem

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    with opened(window, ball, monkeypatch, tmp_path) as made:
        yield made


@pytest.fixture
def places(monkeypatch):
    return places_of_buttons(monkeypatch)


def test_a_message_and_the_help_stay_in_front_of_the_panels(app):
    """They overlap in a small window, and a click gives a panel the keys."""
    from imgui_bundle import imgui

    settings = app.scene.settings
    settings.show_help = settings.show_timeline = True
    app.recorder.say("here it is")
    frames(app, 3)
    timeline = imgui.internal.find_window_by_name("timeline")
    click(app, (round(timeline.pos.x + 8.0), round(timeline.pos.y + timeline.size.y - 4.0)))
    frames(app)
    assert imgui.get_current_context().nav_window.name == "timeline"
    found = map(imgui.internal.find_window_by_name, ("message", "help", "task", "timeline"))
    message, help_, *panels = map(imgui.internal.find_window_display_index, found)
    assert min(message, help_) > max(panels)


def ask(app, what, tmp_path):
    if what == "leaving":
        app.scene.set_ground(True)
        quit_by(app, "close")
    elif what == "recovery":
        app.questions.left_behind = tmp_path / "left.jsonl"
    elif what == "problem":
        app.questions.dialog = Problem("Something", "is wrong")
    elif what == "file":
        app.questions.dialog = FileDialog("Open", tmp_path, (".npz",), None)
    elif what == "film":
        app.takes.ask()


WHAT = pytest.mark.parametrize("what", ["leaving", "recovery", "problem", "file", "film", "list"])


@pytest.fixture
def asked(app, what, tmp_path, monkeypatch):
    """The App with a dialog or a list that is open, before any frame or after some."""
    if what == "list":
        from imgui_bundle import imgui

        places, draw = {}, imgui.combo

        def noted(label, *arguments):
            result = draw(label, *arguments)
            low = imgui.get_item_rect_min()
            places[label] = round(low.x + 8), round(low.y + 8)
            return result

        monkeypatch.setattr(imgui, "combo", noted)
        app.scene.settings.task = "view"
        frames(app)
        click(app, places["##show"])
        assert app.gui.has_keyboard
    else:
        ask(app, what, tmp_path)
    return app


@WHAT
@pytest.mark.parametrize("drawn", [False, True])
def test_no_shortcut_reaches_the_scene_behind(asked, what, drawn, monkeypatch):
    from pyglet.window import key

    called = []
    for name in ACTIONS:
        if name not in ("quit", "cancel"):
            noted = replace(ACTIONS[name], function=partial(called.append, name))
            monkeypatch.setitem(ACTIONS, name, noted)
    if drawn:
        frames(asked)
    for entry in INPUTS:
        if entry.key and entry.action not in ("quit", "cancel", "play"):  # Enter is the dialog's
            *held, name = entry.key.split("+")
            modifiers = key.MOD_CTRL * ("CTRL" in held) | key.MOD_SHIFT * ("SHIFT" in held)
            for event in ("on_key_press", "on_key_release"):
                send(asked, event, getattr(key, name), modifiers)
            send(asked, "on_text", "r")
    assert called == []
    frames(asked)
    assert asked.gui.has_keyboard and not asked.gui._failed
    send(asked, "on_key_press", key.ESCAPE, 0)
    frames(asked, 3)
    assert not asked.gui.has_keyboard
    send(asked, "on_key_press", key.R, 0)
    assert called == ["reset"]


@WHAT
def test_no_click_reaches_the_scene_or_the_panels_behind(asked, what, places):
    from pyglet.window import mouse

    scene = asked.scene
    frames(asked)
    orbit, tick = scene.orbit, len(scene.journal.steps)
    at = asked.window.width - 20, 20  # beside all windows
    for button in (mouse.LEFT, mouse.RIGHT):
        send(asked, "on_mouse_press", *at, button, 0)
        send(asked, "on_mouse_drag", at[0] - 50, at[1] + 50, -50, 50, button, 0)
        send(asked, "on_mouse_release", at[0] - 50, at[1] + 50, button, 0)
        if what == "list":  # which the click closes
            assert scene.orbit is orbit and not asked.controls.mode
            return
    send(asked, "on_mouse_scroll", *at, 0, 3)
    click(asked, places["Pause"])
    assert scene.orbit is orbit and not asked.controls.mode and len(scene.journal.steps) == tick
    assert not scene.clock.paused and asked.gui.has_keyboard


def test_what_was_held_is_let_go_though_a_dialog_came(app):
    from pyglet.window import key, mouse

    app.scene.settings.show_panel = False
    frames(app)
    ids = app.scene.handles.control_ids
    vertex = int(ids[app.controls.shown(ids)][0])
    (at,), _ = picking.project(app.controls.camera, app.scene.handles.at([vertex]))
    x, y = round(at[0]), round(app.window.height - 1 - at[1])
    send(app, "on_mouse_press", x, y, mouse.LEFT, 0)
    send(app, "on_mouse_drag", x + 9, y, 9, 0, mouse.LEFT, 0)
    assert app.scene.handles.grabbed is not None
    send(app, "on_key_press", key.O, key.MOD_CTRL)
    frames(app)
    assert app.questions.dialog is not None
    send(app, "on_mouse_release", x + 9, y, mouse.LEFT, 0)
    assert app.scene.handles.grabbed is None and not app.controls.mode


def test_a_dialog_ends_the_flight(app):
    """Which would have the keys, and the mouse."""
    from pyglet.window import key

    send(app, "on_key_press", key.G, 0)
    send(app, "on_key_press", key.W, 0)
    assert app.fly.on
    app.scene.set_ground(True)
    send(app, "on_close")
    frames(app)
    assert app.questions.leaving is not None and not app.fly.on
    orbit = app.scene.orbit
    frames(app, 3)
    assert app.scene.orbit is orbit


def test_a_path_is_typed_again_after_an_error(app, ball_file):
    """The field has the keys all the time; what was typed is selected, to be replaced."""
    from pyglet.window import key

    folder = ball_file.parent
    app.questions.dialog = FileDialog(
        "Open", folder, (".npz",), lambda path: setattr(app.opening, "asked", path)
    )
    frames(app, 3)
    for name in ("absent rp.npz", "~nobody-of-that-name/x", str(folder / "absent")):
        send(app, "on_text", name)
        frames(app)
        press(app, key.RETURN)
        assert app.questions.dialog is not None and app.questions.dialog.problem
        frames(app)
        assert app.gui._io.want_text_input
    assert not app.scene.journal.steps and not app.scene.clock.paused
    before = app.scene
    send(app, "on_text", ball_file.name)
    frames(app)
    press(app, key.RETURN)
    frames(app)
    assert app.questions.dialog is None and app.scene is not before and app.scene.name == "ball"


def test_keys_are_shortcuts_again_as_soon_as_the_dialog_is_gone(app, tmp_path):
    from pyglet.window import key

    app.questions.dialog = FileDialog("Open", tmp_path, (".npz",), None)
    frames(app, 3)
    send(app, "on_key_press", key.ESCAPE, 0)
    send(app, "on_key_press", key.SPACE, 0)  # before any frame
    assert app.questions.dialog is None and app.scene.clock.paused


def test_keys_are_shortcuts_one_frame_after_enter_twice_ended_the_dialog(app, tmp_path):
    """Frames are slow: ImGui has given the field the keys again, and has not seen that it went."""
    from pyglet.window import key

    (tmp_path / "a.deformrf").touch()
    app.questions.dialog = FileDialog(
        "Save as", tmp_path, (".deformrf",), lambda path: "", "a.deformrf"
    )
    frames(app, 3)
    for count in (3, 1):
        assert app.questions.name == "dialog"
        send(app, "on_key_press", key.RETURN, 0)
        send(app, "on_key_release", key.RETURN, 0)
        frames(app, count)
    assert app.questions.dialog is None
    for paused in (True, False, True):
        frames(app, 1)
        send(app, "on_key_press", key.SPACE, 0)
        assert app.scene.clock.paused == paused


def test_enter_twice_replaces_a_file_though_frames_are_slow(app, tmp_path):
    """ImGui's field doesn't take the second Enter while it gets the keys again."""
    from pyglet.window import key

    (tmp_path / "a.deformrf").touch()
    saved = []
    app.questions.dialog = FileDialog(
        "Save as", tmp_path, (".deformrf",), lambda path: saved.append(path) or "", "a.deformrf"
    )
    frames(app, 3)
    for name in ("on_key_press", "on_key_release", "on_key_press"):
        assert not saved
        send(app, name, key.RETURN, 0)
        frames(app, 1)
    assert saved == [tmp_path / "a.deformrf"]


def test_keys_that_were_for_a_dialog_are_not_for_the_next_one(app, tmp_path):
    """In slow frames ImGui still has them when Esc has taken the dialog away."""
    from pyglet.window import key

    saved = []

    def ask():
        app.questions.dialog = FileDialog(
            "Save as", tmp_path, (".deformrf",), lambda path: saved.append(path) or "", "a.deformrf"
        )

    ask()
    frames(app, 3)
    for symbol in [*[key.A] * 20, key.RETURN]:
        send(app, "on_key_press", symbol, 0)
        send(app, "on_key_release", symbol, 0)
    send(app, "on_key_press", key.ESCAPE, 0)
    frames(app, 1)
    ask()
    frames(app, 60)
    assert not saved and app.questions.name == "dialog"
    press(app, key.RETURN)
    assert saved == [tmp_path / "a.deformrf"]


def test_a_film_whose_name_is_taken_says_so_in_its_dialog(app, tmp_path):
    from pyglet.window import key

    app.takes.ask()
    app.takes.choices.name = "film"
    app.takes.choices.path.touch()
    frames(app)
    press(app, key.RETURN)
    assert app.takes.asking and "is there already" in app.takes.problem
    frames(app)
    assert app.gui._io.want_text_input  # another name


def test_a_film_without_a_name_says_so_beside_what_was_wrong_before(app, monkeypatch):
    from imgui_bundle import imgui
    from pyglet.window import key

    told, write = [], imgui.text_wrapped
    monkeypatch.setattr(imgui, "text_wrapped", lambda line: (told.append(line), write(line)))
    app.takes.ask()
    app.takes.problem = "the disk is full"
    frames(app, 3)
    assert "the disk is full" in told and any(".mp4" in line for line in told)
    press(app, key.BACKSPACE)  # the name is selected
    assert told[-2:] == ["the disk is full", "a film needs a name"]
    press(app, key.RETURN)
    assert app.takes.asking and app.takes.job is None
