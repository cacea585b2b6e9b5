"""Actions that change the view: the camera, what the picture shows, the window's panels."""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from ...core.render import MODES
from ..camera import with_up
from ..settings import OF_BONES, PANEL_WIDTHS, TASKS
from ..tools import found_box
from .action import action, choice, gesture, has, method, toggle

AXIS_VIEWS = {  # yaw and pitch [degrees], and the key
    "front": (0.0, 0.0, "_1"),
    "right": (90.0, 0.0, "_3"),
    "above": (0.0, 90.0, "_7"),
    "back": (180.0, 0.0, "SHIFT+_1"),
    "left": (-90.0, 0.0, "SHIFT+_3"),
    "below": (0.0, -90.0, "SHIFT+_7"),
}
UPS = {  # what can be chosen to be up
    sign + axis: tuple(np.roll((1.0 if sign == "+" else -1.0, 0.0, 0.0), place).tolist())
    for place, axis in enumerate("xyz")
    for sign in "+-"
}
FROM_VIEW = "from this view"

gesture("middle or right drag", "pan", only="deformrf")
gesture("middle drag", "orbit", only="blender")
gesture("Shift+middle, or right drag", "pan", only="blender")
gesture("wheel", "zoom to the mouse; with the brush that deletes, its size")


method("viewpoint.focus", "focus: the object, or the point under the mouse", "F", "View/Focus")
method("viewpoint.home", "reset the camera", "HOME", "View/Reset camera")


def _look(yaw, pitch, viewpoint):
    """Turn the camera there about its target."""
    angles = {"yaw": math.radians(yaw), "pitch": math.radians(pitch), "roll": 0.0}
    viewpoint.orbit = replace(viewpoint.orbit, **angles)


for _name, (_yaw, _pitch, _key) in AXIS_VIEWS.items():
    _place = _name if _name in ("above", "below") else f"the {_name}"
    action(f"look from {_place}", _key, f"View/From/{_name.capitalize()}", name=_name)(
        partial(_look, _yaw, _pitch)
    )


@action(
    *("parallel rays, or not: what is far away is as large", "_5", "View/Orthographic"),
    on="viewpoint.orbit.parallel",
)
def toggle_parallel(viewpoint):
    viewpoint.orbit = replace(viewpoint.orbit, parallel=not viewpoint.orbit.parallel)


_help = "fly with W A S D, Q and E, and the mouse; Esc ends"
method("fly.toggle", _help, "G", "View/Fly", "SHIFT+F", "fly")


def up_name(orbit) -> str:
    """What is up, one of UPS, or that it was taken from a view."""
    return next((name for name, up in UPS.items() if np.allclose(up, orbit.up)), FROM_VIEW)


def set_up(viewpoint, name: str) -> None:
    """Let one of UPS be up, or what is up in the picture."""
    up = UPS.get(name)
    if up is None:
        up = viewpoint.orbit.pose[:3, 1]
        up = up / np.linalg.norm(up)
    viewpoint.orbit = with_up(viewpoint.orbit, up)


@action("look from where the camera was before", "ALT+LEFT", "View/-Camera back")
def camera_back(camera_history, viewpoint):
    viewpoint.orbit = camera_history.back() or viewpoint.orbit


@action("and from where it was after that", "ALT+RIGHT", "View/Camera forward")
def camera_forward(camera_history, viewpoint):
    viewpoint.orbit = camera_history.forward() or viewpoint.orbit


@action("next saved view", "V", "View/-Next saved view")
def next_view(viewpoint, say):
    name = viewpoint.next()
    say(f"view: {name}" if name else "no view is saved yet")


@action("save this view", "SHIFT+V", "View/Save view")
def save_view(viewpoint, say):
    say(f"saved: {viewpoint.save()}")


# -- what the picture shows --------------------------------------------------------------------


@action("next view mode: depth, normals, ...", "M", "View/-Show/Next")
def next_mode(settings):
    settings.mode = MODES[(MODES.index(settings.mode) + 1) % len(MODES)]


for _number, _mode in enumerate(MODES, start=1):
    choice(
        *("mode", _mode, f"show {_mode}", f"CTRL+_{_number}", f"View/Show/{_mode}"),
        name=f"show_{_mode}",
    )
for _surface, _help, _key, _name in (
    ("strain", "strain as colors", "CTRL+_9", "strain"),
    ("volume ratio", "volume ratio as colors", "CTRL+_0", "volume"),
    ("plain", "surface of the mesh", "CTRL+W", "surface"),
):
    choice(
        *("mesh_surface", _surface, _help, _key, f"View/Mesh/{_surface}"),
        name=f"toggle_{_name}",
        otherwise="hidden",
    )


@action(
    *("hide or show all red points and pins", "H", "View/Red points", "CTRL+H"),
    on=has("show_handles", True),
)
def toggle_handles(settings, handles):
    settings.show_handles = not settings.show_handles
    handles.hover = None


toggle("show_wireframe", "wireframe", "W", "View/Wireframe")
toggle("show_bones", "hide or show bones", "SHIFT+H", "View/Bones")


@action(
    "the ground with the object's shadow, where there is one and under what stands",
    menu="View/Ground and shadow",
    on=has("show_ground", True),
)
def toggle_ground(settings):
    settings.show_ground = settings.show_floor = not settings.show_ground


@action(
    *("the box that training found around the object", "O", "View/Box"),
    on=has("show_box", True),
)
def toggle_box(settings, field, say):
    settings.show_box = not settings.show_box
    if settings.show_box and found_box(field) is None:
        say("this model has no box: its object was not sought in photographs")


@action(
    "mark what no photograph of the training saw from near the view",
    menu="View/What no photograph saw",
    on=has("show_photographed", True),
)
def toggle_photographed(settings, photographed, field, say):
    views = bool(field.meta.get("views"))
    settings.show_photographed = views and not settings.show_photographed
    photographed.leave()
    if not views:
        say("this model does not say where its photographs were taken: train it again")


# -- panels ------------------------------------------------------------------------------------


def _choose_task(task, settings, controls, rigging):
    """Show the panel about a task, with its tool in the hand and its part of the window."""
    settings.task = task
    settings.show_timeline |= task == "animate"
    with_bones = settings.tool in OF_BONES
    if task == "rig" and not with_bones:
        controls.take_tool("joints" if rigging.skeleton is None else "bones")
    elif task == "bend" and with_bones:
        controls.take_tool("grab")


for _task in TASKS:
    action(
        *(f"the panel is about {_task}", "", f"View/-Task/{_task.capitalize()}"),
        name=f"task_{_task}",
        on=has("task", _task),
    )(partial(_choose_task, _task))
toggle("show_panel", "hide or show the panel", "TAB", "View/Panel/Shown")


choice(
    *("panel_side", "right", "at the other side", "", "View/Panel/On the right"),
    name="panel_side",
    otherwise="left",
)


def _widen(by, settings):
    low, high = PANEL_WIDTHS
    settings.panel_width = min(max(settings.panel_width + by, low), high)


for _name, _by in (("wider", 40.0), ("narrower", -40.0)):
    action(f"40 points {_name}", menu=f"View/Panel/{_name.capitalize()}", name=f"panel_{_name}")(
        partial(_widen, _by)
    )
