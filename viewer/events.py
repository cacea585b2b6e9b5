"""The event log: one JSON line per event of interest, for a program that drives the viewer."""

import json
import logging

import numpy as np

from .camera import project

log = logging.getLogger(__name__)


class EventLog:
    """Prints events, or nothing at all."""

    def __init__(self, enabled: bool):
        self.enabled = enabled

    def __call__(self, event: str, **fields) -> None:
        log.debug(event)  # for crash reports: no values, which may name files
        if self.enabled:
            print(json.dumps({"event": event, **fields}, default=_plain), flush=True)


def state_of(app) -> dict:
    """The viewer's state for the events "ready" and "state"."""
    scene, controls, radiance = app.scene, app.controls, app.radiance
    ids, rest = scene.handles.control_ids, scene.solver.rest_vertices
    moved = np.linalg.norm(scene.positions - rest, axis=1) / scene.size  # [V]
    pixels, _ = project(controls.camera, scene.handles.at(ids))
    joints = scene.rigging.joints
    places, _ = project(controls.camera, np.reshape([joint.place for joint in joints], (-1, 3)))
    return {
        "size": [app.window.width, app.window.height],
        "framebuffer": controls.size,
        "vertices": [  # in points from the window's top left corner
            {"id": int(vertex), "at": at / controls.ratio}
            for vertex, at, shown in zip(ids, pixels, controls.shown(ids), strict=True)
            if shown
        ],
        "selected": scene.handles.selected,
        "pinned": int(scene.solver.pinned.sum()),
        "undoes": scene.journal.undoes,
        "playhead": scene.timeline.head,
        "joints": [
            {"bone": joint.bone, "end": joint.end, "at": at / controls.ratio}
            for joint, at in zip(joints, places, strict=True)
        ],
        "gizmo": {part.name: part.grip / controls.ratio for part in controls.gizmo_parts()},
        "keys": scene.settings.keys,
        "clip": scene.posing.clip if scene.posing.playing else None,
        "tool": scene.settings.tool,
        "dialog": None if app.questions.dialog is None else app.questions.dialog.title,
        "question": app.questions.name,
        "max_displacement": moved.max(),
        "max_pin_displacement": moved[scene.solver.pinned].max(initial=0.0),
        "moving": scene.clock.moving,
        "paused": scene.clock.paused,
        "refined": radiance.refined,
        "samples": radiance.sample_count,
        "frames": app.frame_count,
        "frame_seconds": app.times.frame_seconds(),
        "stage_seconds": app.times.means(),
        "pace": app.times.pace(),
        "resolution": radiance.factor,
        "yaw": scene.orbit.yaw,
        "pitch": scene.orbit.pitch,
        "distance": scene.orbit.distance,
        "young_modulus": scene.body.material.young_modulus,
    }


def _plain(value):
    """NumPy's arrays and numbers as JSON's."""
    if isinstance(value, np.ndarray):
        return value.astype(float).round(6).tolist()
    return value.item() if isinstance(value, np.generic) else str(value)
