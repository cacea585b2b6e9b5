"""The timeline in a window: mouse, keys and the panel, without a display."""

from dataclasses import replace

import numpy as np
import pytest

pytestmark = pytest.mark.gl


@pytest.fixture
def app(window, ball, monkeypatch, tmp_path):
    """An App with the strip shown, in a window without a display."""
    from deformrf.viewer.app import App

    class Log(list):
        enabled = False

        def __call__(self, event, **fields):
            self.append((event, fields))

    monkeypatch.chdir(tmp_path)
    made = App(*window, Log())
    made.load(ball, "ball", "cpu")
    made.scene.settings.fixed_resolution = 0.25
    made.scene.settings.show_panel, made.scene.settings.show_timeline = False, True
    made.scene.journal.clear()
    frames(made, 3)
    yield made
    made.close()


def frames(app, count):
    app.run(app.frame_count + count)


def send(app, name, *arguments):
    app.window.dispatch_event(name, *arguments)
    app.window.dispatch_events()


def press(app, name, modifiers=0):
    from pyglet.window import key

    send(app, "on_key_press", getattr(key, name), modifiers)
    frames(app, 1)


def place(app, tick, row):
    """Where a tick is on a track, or on the ruler: row -1; in pyglet's coordinates."""
    from deformrf.viewer.panels import timeline as panel

    from_bottom = 8.0 + 36.0 + panel.LANE * (1.5 - row)
    return round(app.strip.scale.place(tick)), round(from_bottom)


def drag(app, start, end, modifiers=0):
    from pyglet.window import mouse

    (x, y), (to_x, to_y) = start, end
    send(app, "on_mouse_motion", x, y, 0, 0)
    frames(app, 1)
    send(app, "on_mouse_press", x, y, mouse.LEFT, modifiers)
    frames(app, 1)
    for _ in range(2):
        send(app, "on_mouse_drag", to_x, to_y, to_x - x, to_y - y, mouse.LEFT, modifiers)
        frames(app, 1)
    send(app, "on_mouse_release", to_x, to_y, mouse.LEFT, modifiers)
    frames(app, 2)


def test_keys_are_set_dragged_scrubbed_and_played(app):
    """A small film, made by keyboard and mouse alone."""
    from pyglet.window import key

    line = app.scene.timeline
    press(app, "K")
    assert [len(keys) for keys in line.keys.values()] == [1, 1]
    yaw = app.scene.orbit.yaw
    drag(app, place(app, 30, -1), place(app, 120, -1))  # the playhead
    assert abs(line.head - 120) <= 2
    app.scene.orbit = replace(app.scene.orbit, yaw=yaw + 1.0)
    press(app, "K", key.MOD_CTRL)
    assert len(line.keys["camera"]) == 2
    drag(app, place(app, line.head, 0), place(app, 6, 0))  # its diamond
    assert 3 <= line.end <= 9 and app.strip.selected == ("camera", line.end)
    press(app, "ENTER")
    assert line.playing and line.head <= 6  # from the beginning
    for _ in range(12):
        app.frame(1 / 60)
    assert not line.playing and line.head == line.end
    assert app.scene.orbit.yaw == pytest.approx(yaw + 1.0)
    for _ in range(20):
        press(app, "Z", key.MOD_CTRL)
    assert line.end == 0 and line.keys == {"camera": (), "pose": ()}


def test_the_mouse_on_the_strip_is_not_the_views(app):
    orbit = app.scene.orbit
    drag(app, place(app, 30, -1), place(app, 200, 1))
    np.testing.assert_array_equal(app.scene.orbit.target, orbit.target)
    assert app.scene.orbit.yaw == orbit.yaw and not app.controls.mode


def test_all_of_the_panel_is_drawn_without_a_fault(app, caplog):
    from imgui_bundle import imgui
    from pyglet.window import key

    from deformrf.viewer.panels.timeline import animate_panel
    from deformrf.viewer.parts import call

    settings, line = app.scene.settings, app.scene.timeline
    settings.show_panel = True
    press(app, "O", key.MOD_SHIFT)
    press(app, "K", key.MOD_SHIFT)
    line.set_motion("physics")
    line.save_pose("a")
    frames(app, 2)
    app.gui.begin()
    imgui.begin("poses")
    call(animate_panel, app)
    imgui.end()
    app.gui.end()
    assert not app.gui._failed and "failed" not in caplog.text
    press(app, "T", key.MOD_SHIFT)
    assert not settings.show_timeline


def test_the_chosen_keys_easing_is_one_of_the_list(app, monkeypatch):
    from imgui_bundle import imgui

    from deformrf.viewer.document import EASINGS

    def last(label, current, names):
        shown.setdefault(label, (names[current], names))
        return label == "##easing", len(names) - 1

    shown = {}
    press(app, "K")
    monkeypatch.setattr(imgui, "combo", last)
    frames(app, 1)
    (camera,) = app.scene.timeline.keys["camera"]
    assert shown["##easing"] == ("smooth", [*EASINGS])
    assert camera.easing == [*EASINGS][-1] != "smooth"


def test_the_timeline_lies_in_the_window_from_its_first_frame_on(app, monkeypatch):
    """A button opens it while the panels are drawn: those before it know nothing of it."""
    from imgui_bundle import imgui

    settings, button = app.scene.settings, imgui.button
    settings.show_panel = True
    settings.show_timeline, settings.task = False, "animate"
    frames(app, 2)

    def opening(label, *arguments):
        settings.show_timeline = True
        return button(label, *arguments)

    monkeypatch.setattr(imgui, "button", opening)
    for _ in range(3):
        frames(app, 1)
        strip = imgui.internal.find_window_by_name("timeline")
        assert strip.pos.y + strip.size.y <= imgui.get_io().display_size.y
    assert strip.was_active


@pytest.mark.parametrize("side", ["left", "right"])
def test_in_a_low_window_the_timeline_lies_beside_the_tasks_panel(app, side):
    """It would leave the panel no height; letters of twice the size make a window as low."""
    from imgui_bundle import imgui

    settings = app.scene.settings
    settings.show_panel, settings.panel_side = True, side
    seen = []
    for scale in (0.5, 0.8, 1.0):  # 640, 400 and 320 points wide
        settings.panel_scale = scale
        frames(app, 4)
        task, strip = map(imgui.internal.find_window_by_name, ("task", "timeline"))
        below = strip.pos.y >= task.pos.y + task.size.y
        first, second = sorted((task, strip), key=lambda one: one.pos.x)
        beside = second.pos.x >= first.pos.x + first.size.x - 1.0  # whole pixels
        assert below or beside
        if below:
            assert task.size.y >= 160.0
        seen.append(below)
    assert seen == [True, False, False]
