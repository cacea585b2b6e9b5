"""ImGui in a pyglet window: what reaches the view and what stays with the panel."""

import pytest

pytestmark = pytest.mark.gl


class Panel:
    """One panel at the left with a slider, a button and a text field, and a view behind it."""

    def __init__(self, window, context):
        from deformrf.viewer.gui import Gui

        self.window, self.context = window, context
        self.seen, self.clicks, self.value, self.text = [], 0, 0.5, ""
        window.push_handlers(
            on_mouse_press=lambda x, y, b, m: self.seen.append("press"),
            on_mouse_drag=lambda x, y, dx, dy, b, m: self.seen.append("drag"),
            on_mouse_release=lambda x, y, b, m: self.seen.append("release"),
            on_mouse_motion=lambda x, y, dx, dy: self.seen.append("motion"),
            on_mouse_scroll=lambda x, y, sx, sy: self.seen.append("scroll"),
            on_key_press=lambda s, m: self.seen.append("key") or True,
        )
        self.gui = Gui(window)
        window.push_handlers(self.gui)
        for _ in range(3):
            self.frame()

    def frame(self, *extra):
        from imgui_bundle import imgui

        self.window.switch_to()
        self.context.screen.use()
        self.context.clear()
        self.gui.begin()
        imgui.set_next_window_pos((10, 10))
        imgui.set_next_window_size((180, 200))
        imgui.begin("panel")
        _, self.value = imgui.slider_float("value", self.value, 0.0, 1.0)
        self.slider = self.middle()
        self.clicks += imgui.button("go")
        self.button = self.middle()
        _, self.text = imgui.input_text("text", self.text)
        self.field = self.middle()
        for panel in extra:
            self.gui.guarded(panel)
        self.gui.claim()
        imgui.end()
        self.gui.end()
        self.window.flip()

    def middle(self):
        """The middle of the last item, in pyglet's coordinates."""
        from imgui_bundle import imgui

        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        y = self.window.height - 1 - 0.5 * (low.y + high.y)
        return round(low.x + 0.25 * (high.x - low.x)), round(y)

    def send(self, name, *arguments):
        self.window.dispatch_event(name, *arguments)  # outside of pyglet's loop it is queued
        self.window.dispatch_events()

    def click(self, at, frames_between=True, modifiers=0):
        from pyglet.window import mouse

        self.send("on_mouse_motion", *at, 0, 0)
        if frames_between:
            self.frame()
        self.send("on_mouse_press", *at, mouse.LEFT, modifiers)
        self.frame()
        self.send("on_mouse_release", *at, mouse.LEFT, modifiers)
        self.frame()
        self.frame()


OUTSIDE = 280, 30


@pytest.fixture
def panel(window):
    made = Panel(*window)
    yield made
    made.gui.close()


def test_a_click_on_a_button_is_not_the_views(panel):
    panel.click(panel.button)
    assert panel.clicks == 1
    assert panel.seen == []


def test_a_click_on_a_button_is_not_the_views_even_after_a_jump(panel):
    panel.click(OUTSIDE)
    panel.seen.clear()
    panel.click(panel.button, frames_between=False)
    assert panel.seen == []


def test_a_click_beside_the_panel_is_the_views_even_after_a_jump(panel):
    panel.click(panel.button)
    panel.click(OUTSIDE, frames_between=False)
    assert panel.seen == ["motion", "press", "release"]


def test_a_slider_keeps_the_drag_that_leaves_the_panel(panel):
    from pyglet.window import mouse

    x, y = panel.slider
    panel.send("on_mouse_motion", x, y, 0, 0)
    panel.frame()
    panel.send("on_mouse_press", x, y, mouse.LEFT, 0)
    panel.frame()
    for k in range(1, 20):
        panel.send("on_mouse_drag", x + 10 * k, y, 10, 0, mouse.LEFT, 0)
        panel.frame()
    panel.send("on_mouse_release", x + 190, y, mouse.LEFT, 0)
    panel.frame()
    assert panel.value == 1.0
    assert panel.seen == []


def test_a_drag_of_the_view_that_ends_over_the_panel_ends(panel):
    from pyglet.window import mouse

    panel.send("on_mouse_press", *OUTSIDE, mouse.LEFT, 0)
    panel.frame()
    panel.send("on_mouse_drag", *panel.button, -100, 50, mouse.LEFT, 0)
    panel.frame()
    panel.send("on_mouse_release", *panel.button, mouse.LEFT, 0)
    panel.frame()
    assert panel.seen == ["press", "drag", "release"]
    assert panel.clicks == 0


def test_the_wheel_belongs_to_what_is_under_the_mouse(panel):
    panel.send("on_mouse_scroll", *panel.button, 0, 1)
    assert panel.seen == []
    panel.send("on_mouse_scroll", *OUTSIDE, 0, 1)
    assert panel.seen == ["scroll"]


def test_keys_are_shortcuts_except_while_text_is_typed(panel):
    from pyglet.window import key

    panel.click(panel.button)
    panel.send("on_key_press", key.SPACE, 0)
    assert panel.seen == ["key"]
    panel.seen.clear()
    panel.click(panel.field)
    panel.send("on_key_press", key.A, 0)
    panel.send("on_text", "a")
    panel.frame()
    assert panel.text == "a"
    assert panel.seen == []


@pytest.mark.parametrize("frames", range(4))
def test_keys_that_come_with_the_click_on_a_field_are_not_shortcuts(panel, frames):
    """Of one who types quickly, or while frames are slow: all events of a frame are handled."""
    from pyglet.window import key, mouse

    panel.send("on_mouse_motion", *panel.field, 0, 0)
    panel.send("on_mouse_press", *panel.field, mouse.LEFT, 0)
    panel.send("on_mouse_release", *panel.field, mouse.LEFT, 0)
    for letter in "ab":
        for _ in range(frames):
            panel.frame()
        panel.send("on_key_press", ord(letter), 0)
        panel.send("on_text", letter)
        panel.send("on_key_release", ord(letter), 0)
    for _ in range(12):
        panel.frame()
    assert panel.seen == [] and panel.text == "ab"
    panel.click(panel.button)
    panel.send("on_key_press", key.SPACE, 0)
    assert panel.seen == ["key"]


@pytest.mark.parametrize("held", ["before", "after"])
def test_ctrl_is_held_from_its_press_to_its_release(panel, held):
    """X11 reports the modifiers as they were before the event, those of Ctrl itself too."""
    from pyglet.window import key

    states = {"before": (0, key.MOD_CTRL), "after": (key.MOD_CTRL, 0)}[held]
    panel.send("on_key_press", key.LCTRL, states[0])
    panel.frame()
    assert panel.gui._io.key_ctrl
    panel.send("on_key_release", key.LCTRL, states[1])
    panel.frame()
    assert not panel.gui._io.key_ctrl


def test_a_press_beside_the_panel_ends_the_entry_of_text(panel):
    from pyglet.window import key, mouse

    panel.send("on_key_press", key.LCTRL, key.MOD_CTRL)
    panel.click(panel.slider, modifiers=key.MOD_CTRL)  # it opens for typing
    panel.send("on_key_release", key.LCTRL, 0)
    panel.seen.clear()
    panel.send("on_key_press", key.A, 0)
    panel.frame()
    assert panel.seen == []
    panel.send("on_mouse_press", *OUTSIDE, mouse.LEFT, 0)
    panel.frame()
    panel.frame()
    panel.send("on_key_press", key.SPACE, 0)
    assert panel.seen == ["press", "key"]


@pytest.mark.parametrize("in_child", [False, True])
def test_a_panel_that_fails_says_so_and_is_tried_again(panel, caplog, monkeypatch, in_child):
    from imgui_bundle import imgui, imgui_ctx

    said, broken = [], [True]
    monkeypatch.setattr(imgui, "text_wrapped", said.append)

    def faulty_panel():
        if broken and in_child:
            with imgui_ctx.begin_child("ended by the error"):
                imgui.begin_disabled()
                imgui.push_id("never popped")
                raise KeyError("no such thing")
        if broken:
            imgui.begin_table("never ended", 2)
            imgui.push_id("never popped")
            raise KeyError("no such thing")
        said.append("drawn")

    for _ in range(3):
        panel.frame(faulty_panel)
    assert said == ["faulty_panel failed: 'no such thing'"] * 3
    assert caplog.text.count("Traceback") == 1  # the log has it once
    panel.click(panel.button)
    assert panel.clicks == 1
    broken.clear()
    panel.frame(faulty_panel)
    assert said[-1] == "drawn"


def test_tab_types_into_no_field(panel):
    """ImGui would go to the first field with it, and take every key from then on."""
    from pyglet.window import key

    panel.click(panel.button)
    panel.send("on_key_press", key.TAB, 0)
    panel.frame()
    panel.send("on_key_release", key.TAB, 0)
    panel.frame()
    panel.frame()
    panel.seen.clear()
    panel.send("on_key_press", key.SPACE, 0)
    assert panel.seen == ["key"]


@pytest.mark.parametrize("missed", ["nothing", "press", "release"])
def test_only_ctrl_and_click_types_into_a_slider(panel, missed):
    """Whatever happened to Ctrl while another window had the keys."""
    from pyglet.window import key

    def typing():
        return panel.gui._io.want_text_input

    if missed != "press":
        panel.send("on_key_press", key.LCTRL, 0)
    panel.click(panel.slider, modifiers=key.MOD_CTRL)
    assert typing()
    if missed != "release":
        panel.send("on_key_release", key.LCTRL, key.MOD_CTRL)
    panel.click(OUTSIDE)
    panel.click(panel.slider)
    assert not typing()
