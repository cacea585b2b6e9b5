"""The section on the camera: axis views, lens, what is up, saved views."""

import math
from functools import partial

from imgui_bundle import imgui

from ..camera import changed, widened
from ..input import AXIS_VIEWS, FROM_VIEW, UPS, line_of, set_up, show_photograph, up_name
from ..settings import ORBIT_KEYS, PHOTOGRAPHS
from .widgets import button, checkbox, combo, number_setting, slider, with_key

ANGLES = 5.0, 100.0  # degrees
A_ROW = 3  # axis views
WIDER = "the distance changes with it, so that the object stays as large"
PARALLEL = "parallel rays: what is far away is as large"
PHOTOGRAPH = "over the render as long as the camera is where it was taken, or beside it"
ORBIT = "the key with which a drag on the object turns the view"
UP = "what the horizon is level to: some captures lie on their side"


def camera_panel(app):
    for number, name in enumerate(AXIS_VIEWS):
        if number % A_ROW:
            imgui.same_line()
        button(name.capitalize(), app, name)
    button("Fly", app, "fly", "with W A S D, Q and E, and the mouse")
    _lens(app)
    settings = app.scene.settings
    if settings.grab_anywhere:
        change = partial(setattr, settings, "orbit_key")
        combo("orbit with", settings.orbit_key, ORBIT_KEYS, change, ORBIT)
    _saved(app)
    if app.photographs is not None:
        _photographs(app)


def _lens(app):
    scene = app.scene

    def widen(degrees):
        scene.orbit = widened(scene.orbit, math.radians(degrees))

    def choose(parallel):
        scene.orbit = changed(scene.orbit, {"parallel": parallel})

    angle = math.degrees(scene.orbit.field_of_view)
    slider("field of view", angle, ANGLES, "%.0f°", widen, tooltip=WIDER)
    tooltip = with_key(app, "toggle_parallel", PARALLEL)
    checkbox("orthographic", scene.orbit.parallel, choose, tooltip)
    combo("up", up_name(scene.orbit), [*UPS, FROM_VIEW], partial(set_up, scene), UP)


def _photographs(app):
    settings = app.scene.settings
    button("<", app, "previous_photograph")
    imgui.same_line()
    button(">", app, "next_photograph")
    imgui.same_line()
    imgui.text_disabled(line_of(app.photographs))
    change = partial(show_photograph, app)
    combo("photograph", settings.photograph, PHOTOGRAPHS, change, PHOTOGRAPH)
    if settings.photograph == "over":
        number_setting("opacity", settings, "photo_opacity", (0.0, 1.0), "%.2f")


def _saved(app):
    viewpoint = app.scene.viewpoint
    _, viewpoint.new_name = imgui.input_text_with_hint("##name", "a name", viewpoint.new_name)
    imgui.same_line()
    button("Save view", app, "save_view")
    for name in list(viewpoint.saved):
        imgui.push_id(name)
        if imgui.button(name):
            viewpoint.go_to(name)
        imgui.same_line()
        if imgui.small_button("x"):
            viewpoint.delete(name)
        imgui.set_item_tooltip("delete it")
        imgui.pop_id()
