"""The menus: made from the table of inputs, and usable with the mouse."""

from dataclasses import replace

import pytest

from deformrf.viewer.actions import ACTIONS, INPUTS, SECTIONS, Input, inputs_of
from deformrf.viewer.panels import menu as m
from deformrf.viewer.settings import KEYS


def test_menus_are_the_tables():
    first, second, third = (
        Input("Ctrl+A", "do it", "CTRL+A", "a", "Edit/A"),
        Input("", "what only a menu has", action="b", menu="File/Export/B"),
        Input("click", "no menu"),
    )
    tree = m.menu_tree([first, second, third])
    assert tree == {"Edit": {"A": first}, "File": {"Export": {"B": second}}}


def test_a_dash_draws_a_line_above_an_item_or_a_menu():
    one, other = (Input("", "", action=name, menu=f"Edit/{name}") for name in ("A", "-B"))
    third = Input("", "", action="c", menu="Edit/-More/C")
    tree = m.menu_tree([one, other, third, third])
    assert list(tree["Edit"]) == ["A", "-1", "B", "-3", "More"]
    assert tree["Edit"]["-1"] is None and tree["Edit"]["B"] is other


def test_file_is_the_first_menu_and_help_the_last():
    titles = list(m.menu_tree(INPUTS))
    assert titles[0] == "File" and titles[-1] == "Help" and "Edit" in titles


def test_no_two_items_have_the_same_place():
    places = [entry.menu for entry in INPUTS if entry.menu]
    assert len(places) == len(set(places))
    for place in places:  # and none is a menu of others
        assert not any(other.startswith(f"{place}/") for other in places)


# -- in the viewer -----------------------------------------------------------------------------


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App with panels in a window without a display, its menus' items in `drawn`."""
    from imgui_bundle import imgui

    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    monkeypatch.chdir(tmp_path)
    made = App(*window, EventLog(False))
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    made.drawn = {}

    def noted(draw):
        def draw_and_note(title, *arguments):
            result = draw(title, *arguments)
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            y = made.window.height - 1 - round(0.5 * (low.y + high.y))
            made.drawn[title] = round(0.5 * (low.x + high.x)), y
            return result

        return draw_and_note

    for name in ("begin_menu", "menu_item_simple"):
        monkeypatch.setattr(imgui, name, noted(getattr(imgui, name)))
    frames(made, 3)
    yield made
    made.close()


def frames(app, count):
    app.run(app.frame_count + count)


def send(app, name, *arguments):
    app.window.dispatch_event(name, *arguments)
    app.window.dispatch_events()


def click(app, title):
    from pyglet.window import mouse

    at = app.drawn[title]
    send(app, "on_mouse_motion", *at, 0, 0)
    frames(app, 2)
    for name in ("on_mouse_press", "on_mouse_release"):
        send(app, name, *at, mouse.LEFT, 0)
        frames(app, 3)


@pytest.mark.gl
def test_an_item_of_a_menu_does_what_its_key_does(app):
    app.scene.set_ground(True)
    click(app, "Edit")
    orbit = app.scene.orbit
    click(app, "Undo")
    assert not app.scene.on_ground and app.scene.orbit is orbit
    click(app, "View")
    click(app, "Orthographic")
    assert app.scene.orbit.parallel


@pytest.mark.gl
def test_an_item_that_fails_says_so_in_the_menu_bar_and_menus_go_on(app, monkeypatch):
    def fail():
        raise KeyError("no such thing")

    monkeypatch.setitem(ACTIONS, "redo", replace(ACTIONS["redo"], function=fail))
    for title in ("Edit", "Redo"):
        click(app, title)
    assert app.gui._failed == {"menus failed: 'no such thing'"}
    click(app, "View")
    click(app, "Orthographic")
    assert app.scene.orbit.parallel


@pytest.mark.gl
def test_escape_closes_an_open_menu_and_then_the_help(app):
    from imgui_bundle import imgui
    from pyglet.window import key

    def is_open():
        return imgui.is_popup_open("", imgui.PopupFlags_.any_popup.value)

    app.scene.settings.show_help = True
    click(app, "Edit")
    assert is_open()
    send(app, "on_key_press", key.ESCAPE, 0)
    frames(app, 2)
    assert not is_open() and app.scene.settings.show_help
    send(app, "on_key_press", key.ESCAPE, 0)
    assert not app.scene.settings.show_help


@pytest.mark.gl
@pytest.mark.parametrize("keys", KEYS)
def test_the_help_names_every_key_and_fits_the_window(app, monkeypatch, keys):
    from imgui_bundle import imgui

    drawn = []
    monkeypatch.setattr(imgui, "text_wrapped", drawn.append)
    app.scene.settings.show_help, app.scene.settings.keys = True, keys
    frames(app, 3)
    assert {entry.label for entry in inputs_of(keys) if entry.label} <= set(drawn)
    window = imgui.internal.find_window_by_name("help")
    assert window.pos.x >= 0.0 and window.pos.y >= 0.0
    assert window.pos.x + window.size.x <= app.window.width
    assert window.pos.y + window.size.y <= app.window.height
    drawn.clear()
    app.gui.help_filter = "wireframe"
    frames(app, 1)
    assert {"W", "wireframe"} <= set(drawn) and "Ctrl+Z" not in drawn


@pytest.mark.gl
@pytest.mark.parametrize("task, first", [("bend", "Bend"), ("film", "Film")])
def test_the_help_begins_with_the_task_and_has_a_section_for_each(app, monkeypatch, task, first):
    from deformrf.viewer.panels import help as panel

    heads = []
    monkeypatch.setattr(panel, "section", lambda name: heads.append(name) or True)
    app.scene.settings.show_help, app.scene.settings.task = True, task
    frames(app, 1)
    assert heads[0] == first and set(heads) == set(SECTIONS)
    heads.clear()
    app.gui.help_filter = "no such thing"
    frames(app, 1)
    assert heads == []


@pytest.mark.gl
def test_an_item_that_is_on_says_what_a_click_does_now(app):
    click(app, "Edit")
    assert "Pause" in app.drawn and "Go on" not in app.drawn
    app.scene.clock.paused = True
    frames(app, 2)
    assert "Go on" in app.drawn
