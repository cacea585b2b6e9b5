"""Dear ImGui in a pyglet window: events in, its own OpenGL 3 renderer out.

Clicks and wheel turns over a panel belong to it and do not reach the view.  ImGui gets
every click, because a click beside the panel ends a text entry there.  ImGui's own flag
(`want_capture_mouse`) is as old as the last frame, which may have been slow, so presses are
tested against the rectangles of the panels instead.

While a dialog or a list is open, keys and clicks are theirs alone.  What was held before can
still be let go: releases reach the view.
"""

import logging
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

import imgui_bundle
import numpy as np
from imgui_bundle import imgui
from pyglet.window import key, mouse

from .actions import action_of
from .parts import call
from .style import apply_style
from .window import WindowError

log = logging.getLogger(__name__)

FONTS = Path(imgui_bundle.__file__).parent / "assets" / "fonts"
FONT = FONTS / "Roboto" / "Roboto-Regular.ttf"
ICONS = FONTS / "Font_Awesome_6_Free-Solid-900.otf"  # their names: icons.py
FONT_SIZE, ICON_SIZE = 15.0, 13.0
NOWHERE = -3.4e38  # ImGui's own "no mouse"
BUTTONS = {mouse.LEFT: 0, mouse.RIGHT: 1, mouse.MIDDLE: 2}
MODIFIERS = (
    ((key.LCTRL, key.RCTRL), key.MOD_CTRL, imgui.Key.mod_ctrl),
    ((key.LSHIFT, key.RSHIFT), key.MOD_SHIFT, imgui.Key.mod_shift),
    ((key.LALT, key.RALT), key.MOD_ALT, imgui.Key.mod_alt),
)
# What edits text; modifiers come with every key, characters as text.
SAME_KEYS = ("tab", "escape", "backspace", "delete", "insert", "space", "home", "end", *"acvxyz")
OTHER_KEYS = {  # pyglet's names -> ImGui's
    "RETURN": "enter",
    "NUM_ENTER": "keypad_enter",
    "LEFT": "left_arrow",
    "RIGHT": "right_arrow",
    "UP": "up_arrow",
    "DOWN": "down_arrow",
    "PAGEUP": "page_up",
    "PAGEDOWN": "page_down",
}
KEYS = {  # pyglet's symbols -> ImGui's keys
    getattr(key, name): getattr(imgui.Key, value)
    for name, value in ({name.upper(): name for name in SAME_KEYS} | OTHER_KEYS).items()
}


def add_fonts() -> None:
    """Letters, and icons among them."""
    fonts = imgui.get_io().fonts
    if FONT.is_file():
        fonts.add_font_from_file_ttf(str(FONT), FONT_SIZE)
        if ICONS.is_file():
            merged = imgui.ImFontConfig()
            merged.merge_mode = True
            merged.glyph_min_advance_x = ICON_SIZE
            fonts.add_font_from_file_ttf(str(ICONS), ICON_SIZE, merged)


class Gui:
    """ImGui attached to one window."""

    def __init__(self, window):
        self.window = window
        imgui.create_context()
        self._io = imgui.get_io()
        self._io.set_ini_filename("")  # no file in the user's current folder
        add_fonts()
        self.theme, self.scale = "", 1.0  # of THEMES; points of the window per point of the panels
        self.dress("dark", 1.0)
        if not imgui.backends.opengl3_init("#version 330"):
            raise WindowError("ImGui's OpenGL renderer does not start")
        platform = imgui.get_platform_io()
        platform.platform_get_clipboard_text_fn = lambda context: window.get_clipboard_text()
        platform.platform_set_clipboard_text_fn = lambda context, text: window.set_clipboard_text(
            text
        )
        self._time = time.perf_counter()
        self._rectangles = []  # of the panels in the last frame: left, top, right, bottom
        self._building = []
        self.mouse_on_panel = False  # when it was last seen without a button
        self._cross = False  # whether the mouse is shown as a cross
        self._captured = set()  # buttons that were pressed on a panel
        self._pressed = False  # on a panel, which has not answered yet
        self.amount = self.help_filter = ""  # that are typed: for the gizmo, and in the help
        self.log_file = None  # that a failed panel names
        self.asks: Callable[[], bool] = lambda: False  # whether there is a dialog, drawn or not
        self.lends: Callable[[], bool] = lambda: False  # whether a gesture has the mouse everywhere
        self._dialog = ""  # the one that is drawn
        self._failed = set()  # messages that were logged

    def dress(self, theme: str, scale: float) -> None:
        """Give the panels the colors of one of THEMES, and make them larger or smaller."""
        if (theme, scale) != (self.theme, self.scale):
            self.theme, self.scale = theme, scale
            apply_style(theme)

    # -- events: True means that the view does not get them -------------------------------

    def covers(self, x: float, y: float) -> bool:
        """Whether a panel is at that position of the window, or anything is open."""
        x, y = self._place(x, y)
        inside = any(
            left <= x <= right and low <= y <= high for left, low, right, high in self._rectangles
        )
        return (inside and not self.lends()) or self.has_keyboard

    @property
    def has_keyboard(self) -> bool:
        """Whether a dialog or a list is open: shortcuts mean nothing to the view then."""
        return self.asks() or self._list_is_open()

    @property
    def _typing(self):
        """Whether text is typed, or may be: frames are slow, and the first key comes before one.

        Into a dialog that has been taken away, it is no longer.
        """
        begins = self._pressed or imgui.get_current_context().want_text_input_next_frame > 0
        return (begins or self._io.want_text_input) and not (self._dialog and not self.asks())

    def _list_is_open(self):
        """Whether a menu or the list of a combo is open, over a dialog or without one."""
        return len(imgui.get_current_context().open_popup_stack) > bool(self._dialog)

    def _place(self, x, y):
        """Where a position of the window is in the panels [points], y down."""
        return x / self.scale, (self.window.height - 1 - y) / self.scale

    def _move(self, x, y):
        self._io.add_mouse_pos_event(*self._place(x, y))
        self.mouse_on_panel = self.covers(x, y)

    def on_mouse_motion(self, x, y, dx, dy):
        self._move(x, y)
        return self.mouse_on_panel or None

    def on_mouse_drag(self, x, y, dx, dy, buttons, modifiers):
        """Whatever has the mouse keeps it until the button is up: `mouse_on_panel` stays."""
        self._io.add_mouse_pos_event(*self._place(x, y))
        return bool(self._captured) or None

    def on_mouse_press(self, x, y, button, modifiers):
        self._move(x, y)
        for _, bit, name in MODIFIERS:  # their own keys may have gone to another window
            self._io.add_key_event(name, bool(modifiers & bit))
        if not self.lends() or self.has_keyboard:
            self._add_button(button, True)
        if self.mouse_on_panel:
            self._captured.add(button)
            self._pressed = True
        return self.mouse_on_panel or None

    def on_mouse_release(self, x, y, button, modifiers):
        self._move(x, y)
        self._add_button(button, False)
        was_captured = button in self._captured
        self._captured.discard(button)
        return was_captured or None  # a drag of the view that ends over a panel has to end

    def on_mouse_scroll(self, x, y, scroll_x, scroll_y):
        self._move(x, y)
        if self.mouse_on_panel:
            self._io.add_mouse_wheel_event(scroll_x, scroll_y)
        return self.mouse_on_panel or None

    @property
    def pointer(self) -> np.ndarray:
        """Where the mouse is [points], y down; also over a panel.  [2]"""
        return np.array([self._io.mouse_pos.x, self._io.mouse_pos.y])

    def point_with_cross(self, on: bool) -> None:
        """Show the mouse as a cross, as tools have it, or as an arrow."""
        if on != self._cross:
            self._cross = on
            shape = self.window.CURSOR_CROSSHAIR if on else self.window.CURSOR_DEFAULT
            self.window.set_mouse_cursor(self.window.get_system_mouse_cursor(shape))

    def on_mouse_leave(self, x, y):
        self._io.add_mouse_pos_event(NOWHERE, NOWHERE)
        self.mouse_on_panel = False

    def on_activate(self):
        self._io.add_focus_event(True)

    def on_deactivate(self):
        self._io.add_focus_event(False)

    def on_key_press(self, symbol, modifiers):
        if symbol == key.ESCAPE and self._list_is_open():
            imgui.internal.close_popup_to_level(bool(self._dialog), False)
            return True
        self._add_key(symbol, modifiers, True)
        action = action_of(key.symbol_string(symbol), modifiers)  # these are so with all KEYS
        if action == "quit" or (action == "cancel" and self.asks()):
            return None  # the App takes a dialog away, and asks before it ends
        # want_capture_keyboard would block the shortcuts whenever a panel has the focus.
        return self.has_keyboard or self._typing or None

    def on_key_release(self, symbol, modifiers):
        self._add_key(symbol, modifiers, False)

    def on_text(self, text):
        for character in filter(str.isprintable, text):
            self._io.add_input_character(ord(character))
        return self.has_keyboard or self._typing or None

    def _add_button(self, button, down):
        if button in BUTTONS:
            self._io.add_mouse_button_event(BUTTONS[button], down)

    def _add_key(self, symbol, modifiers, down):
        for own_keys, bit, name in MODIFIERS:
            # X11 reports modifiers as before the event, which is wrong for their own keys.
            held = down if symbol in own_keys else bool(modifiers & bit)
            self._io.add_key_event(name, held)
        # Tab shows the panel; ImGui would go to its first field and take every key from then on.
        to_the_first_field = symbol == key.TAB and down and not self._io.want_text_input
        if symbol in KEYS and not to_the_first_field:
            self._io.add_key_event(KEYS[symbol], down)

    # -- frame ---------------------------------------------------------------------------

    def begin(self) -> None:
        """Start a frame of panels."""
        points, pixels = self.window.get_size(), self.window.get_framebuffer_size()
        self._io.display_size = tuple(np.divide(points, self.scale))
        ratio = np.divide(pixels, np.maximum(points, 1))
        self._io.display_framebuffer_scale = tuple(self.scale * ratio)
        now = time.perf_counter()
        self._io.delta_time = max(now - self._time, 1e-4)
        self._time = now
        self._building = []
        imgui.backends.opengl3_new_frame()
        imgui.new_frame()

    def claim(self) -> None:
        """Note where the panel that is being built lies: the mouse there is not the view's."""
        at, size = imgui.get_window_pos(), imgui.get_window_size()
        self._building.append((at.x, at.y, at.x + size.x, at.y + size.y))

    @contextmanager
    def dialog(self, name: str, flags: int):
        """Build a window in front of all others, which get no input meanwhile.

        An empty name is for frames without a dialog.  Gives whether there is one to be filled.
        """
        if self._dialog and self._dialog != name:
            if imgui.is_popup_open(self._dialog):
                imgui.internal.close_popup_to_level(0, True)
            # Keys that ImGui still has for the dialog, in slow frames, are not another's.
            self._io.clear_events_queue()
            self._io.clear_input_keys()
            self._io.clear_input_mouse()
            self._io.want_text_input = False  # nobody types into it; ImGui says so a frame later
        self._dialog = name
        if not name:
            yield False
            return
        if not imgui.is_popup_open(name):
            imgui.open_popup(name)  # lists that are open are closed
        shown = imgui.begin_popup_modal(name, None, flags)[0]
        yield shown
        if shown:
            self.claim()
            imgui.end_popup()

    def guarded(self, panel, window=None) -> None:
        """Draw a panel; one that fails says so and is tried again in the next frame.

        Args:
            window: Whose parts the panel gets, as parts.call says.
        """
        state = imgui.internal.ErrorRecoveryState()
        imgui.internal.error_recovery_store_state(state)
        # What an error leaves open is closed in `with` statements, and then here.
        self._io.config_error_recovery_enable_assert = False
        try:
            if window is None:
                panel()
            else:
                call(panel, window)
        except Exception as error:
            imgui.internal.error_recovery_try_to_recover_state(state)
            message = f"{panel.__name__} failed: {error}"
            imgui.text_wrapped(message)
            if self.log_file is not None:
                imgui.text_disabled(f"more in {self.log_file}")
            if message not in self._failed:
                self._failed.add(message)
                log.exception(message)
        finally:
            self._io.config_error_recovery_enable_assert = True

    def end(self) -> None:
        """Draw the panels into the framebuffer in use."""
        self._rectangles = self._building
        imgui.render()
        # ImGui divides what came together among several frames.
        self._pressed = self._pressed and len(imgui.get_current_context().input_events_queue) > 0
        self.show_again()

    def show_again(self) -> None:
        """Draw the panels as they were built last."""
        imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())

    def close(self) -> None:
        self.window.remove_handlers(self)
        imgui.backends.opengl3_shutdown()
        imgui.destroy_context()
