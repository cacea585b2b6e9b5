"""Actions about what is no object: specks, the found box, and the smaller model."""

import numpy as np

from ...wings.rig import arrays_of
from .deleting import said


def _delete_specks(app):
    app.controls.cancel()
    app.recorder.say(said(app.scene, app.scene.cuts.delete_specks))


def found_box(field):
    """The box that training found around a field's object, at rest; None without one.  [2, 3]"""
    box = field.meta.get("object_box")
    return None if box is None else np.array(box, float)


def _toggle_box(app):
    settings = app.scene.settings
    settings.show_box = not settings.show_box
    if settings.show_box and found_box(app.scene.field) is None:
        app.recorder.say("this model has no box: its object was not sought in photographs")


_toggle_box.is_on = lambda app: app.scene.settings.show_box


def _save_model(app):
    scene = app.scene
    factors = None if scene.body.factors is None else scene.body.factors.copy()
    arrays = scene.field.rig_arrays
    if scene.rigging.changed:  # else a session fits the copy as well: the arrays are the same
        rig = scene.rigging.rig
        arrays = None if rig is None else arrays_of(rig)
    app.recorder.save_model(scene.cuts.smaller(factors, arrays))


DELETE_ACTIONS = {
    "delete_specks": _delete_specks,
    "toggle_box": _toggle_box,
    "save_model": _save_model,
}
