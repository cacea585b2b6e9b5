"""Buttons, sliders and boxes that change something when the user does.

All numbers that a user can type come through here.  A slider's number stands on its bar and its
name before it, so that both can be read.
"""

import math
from bisect import bisect
from contextlib import contextmanager
from functools import partial

from imgui_bundle import icons_fontawesome_6, imgui, imgui_ctx

LOGARITHMIC = imgui.SliderFlags_.logarithmic.value
LABEL_SHARE = 0.38  # of the width, for the name before a slider or a list
MOST_LABEL_SHARE = 0.6  # for a longer name
DOTS = "..."
APART = 16.0  # points before a box, which else seems to belong to the word at its left


def icon(name: str) -> str:
    """The glyph of a name, as "hand_pointer": of Font Awesome 6, which comes with imgui-bundle."""
    return getattr(icons_fontawesome_6, f"ICON_FA_{name.upper()}")


def button(actions, action, label="", width=0.0) -> None:
    """A button that calls an action, by default with its title; its tooltip names the key."""
    if imgui.button(label or actions.title(action), (width, 0.0)):
        actions.call(action)
    imgui.set_item_tooltip(actions.told(action))


def buttons(actions, *names) -> None:
    """Buttons side by side, in as many lines as they need; boxes for what menus check."""
    for number, name in enumerate(names):
        is_checked = actions.input(name).is_checked
        if number:
            beside(actions.title(name), is_checked)
        (_box if is_checked else button)(actions, name)


def _box(actions, action):
    title = actions.title(action)
    label, is_on = title[0].lower() + title[1:], actions.is_on(action)
    checkbox(label, is_on, lambda on: actions.call(action), actions.told(action))


def answers(*labels, enter="", marked="") -> str:
    """Buttons side by side; the one that is clicked, or `enter` if Enter is pressed, or empty.

    `marked` looks as `enter` does: Enter in a field has been seen already.
    """
    chosen = enter if enter and was_entered() else ""
    for number, label in enumerate(labels):
        if number:
            imgui.same_line()
        with highlighted(label in (enter, marked)):
            if imgui.button(label):
                chosen = label
    return chosen


def delete_button(delete, name) -> None:
    """A small button that deletes what is called so."""
    if imgui.small_button(icon("trash_can")):
        delete(name)
    imgui.set_item_tooltip(f"delete {name}")


def named(label):
    """Write the name before a field, which takes the rest of the line; returns its id."""
    shown, _, _ = label.partition("##")
    if not shown:
        return label
    imgui.align_text_to_frame_padding()
    cut = fitting(shown, MOST_LABEL_SHARE * imgui.get_content_region_avail().x)
    imgui.text_disabled(cut)
    _tooltip(shown if cut != shown else "")
    left, width = imgui.get_cursor_pos_x(), imgui.get_item_rect_size().x
    share = LABEL_SHARE * (imgui.get_content_region_avail().x + left)
    imgui.same_line(max(share, left + width + imgui.get_style().item_spacing.x))
    imgui.set_next_item_width(-1.0)
    return f"##{label}"


def fitting(text: str, width: float) -> str:
    """A user's text, or as much of its beginning as fits, with dots."""

    def wide(shown):
        return imgui.calc_text_size(shown).x

    if wide(text) <= width:
        return text
    counts = range(1, len(text))
    return text[: bisect(counts, width - wide(DOTS), key=lambda count: wide(text[:count]))] + DOTS


def of(owner, name):
    """The value of an attribute, as one of the Settings, and a function that gives it another."""
    return getattr(owner, name), partial(setattr, owner, name)


def slider(label, value, change, bounds, text, flags=0, tooltip="") -> None:
    """A slider over an int or a float; calls `change` with a new value.

    What is typed may be any number: beyond the bounds it is the bound, and one that is not
    finite changes nothing.

    Args:
        bounds: Lowest and highest value.
        text: ImGui's format of the value, one of floats.
    """
    whole = isinstance(value, int)  # ImGui's slider of integers takes 1e999 for 1
    changed, value = imgui.slider_float(named(label), float(value), *bounds, text, flags)
    _tooltip(tooltip)
    if changed and math.isfinite(value):
        low, high = bounds
        value = min(max(value, low), high)
        change(round(value) if whole else float(value))


def sides(label, owner, name) -> None:
    """A field for an attribute of two whole numbers."""
    changed, chosen = imgui.input_int2(named(label), list(getattr(owner, name)))
    if changed:
        setattr(owner, name, tuple(chosen))


def color(label, value, change) -> None:
    """A box to choose a color in; calls `change` with a new one, three numbers of 0 to 1."""
    changed, (red, green, blue, *_) = imgui.color_edit3(
        named(label), list(value), imgui.ColorEditFlags_.no_inputs.value
    )
    chosen = red, green, blue
    if changed and all(map(math.isfinite, chosen)):
        change(tuple(min(max(share, 0.0), 1.0) for share in chosen))


def combo(label, value, change, values, tooltip="") -> None:
    """A box to choose one of several values in; calls `change` with another one.

    Args:
        values: Strings or numbers, or a dictionary of what they are called; a value that is none
            of these is "custom".
    """
    words = values if isinstance(values, dict) else {str(one): one for one in values}
    words = words if value in words.values() else {**words, "custom": value}
    found = list(words.values())
    changed, chosen = imgui.combo(named(label), found.index(value), list(words))
    _tooltip(tooltip)
    if changed:
        change(found[chosen])


def text_field(label, value, hint="", width=-1.0) -> str:
    """A field to type in; returns what stands in it."""
    imgui.set_next_item_width(width)
    return imgui.input_text_with_hint(label, hint, value)[1]


def checkbox(label, value, change, tooltip="") -> None:
    """A box; calls `change` with True or False when it is clicked."""
    with imgui_ctx.push_style_var(imgui.StyleVar_.frame_border_size.value, 1.0):
        changed, value = imgui.checkbox(label, value)
    _tooltip(tooltip)
    if changed:
        change(value)


def radio(label, is_chosen) -> bool:
    """A round box, one of which is chosen; whether it is clicked."""
    with imgui_ctx.push_style_var(imgui.StyleVar_.frame_border_size.value, 1.0):
        return imgui.radio_button(label, is_chosen)


def segments(values, chosen, choose, tooltip=lambda value: "") -> None:
    """Buttons side by side, one of which is chosen; `values` are words by value."""
    for number, (value, word) in enumerate(values.items()):
        if number:
            imgui.same_line(0.0, 1.0)
        with highlighted(value == chosen):
            if imgui.button(word):
                choose(value)
        _tooltip(tooltip(value))


@contextmanager
def highlighted(on: bool):
    """In the block, buttons have the color of what is chosen."""
    if on:
        color = imgui.get_style_color_vec4(imgui.Col_.button_active.value)
        imgui.push_style_color(imgui.Col_.button.value, color)
    yield
    if on:
        imgui.pop_style_color()


def section(title: str, is_open: bool = True) -> bool:
    """The head of a part of a panel; whether it is open."""
    return imgui.collapsing_header(title, imgui.TreeNodeFlags_.default_open.value * is_open)


def beside(label: str, is_box: bool) -> None:
    """Go on in the same line if a button, or box, with that label fits there; else below."""
    style = imgui.get_style()
    width = imgui.calc_text_size(label).x + 2.0 * style.frame_padding.x
    width += imgui.get_frame_height() * is_box
    spacing = APART if is_box else style.item_spacing.x
    right = imgui.get_item_rect_max().x + spacing + width
    if right < imgui.get_cursor_screen_pos().x + imgui.get_content_region_avail().x:
        imgui.same_line(0.0, spacing)


def was_entered() -> bool:
    """Whether Enter was pressed for the window that is being built, not for a list over it."""
    flags = imgui.FocusedFlags_
    focused = imgui.is_window_focused(
        flags.root_and_child_windows.value | flags.no_popup_hierarchy.value
    )
    keys = imgui.Key.enter, imgui.Key.keypad_enter
    return focused and any(imgui.is_key_pressed(one, False) for one in keys)


def _tooltip(text):
    if text:
        imgui.set_item_tooltip(text)
