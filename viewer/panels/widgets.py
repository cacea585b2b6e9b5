"""Buttons, sliders and boxes that change something when the user does."""

from functools import partial

from imgui_bundle import imgui

from ..input import ACTIONS

LOGARITHMIC = imgui.SliderFlags_.logarithmic.value


def button(label, app, action, tooltip="") -> None:
    """A button that calls one of ACTIONS."""
    if imgui.button(label):
        ACTIONS[action](app)
    _tooltip(tooltip)


def slider(label, value, bounds, text, change, flags=0, tooltip="") -> None:
    """A slider over an int or a float; calls `change` with a new value.

    Args:
        bounds: Lowest and highest value.
        text: ImGui's format of the value.
    """
    draw = imgui.slider_int if isinstance(value, int) else imgui.slider_float
    changed, value = draw(label, value, *bounds, text, flags)
    _tooltip(tooltip)
    if changed:
        low, high = bounds
        change(min(max(value, low), high))  # a value that is typed may be any


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


def _tooltip(text):
    if text:
        imgui.set_item_tooltip(text)
