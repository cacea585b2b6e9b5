"""The camera: axis views, lens, what is up, saved views; and photographs."""

import math
from functools import partial

from imgui_bundle import imgui

from ..actions import AXIS_VIEWS, FROM_VIEW, UPS, line_of, set_up, show_photograph, up_name
from ..camera import widened
from ..settings import ORBIT_KEYS, PHOTOGRAPHS
from .widgets import (
    action_box,
    button,
    buttons,
    combo,
    delete_button,
    number_setting,
    slider,
    text_field,
)

ANGLES = 5.0, 100.0  # degrees
WIDER = "the distance changes with it, so that the object stays as large"
PHOTOGRAPH = "over the render as long as the camera is where it was taken, or beside it"
ORBIT = "the key with which a drag on the object turns the view"
UP = "what the horizon is level to: some captures lie on their side"


def camera_panel(viewpoint, settings, actions):
    buttons(actions, *AXIS_VIEWS, "fly", "home", "focus")
    _lens(viewpoint, actions)
    if settings.grab_anywhere:
        change = partial(setattr, settings, "orbit_key")
        combo("orbit with", settings.orbit_key, ORBIT_KEYS, change, ORBIT)
    _saved(viewpoint, actions)


def _lens(viewpoint, actions):
    orbit = viewpoint.orbit

    def widen(degrees):
        viewpoint.orbit = widened(orbit, math.radians(degrees))

    angle = math.degrees(orbit.field_of_view)
    slider("field of view", angle, ANGLES, "%.0f°", widen, tooltip=WIDER)
    action_box(actions, "toggle_parallel")
    combo("up", up_name(orbit), [*UPS, FROM_VIEW], partial(set_up, viewpoint), UP)


def photographs_panel(photographs, settings, viewpoint, controls, fly, center, actions):
    """The data set's photographs, if its folder was given."""
    button(actions, "previous_photograph", "<")
    imgui.same_line()
    button(actions, "next_photograph", ">")
    imgui.same_line()
    imgui.text_disabled(line_of(photographs))
    change = partial(show_photograph, photographs, settings, viewpoint, controls, fly, center)
    combo("photograph", settings.photograph, PHOTOGRAPHS, change, PHOTOGRAPH)
    if settings.photograph == "over":
        number_setting("opacity", settings, "photo_opacity", (0.0, 1.0), "%.2f")


def _saved(viewpoint, actions):
    viewpoint.new_name = text_field("##name", viewpoint.new_name, "a name", width=150.0)
    imgui.same_line()
    button(actions, "save_view")
    for name in list(viewpoint.saved):
        imgui.push_id(name)
        if imgui.button(name):
            viewpoint.go_to(name)
        imgui.same_line()
        delete_button(viewpoint.delete, name)
        imgui.pop_id()
