"""The strip of tools at the window's left edge: an icon for each, the one in the hand in color."""

from imgui_bundle import imgui

from ..settings import DELETING, OF_BONES
from .widgets import highlighted, icon

GAP = 2.0  # points, between two buttons
WIDE, NARROW = (54.0, 40.0), (34.0, 30.0)  # a button with a word, and without
LOW = 560.0  # points: a window that is lower has no words
WORD = 11.0  # points, of its letters
GROUPS = ("grab", "box", "lasso"), ("push", "stiffen", "soften"), OF_BONES, (*DELETING, "isolate")
ACTIONS = {"push": "toggle_push"}  # of tools, where they aren't called like their action


def strip_width() -> float:
    """What the strip takes of the window [points]."""
    return _size()[0] + imgui.get_style().window_padding.x


def _size():
    """Of a button."""
    return WIDE if imgui.get_io().display_size.y >= LOW else NARROW


def tool_strip(controls, actions) -> None:
    imgui.push_style_var(imgui.StyleVar_.item_spacing.value, (GAP, GAP))
    size = _size()
    for number, group in enumerate(GROUPS):
        if number:
            imgui.spacing()
            imgui.separator()
            imgui.spacing()
        for name in group:
            _button(controls, actions, controls.tools[name], size)
    imgui.pop_style_var()


def _button(controls, actions, tool, size):
    action = ACTIONS.get(tool.name, tool.name.replace(" ", "_"))
    corner = imgui.get_cursor_screen_pos()
    with highlighted(controls.tool is tool):
        if imgui.button(f"##{tool.name}", size):
            actions.call(action)
    imgui.set_item_tooltip(f"{actions.told(action, tool.title)}\n{tool.hint}")
    middle = corner.x + 0.5 * size[0]
    _write(icon(tool.icon), middle, corner.y + (7.0 if size is NARROW else 5.0))
    if size is WIDE:
        _write(tool.word, middle, corner.y + 24.0, WORD)


def _write(text, middle, y, size=0.0):
    """Write a text around a middle, by default in letters of the usual size [points]."""
    imgui.push_font(None, size)
    width = imgui.calc_text_size(text).x
    color = imgui.get_color_u32(imgui.Col_.text.value)
    imgui.get_window_draw_list().add_text((middle - 0.5 * width, y), color, text)
    imgui.pop_font()
