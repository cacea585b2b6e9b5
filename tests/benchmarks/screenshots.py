"""Pictures of the viewer in its main states, panels included, for README and for the eye.

    python tests/benchmarks/screenshots.py [--out docs/figures] [--only viewer strain]

Frames are rendered in full without a display, on the CPU.
"""

import argparse
from pathlib import Path

import numpy as np
import pyglet
from PIL import Image

SIZE = 1200, 800
SETTLING = 40  # frames
SHADES = 128  # of each color in the files: half the renderer's, which nobody sees


class Studio:
    """The viewer on a model, by default the bundled one, and what is set up in it."""

    def __init__(self, field=None, name="helmet", size=SIZE):
        pyglet.options.headless = True
        from deformrf.viewer.window import open_window

        window, context = open_window(size, headless=True)
        from deformrf.core import field as fields
        from deformrf.core.base.paths import DEFAULT_MODEL
        from deformrf.viewer.app import App
        from deformrf.viewer.events import EventLog

        self.app = App(window, context, EventLog(False))
        self.app.load(field or fields.load(DEFAULT_MODEL), name, "cpu")
        self.app.questions.left_behind = None
        settings = self.app.scene.settings
        settings.panel_in_screenshots = True
        settings.has_dragged = True  # or a line over the picture says how to bend it

    def frames(self, count, seconds=1 / 60):
        for _ in range(count):
            self.app.scene.clock.advance(seconds)
        for _ in range(3):  # panels take a frame or two to find their size
            self.app.frame(0.0, whole=True)

    def picture(self, path):
        """Write the next frame; with the panel, as the user sees it."""
        self.app.recorder.screenshot(path)
        self.app.frame(0.0, whole=True)

    def top(self, count=1):
        """The highest control points."""
        handles = self.app.scene.handles
        ids = handles.control_ids
        return [int(i) for i in ids[np.argsort(-handles.at(ids)[:, 2])[:count]]]

    def drag(self, handle, way):
        """Drag a handle aside, by object sizes; it stays in the hand."""
        scene = self.app.scene
        scene.handles.grab(handle)
        scene.handles.hover = handle
        scene.handles.drag_to(scene.handles.grabbed.start + scene.size * np.array(way))
        self.frames(SETTLING)

    def calm(self):
        """As at the start."""
        scene = self.app.scene
        scene.reset()
        scene.handles.select([])
        scene.handles.hover = None


def viewer(studio):
    studio.drag(studio.top()[0], (0.22, -0.05, -0.04))


def selection(studio):
    scene = studio.app.scene
    scene.handles.select(studio.top(8))
    scene.handles.grab(scene.handles.selected[0])
    scene.handles.turn_to([0.0, 0.0, 0.6], 1.0)
    studio.frames(SETTLING)


def strain(studio):
    settings = studio.app.scene.settings
    settings.mesh_surface, settings.task = "strain", "view"
    studio.drag(studio.top()[0], (0.22, -0.05, -0.04))


def ground(studio):
    scene = studio.app.scene
    scene.set_ground(True)
    scene.hold(False)
    scene.set_gravity(9.81)
    studio.frames(75)


def timeline(studio):
    from deformrf.viewer.actions import ACTIONS

    app = studio.app
    ACTIONS["turntable"](app)
    studio.drag(studio.top()[0], (0.22, -0.05, -0.04))
    app.scene.timeline.scrub(120)
    ACTIONS["key_pose"](app)
    app.scene.settings.task = "animate"
    studio.frames(2)


def rig(studio):
    from deformrf.viewer.actions import ACTIONS
    from deformrf.wings.rig import turned

    app, scene = studio.app, studio.app.scene
    for place in ((0.53, 0.52, 0.13), (0.55, 0.55, 0.4), (0.51, 0.5, 0.78)):
        scene.rigging.add_joint(np.array(place))
    settings = scene.settings
    settings.task, settings.tool, settings.show_handles = "rig", "bones", False
    ACTIONS["rest_bones"](app)
    ACTIONS["key_pose"](app)
    scene.timeline.scrub(90)
    scene.posing.hold_bone(1)
    scene.posing.aim(turned(scene.rigging.skeleton, scene.posing.current, 1, (0.1, 0.6, 0.0)))
    studio.frames(2)
    ACTIONS["key_pose"](app)
    studio.frames(2)


STATES = {act.__name__: act for act in (viewer, selection, strain, ground, timeline, rig)}


def shrink(path):
    """Write a picture again with fewer shades, as a smaller file."""
    shares = np.asarray(Image.open(path).convert("RGB")) / 255.0
    steps = SHADES - 1
    shades = np.round(np.round(shares * steps) * (255.0 / steps)).astype(np.uint8)
    Image.fromarray(shades).save(path, optimize=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    parser.add_argument("--only", nargs="+", choices=STATES, default=list(STATES))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.only:
        studio = Studio()
        STATES[name](studio)
        path = arguments.out / f"{name}.png"
        studio.picture(path)
        shrink(path)
        studio.app.end()
        studio.app.close()


if __name__ == "__main__":
    main()
