"""Buttons, sliders and boxes that change something when the user does.

All numbers that a user can type come through here.
"""

import math
from functools import partial

from imgui_bundle import imgui

from ..input import ACTIONS, label_of

LOGARITHMIC = imgui.SliderFlags_.logarithmic.value


def button(label, app, action, tooltip="") -> None:
    """A button that calls one of ACTIONS; its tooltip names the key."""
    if imgui.button(label):
        ACTIONS[action](app)
    _tooltip(with_key(app, action, tooltip))


def with_key(app, action, text="") -> str:
    """A text, and the key that calls an action, if one does."""
    label = label_of(action, app.scene.settings.keys)
    return f"{text} ({label})" if text and label else text or label


def slider(label, value, bounds, text, change, flags=0, tooltip="") -> None:
    """A slider over an int or a float; calls `change` with a new value.

    What is typed may be any number: beyond the bounds it is the bound, and one that is not
    finite changes nothing.

    Args:
        bounds: Lowest and highest value.
        text: ImGui's format of the value, one of floats.
    """
    whole = isinstance(value, int)  # ImGui's slider of integers takes 1e999 for 1
    changed, value = imgui.slider_float(label, float(value), *bounds, text, flags)
    _tooltip(tooltip)
    if changed and math.isfinite(value):
        low, high = bounds
        value = min(max(value, low), high)
        change(round(value) if whole else float(value))


def sides(label, value, change) -> None:
    """A field for two whole numbers; calls `change` with new ones."""
    changed, chosen = imgui.input_int2(label, list(value))
    if changed:
        change(tuple(chosen))


def color(label, value, change) -> None:
    """A box to choose a color in; calls `change` with a new one, three numbers of 0 to 1."""
    changed, (red, green, blue, *_) = imgui.color_edit3(
        label, list(value), imgui.ColorEditFlags_.no_inputs.value
    )
    chosen = red, green, blue
    if changed and all(map(math.isfinite, chosen)):
        change(tuple(min(max(share, 0.0), 1.0) for share in chosen))


def combo(label, value, values, change, tooltip="") -> None:
    """A box to choose one of several strings in; calls `change` with a new one."""
    values = list(values)
    changed, chosen = imgui.combo(label, values.index(value), values)
    _tooltip(tooltip)
    if changed:
        change(values[chosen])


def checkbox(label, value, change, tooltip="") -> None:
    """A box; calls `change` with True or False when it is clicked."""
    changed, value = imgui.checkbox(label, value)
    _tooltip(tooltip)
    if changed:
        change(value)


def setting(label, settings, name, tooltip="") -> None:
    """A box for one of the Settings."""
    checkbox(label, getattr(settings, name), partial(setattr, settings, name), tooltip)


def number_setting(label, settings, name, bounds, text, flags=0, tooltip="") -> None:
    """A slider for one of the Settings."""
    change = partial(setattr, settings, name)
    slider(label, getattr(settings, name), bounds, text, change, flags, tooltip)


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
