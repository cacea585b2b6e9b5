"""Number fields: what a user can type into them."""

import ast
import math
from pathlib import Path

import pytest

from deformrf.viewer import panels

SOURCES = sorted(Path(panels.__file__).parents[1].rglob("*.py"))
NUMBERS = ("slider_", "drag_", "v_slider_", "input_float", "input_int", "input_double")
NUMBERS += ("input_scalar", "color_")


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.stem)
def test_all_number_fields_are_those_of_widgets(path):
    """Which takes no number that isn't one."""
    called = {
        node.attr
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "imgui"
    }
    fields = {name for name in called if name.startswith(NUMBERS)}
    assert path.stem == "widgets" or not fields


@pytest.fixture
def typed(window, monkeypatch):
    """A function that types into a slider over a value; what the value is then."""
    from imgui_bundle import imgui
    from pyglet.window import key, mouse

    from deformrf.viewer.gui import Gui
    from deformrf.viewer.panels.widgets import slider

    shown, context = window
    gui = Gui(shown)
    shown.push_handlers(gui)

    def type_into(value, bounds, text, flags=0):
        state = [value]

        def frame():
            context.screen.use()
            gui.begin()
            imgui.set_next_window_pos((10, 10))
            imgui.set_next_window_size((400, 100))
            imgui.begin("panel")
            slider("value", state[0], state.append, bounds, "%.3g", flags)
            low = imgui.get_item_rect_min()
            at = round(low.x + 20), round(shown.height - 1 - low.y - 5)
            imgui.end()
            gui.end()
            del state[:-1]
            return at

        def send(*event):
            shown.dispatch_event(*event)
            shown.dispatch_events()
            return frame()

        at = [frame() for _ in range(3)][-1]
        send("on_mouse_motion", *at, 0, 0)
        for name in ("on_mouse_press", "on_mouse_release"):
            send(name, *at, mouse.LEFT, key.MOD_CTRL)
        send("on_key_release", key.LCTRL, 0)
        assert gui._io.want_text_input
        send("on_text", text)
        for name in ("on_key_press", "on_key_release"):
            send(name, key.RETURN, 0)
        frame()
        assert not gui._io.want_text_input
        return state[0]

    yield type_into
    gui.close()


LOGARITHMIC = 32  # ImGui's flag


@pytest.mark.gl
@pytest.mark.parametrize("text", ["nan", "-nan", "inf", "-inf", "1e999", "-1e999", "infinity"])
@pytest.mark.parametrize("value, flags", [(0.5, 0), (500.0, LOGARITHMIC), (7, 0)])
def test_what_is_no_number_is_refused_at_the_field(typed, value, flags, text):
    assert typed(value, (0, 1000), text, flags) == value


@pytest.mark.gl
@pytest.mark.parametrize(
    "value, text, expected",
    [
        *((0.5, "2.5", 2.5), (0.5, "1e300", 0.5), (0.5, "2e5", 1000.0), (0.5, "-3", 0.0)),
        *((7, "12", 12), (7, "1e2", 100), (7, "2.6", 3), (7, "99999999999", 1000)),
    ],
)
def test_other_numbers_are_taken_or_their_bound(typed, value, text, expected):
    new = typed(value, (0, 1000), text)
    assert new == expected and type(new) is type(value)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_color_has_numbers(monkeypatch, bad):
    from imgui_bundle import imgui

    from deformrf.viewer.panels import widgets

    color, taken = widgets.color, []
    monkeypatch.setattr(widgets, "named", str)  # which draws
    monkeypatch.setattr(imgui, "color_edit3", lambda *_: (True, [0.1, bad, 0.2]))
    color("background", (1.0, 1.0, 1.0), taken.append)
    monkeypatch.setattr(imgui, "color_edit3", lambda *_: (True, [0.1, 3.0, -0.2]))
    color("background", (1.0, 1.0, 1.0), taken.append)
    assert taken == [(0.1, 1.0, 0.0)]


@pytest.mark.parametrize(
    "value, values, words, shown",
    [
        ("b", ("a", "b"), ["a", "b"], "b"),
        (24, (15, 24), ["15", "24"], "24"),
        (1.0, {"half": 0.5, "all": 1.0}, ["half", "all"], "all"),
        (0.3, {"half": 0.5, "all": 1.0}, ["half", "all", "custom"], "custom"),
    ],
)
def test_a_list_shows_words_and_gives_values(monkeypatch, value, values, words, shown):
    from imgui_bundle import imgui

    from deformrf.viewer.panels import widgets

    seen, taken = [], []

    def choose_first(label, current, names):
        seen.append((names, names[current]))
        return True, 0

    monkeypatch.setattr(widgets, "named", str)
    monkeypatch.setattr(imgui, "combo", choose_first)
    widgets.combo("list", value, taken.append, values)
    assert seen == [(words, shown)]
    assert taken == [values["half"] if isinstance(values, dict) else values[0]]


@pytest.mark.gl
def test_a_long_name_leaves_room_for_its_slider(window):
    """A name may be anything that a user types; what it labels stays in the panel."""
    from imgui_bundle import imgui

    from deformrf.viewer.gui import Gui
    from deformrf.viewer.panels.widgets import fitting, slider

    gui, seen = Gui(window[0]), []
    window[1].screen.use()
    gui.begin()
    imgui.set_next_window_size((300, 100))
    imgui.begin("panel")
    inner = imgui.get_content_region_avail().x
    for name in ("short", "long " * 2000, "жñ日" * 40):
        slider(name, 1.0, print, (0.0, 2.0), "%.2f")
        cut = fitting(name, 0.5 * inner)
        seen.append((name, cut, imgui.get_item_rect_size().x, imgui.calc_text_size(cut).x))
    least = fitting("short", 1.0)
    imgui.end()
    gui.end()
    gui.close()
    assert [cut == name for name, cut, *_ in seen] == [True, False, False]
    assert all(name.startswith(cut.removesuffix("...")) for name, cut, *_ in seen)
    assert all(bar > 0.3 * inner and text <= 0.5 * inner for *_, bar, text in seen)
    assert least == "..."
