"""Actions that move the camera: axis views, projection, saved views."""

import math
from dataclasses import replace

import numpy as np

from ..camera import pose_of, with_up
from .photo_actions import PHOTO_ACTIONS

AXIS_VIEWS = {  # yaw and pitch [degrees]
    "front": (0.0, 0.0),
    "back": (180.0, 0.0),
    "right": (90.0, 0.0),
    "left": (-90.0, 0.0),
    "above": (0.0, 90.0),
    "below": (0.0, -90.0),
}
UPS = {  # what can be chosen to be up
    sign + axis: tuple(np.roll((1.0 if sign == "+" else -1.0, 0.0, 0.0), place).tolist())
    for place, axis in enumerate("xyz")
    for sign in "+-"
}
FROM_VIEW = "from this view"


def _axis_view(yaw, pitch):
    """A function that turns the camera there about its target."""

    def look(app):
        angles = {"yaw": math.radians(yaw), "pitch": math.radians(pitch), "roll": 0.0}
        app.scene.orbit = replace(app.scene.orbit, **angles)

    return look


def _toggle_parallel(app):
    orbit = app.scene.orbit
    app.scene.orbit = replace(orbit, parallel=not orbit.parallel)


_toggle_parallel.is_on = lambda app: app.scene.orbit.parallel


def up_name(orbit) -> str:
    """What is up, one of UPS, or that it was taken from a view."""
    return next((name for name, up in UPS.items() if np.allclose(up, orbit.up)), FROM_VIEW)


def set_up(scene, name: str) -> None:
    """Let one of UPS be up, or what is up in the picture."""
    up = UPS.get(name)
    if up is None:
        up = pose_of(scene.orbit)[:3, 1]
        up = up / np.linalg.norm(up)
    scene.orbit = with_up(scene.orbit, up)


def _save_view(app):
    app.recorder.say(f"saved: {app.scene.viewpoint.save()}")


def _next_view(app):
    name = app.scene.viewpoint.next()
    app.recorder.say(f"view: {name}" if name else "no view is saved yet")


VIEW_ACTIONS = {
    **{name: _axis_view(*angles) for name, angles in AXIS_VIEWS.items()},
    "focus": lambda app: app.scene.viewpoint.focus(),
    "home": lambda app: app.scene.viewpoint.home(),
    "toggle_parallel": _toggle_parallel,
    "fly": lambda app: app.fly.toggle(),
    **PHOTO_ACTIONS,
    "save_view": _save_view,
    "next_view": _next_view,
}
