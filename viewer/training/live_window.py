"""The window of a training run: its loop, which leaves the run most of the processor.

While the user does something, frames follow each other as in the viewer.  Else a frame is drawn
when a snapshot has come or the picture is not yet refined, and then the window rests so long
that drawing takes a small share of the time.
"""

import time

import pyglet

from ..app import AWAKE_SECONDS, FRAME_SECONDS, App
from ..layers import choose_path
from .live import POLL_SECONDS, LiveRun, Snapshot

SHOW_SHARE = 0.06  # of the time that frames may take while the user does nothing
LONGEST_REST = 3.0  # s; a frame that comes late because training is busy would cause a longer one
REDRAW_SECONDS = 1.0  # between two frames in which only the curve is new


class LiveWindow:
    """Shows a LiveRun in an App, until the user closes the window."""

    def __init__(self, app: App, live: LiveRun):
        self.app, self.live = app, live
        app.live = live
        app.loaded_on = live.device, "auto"
        self._path = choose_path(app.ctx, *app.loaded_on)
        self._home = None  # the camera's first orbit around the present scene
        self._due = self._drawn = 0.0  # when a frame may be drawn, and when one was
        self._last = time.perf_counter()

    def run(self) -> None:
        """Show the run, and, once it is over, its model; returns when the window is closed."""
        app, live = self.app, self.live
        while not (app.window.has_exit or live.failed):
            if live.ended and live.peek() is None:
                self._show_model()
                return
            pyglet.clock.tick()
            with live.gate.entered(POLL_SECONDS) as entered:
                drawn = entered and self.turn()
            if not drawn:
                app.times.rest()
                time.sleep(POLL_SECONDS)

    def turn(self) -> bool:
        """Take the window's events and a snapshot; whether a frame was drawn."""
        app = self.app
        app.window.switch_to()
        app.window.dispatch_events()
        if app.window.has_exit:
            return False
        if app.opening.asked is not None:
            app.opening.asked = None
            app.recorder.say("while this model is trained, its window opens no other file")
        now = time.perf_counter()
        self.live.touched = app.scene is not None and touched(app.scene)
        taken = self._take()
        waits = now < self._due or not (taken or self._has_more(now))
        if waits and not self._in_use(now):
            return False
        elapsed, self._last = now - self._last, now
        if app.scene is None:
            self._draw_curve()
        else:
            app.frame(elapsed)
        self._drawn = end = time.perf_counter()
        self._due = end + min((end - now) * (1.0 / SHOW_SHARE - 1.0), LONGEST_REST)
        time.sleep(max(0.0, FRAME_SECONDS - (end - now)))
        return True

    def _has_more(self, now):
        """Whether the next frame would show something new, though the user does nothing."""
        old = now - self._drawn > REDRAW_SECONDS
        return old or (self.app.scene is not None and not self.app.radiance.settled)

    def _in_use(self, now):
        """Whether the user does something, or the object moves."""
        app = self.app
        if app.scene is None:
            return False
        awake = now - app.last_event < AWAKE_SECONDS or app.fly.on
        recording = app.recorder.video is not None or app.recorder.wants_screenshot
        return awake or recording or bool(app.controls.mode) or app.scene.moving

    def _take(self) -> bool:
        """Show the run's snapshot if there is one; whether there was."""
        snapshot, scene = self.live.peek(), self.app.scene
        drags = scene is not None and bool(self.app.controls.mode)
        if snapshot is None or (drags and not snapshot.same_mesh):
            return False  # what is dragged has the mesh before
        snapshot = self.live.take()
        keeps = snapshot.scene is None or (snapshot.same_mesh and touched(scene))
        if keeps:
            scene.field = snapshot.field
            self.app.radiance.set_renderer(snapshot.renderer)
        else:
            self._show(snapshot)
        return True

    def _show(self, snapshot: Snapshot):
        """Show the snapshot's scene; the user's settings stay, and the camera if it was moved."""
        app, scene, home = self.app, snapshot.scene, snapshot.scene.orbit
        scene.field = snapshot.field
        if app.scene is None:
            scene.settings.accumulate, scene.settings.show_box = False, True
        else:
            scene.settings = app.scene.settings
            if app.scene.orbit is not self._home:
                scene.orbit = app.scene.orbit
        self._home = home
        app.show(scene, snapshot.renderer, self._path)

    def _draw_curve(self):
        """A frame before there is anything to show but the curve."""
        self.app.show_alone(self.app.panels.training_window)

    def _show_model(self):
        """Go on as the viewer does."""
        app = self.app
        if app.scene is not None:
            app.scene.settings.accumulate = True
            app.begin_autosave()
            app.run()


def touched(scene) -> bool:
    """Whether the user has done something to a scene, or is doing it."""
    return bool(scene.journal.steps)
