"""App: the window, what is drawn in it, and the loop of frames.

App.frame is one frame: time passes in the scene, the field is rendered if anything changed,
field, spheres and panels are drawn into the canvas, and the canvas is shown.  Without a
display the same frames go into files.
"""

import logging
import time
from contextlib import contextmanager
from pathlib import Path

import pyglet
from pyglet.window import key

from . import logs, preferences, showing
from .actions import BoundActions, action_of, placed_photograph
from .camera import CameraHistory, Covered, clip_range
from .document import Autosave, Strip, autosave_folder
from .events import state_of
from .files import Opening, Problem, readable
from .films import Recorder, Takes, without_background
from .layers import Canvas, PhotoLayer
from .parts import call
from .playing import Playing
from .questions import Questions
from .settings import OF_BONES
from .times import FrameTimes
from .training import Watcher, offer_of

log = logging.getLogger(__name__)

FRAME_SECONDS = 1.0 / 60.0  # the shortest frame, where vsync sets none
AWAKE_SECONDS = 1.0  # after an event, frames are drawn: panels answer over several of them
WAITING_SECONDS = 0.1  # in each frame while thin parts are fitted
POLL_SECONDS = 1.0 / 30.0  # between two looks for events at rest
FITTING = "working out how stiff thin parts are, once for this model: it moves in some seconds"
REDRAW_SECONDS = 1.0  # between two frames at rest: messages disappear, curves grow
BUSY_SECONDS = 0.2  # the same while something is worked out
PANEL_SECONDS = 0.1  # between two times that panels are built while something is dragged
STATE_SECONDS = 0.5  # between two "state" events in the log
INPUT_EVENTS = (
    *("on_key_press", "on_key_release", "on_text", "on_file_drop"),
    *("on_mouse_press", "on_mouse_release", "on_mouse_drag", "on_mouse_motion", "on_mouse_scroll"),
)


class App:
    """A window onto one model; `load` sets scene, radiance, handles and controls."""

    def __init__(self, window, ctx, log, gui: bool = True, fps: int = 30, kept=None):
        """Take a window and its context, an EventLog, the frame rate of videos, Preferences."""
        self.window, self.ctx, self.log = window, ctx, log
        self.scene = None
        self.progress = None  # of `load`
        self.times = FrameTimes()
        self.canvas = Canvas(ctx)
        self.photo_layer = PhotoLayer(ctx)
        self.recorder = Recorder(self.canvas, log, fps)
        self.preferences = kept or preferences.Preferences()
        self.takes = Takes(self)
        self.frame_count = 0
        self.autosave = None  # see autosave.py
        self.project: Path | None = None  # the file that `save_project` writes by default
        self.train_job, self.watcher = None, Watcher(self)  # see training/
        self.actions, self.questions = BoundActions(self), Questions(self)
        self.opening, self.playing = Opening(self), Playing(self)
        self.closing = False  # the window was closed while nothing could be asked
        self.strip = Strip()  # of the timeline
        self.camera_history, self._caption = CameraHistory(), ""
        self.log_file = self.loaded_on = None  # that dialogs name; the last device and interop
        self._failed = False  # in the last turn of the loop
        # When the window had an event, its state was logged, a frame was drawn, panels were built.
        self.last_event = self._last_state = self._drawn_at = self._built_at = 0.0
        self._has_news = True  # for the panels
        self._only_drags = False  # in the last frame, nothing went on beside a plain drag
        self.gui = self.panels = None
        window.push_handlers(self)
        if gui:
            from .gui import Gui
            from .panels import Panels

            self.gui = Gui(window)
            self.panels = Panels(self)
            self.gui.asks = lambda: bool(self.questions.name)
            self.gui.lends = lambda: self.scene is not None and self.controls.free

    # -- start ---------------------------------------------------------------------------

    def load(self, field, name: str, device: str, interop: str = "auto") -> None:
        """Show a model, as showing.load does."""
        showing.load(self, field, name, device, interop)

    def offer_training(self, data: Path) -> None:
        """Ask whether a model of these photographs shall be trained."""
        self.questions.dialog = offer_of(data, str(self.scene.solver.device))

    def begin_autosave(self) -> None:
        """Keep the session of the scene from now on."""
        self.autosave = Autosave(self.scene, self.session_start, autosave_folder())

    @contextmanager
    def only_shown(self, **handlers):
        """In the block, keys, mouse and dropped files do nothing: the scene is not ready.

        Who closes the window is asked, or it is closed, with the next frame.

        Args:
            handlers: What is done nevertheless, by the events' names.
        """

        def on_close():
            self.closing = True
            return True

        swallowed = dict.fromkeys(INPUT_EVENTS, lambda *arguments: True)
        swallowed |= {"on_close": on_close, **handlers}
        self.window.push_handlers(**swallowed)
        try:
            yield
        finally:
            self.window.remove_handlers(**swallowed)

    def show_alone(self, draw, *arguments):
        """Show a panel on a plain ground."""
        self.window.switch_to()
        self.window.dispatch_events()
        self.canvas.use(self.size)
        self.ctx.clear(0.94, 0.94, 0.95, 1.0)
        self.gui.begin()
        draw(*arguments)
        self.gui.end()
        self.canvas.show()
        self.window.flip()

    # -- the window's events (the mouse's are in controls.py) ----------------------------

    def on_key_press(self, symbol, modifiers):
        keys = "deformrf" if self.scene is None else self.scene.settings.keys
        action = action_of(key.symbol_string(symbol), modifiers, keys)
        if action == "cancel" and self.questions.dismiss():
            return True
        if action == "quit" or (self.scene is not None and action is not None):
            self.actions.call(action)
        return True  # pyglet's own handler would close the window on Esc

    def on_close(self):
        self.questions.leave()
        return True  # pyglet's own handler would end the loop

    def on_resize(self, width, height):
        self.log("resize", size=[width, height], framebuffer=self.size)
        return True  # pyglet's own handler would set a viewport

    def on_file_drop(self, x, y, paths):
        if self.scene is not None and self.questions.leaving is None and paths:
            self.opening.asked = Path(paths[0])

    def _note_event(self, *arguments):
        self.last_event, self._has_news = time.perf_counter(), True

    def _note_drag(self, *arguments):
        self.last_event = time.perf_counter()

    # -- loops ---------------------------------------------------------------------------

    def run(self, frame_count: int | None = None) -> None:
        """Show frames until the window is closed, or that many.

        Without a number of frames, none is drawn while there is nothing new to see, and an
        error is told of in a dialog and goes into the log; two without a frame between end it.
        """
        last = time.perf_counter()
        while not self.window.has_exit and self.frame_count != frame_count:
            pyglet.clock.tick()
            self.window.switch_to()
            now = time.perf_counter()
            elapsed, last = now - last, now
            try:
                self._turn(now, elapsed, may_rest=frame_count is None)
            except Exception as error:
                if frame_count is not None or self._failed:
                    raise
                self._failed, self.last_event = True, time.perf_counter()
                log.exception("an error in the viewer")
                sentence = logs.sentence(error)
                title = "Something went wrong"
                self.questions.dialog = Problem(title, sentence, self.log_file)

    def _turn(self, now, elapsed, may_rest):
        """Handle events, and draw a frame if there is something to see."""
        self.window.dispatch_events()
        if self.closing:
            self.closing = False
            self.questions.leave()
        if self.window.has_exit or (may_rest and self._quiet(now) and not self._rest()):
            return
        self.frame(elapsed)
        self._failed = False
        time.sleep(max(0.0, FRAME_SECONDS - (time.perf_counter() - now)))

    def _rest(self) -> bool:
        """Handle work between frames; returns whether a new frame is needed."""
        before = self.radiance.sample_count
        if self.photographed.busy:
            self.photographed.work()
        elif self.radiance.settled:
            time.sleep(POLL_SECONDS)
        else:
            self.radiance.update(self.controls.camera)
        self.times.rest()
        return self.radiance.sample_count != before

    def _quiet(self, now) -> bool:
        """Whether the next frame would look like the last one."""
        busy = self.controls.tool.busy or self.photographed.busy
        return (
            now - self._drawn_at < (BUSY_SECONDS if busy else REDRAW_SECONDS)
            and now - self.last_event > AWAKE_SECONDS
            and self.radiance.refined == 1.0
            and not self.scene.clock.moving
            and not self.fly.on
            and not self.recorder.screenshot_path
            and self.recorder.video is None
            and not self.takes.recording
        )

    # -- a frame -------------------------------------------------------------------------

    def frame(self, seconds: float, whole: bool = False) -> None:
        """One frame: `seconds` pass; all pixels are rendered at once if `whole`."""
        only_drags = self._only_drags and not self._has_news
        if not only_drags:
            self.opening.follow()
        scene, controls, times = self.scene, self.controls, self.times
        controls.size = size = self.size
        controls.per_point = size[0] / max(self.window.width, 1)
        controls.ratio = controls.per_point * (1.0 if self.gui is None else self.gui.scale)
        if not only_drags:  # else the panels stay where they are
            covered = Covered() if self.panels is None else self.panels.covered()
            controls.covered = controls.panels = covered
        if self.gui is not None and self.gui.mouse_on_panel and not controls.mode:
            controls.leave()
        if self.fly.on:
            self.fly.advance(seconds)
        photograph = None
        if self.photographs is not None:
            photograph, places = call(placed_photograph, self)
        moved, tick = scene.clock.moving, scene.journal.tick
        if not whole and scene.clock.waits:  # time stands, and the window answers
            if self.recorder.message != FITTING:
                self.recorder.say(FITTING)
            time.sleep(WAITING_SECONDS)
            moved = False
        else:
            with times.task("simulate"):
                scene.clock.advance(seconds)
                if controls.finishes:
                    controls.end_if_there()
        if moved:
            times.passed(seconds, scene.journal.tick - tick)
        camera, transparent = controls.camera, scene.settings.transparent_screenshots
        self.radiance.update(
            camera, whole or (transparent and self.recorder.screenshot_path is not None)
        )
        with times.task("draw"):
            self.draw(camera)
            if photograph is not None:
                self.photo_layer.draw(photograph, camera, places, scene.settings)
                clips = clip_range(scene.viewpoint.orbit)
                self._draw_marks(camera, clips)  # strokes can be made on it, too
        built = True
        if self.gui is not None:
            with times.task("panel"):
                built = self._draw_panels()
            with times.task("flip"):
                self.canvas.show()
                self.window.flip()
        if built:
            self._follow()
        times.end_frame()
        self._drawn_at = time.perf_counter()
        ready = self.frame_count == 0
        if self.log.enabled and (ready or self._drawn_at - self._last_state >= STATE_SECONDS):
            self._last_state = self._drawn_at
            self.log("ready" if ready else "state", **state_of(self))
        self.frame_count += 1

    def _follow(self):
        """Go on with what goes beside the object: films, training, questions, files, the title."""
        self.takes.update()
        self.watcher.follow()
        self.questions.follow()
        if self.questions.name:
            self.fly.end()  # which has the keys
        problem = "" if self.autosave is None else self.autosave.update()
        if problem:
            self.recorder.say(problem)
        scene, moves = self.scene, self.controls.mode or self.fly.on
        moves = bool(moves) or scene.timeline.moves_camera
        self.camera_history.note(scene.viewpoint.orbit, moves, time.perf_counter())
        caption = f"deformrf: {readable(scene.name)}{' *' * scene.journal.unsaved}"
        if caption != self._caption:
            self._caption = caption
            self.window.set_caption(caption)

    def draw(self, camera, keep: bool = True) -> None:
        """Draw the object and what belongs to it into the canvas; keep it for files."""
        settings, clips = self.scene.settings, clip_range(self.scene.viewpoint.orbit)
        self.canvas.use(self.size)
        self.radiance.draw(camera, clips)
        beside = self.controls.covered.right * self.controls.ratio * keep
        self.mesh_layer.draw(camera, clips, round(beside))
        keep = keep and (self.recorder.video is not None or self.recorder.screenshot_path)
        if keep and not settings.handles_in_clips:
            self._record_view()
        self._draw_marks(camera, clips)
        if settings.tool != "isolate":  # whose marks they would hide
            self.handle_layer.draw(camera, clips)
        if self.gui is None or settings.task != "bend" or settings.tool in OF_BONES:
            self.bone_layer.draw(camera, clips, self.controls.bones.place)
        if keep and settings.handles_in_clips:
            self._record_view()

    def _draw_marks(self, camera, clips):
        """Draw what goes and stays, and what no photograph saw."""
        seen = self.scene.settings.show_photographed
        for marks in (
            self.controls.tools["isolate"].marks,
            self.photographed.marks(camera) if seen else None,
        ):
            if marks is not None:
                self.mark_layer.draw_marks(camera, clips, marks)

    def _record_view(self):
        """The canvas has the view, and no panel yet: keep it if a video or picture wants it."""
        self.recorder.add_frame()
        settings = self.scene.settings
        if settings.transparent_screenshots and self.recorder.screenshot_path:
            image = without_background(self.radiance.color_image(), settings.background)
            self.recorder.save_screenshot(image)
        elif self.gui is None or not settings.panel_in_screenshots:
            self.recorder.save_screenshot()

    def _draw_panels(self):
        """Draw the panels; whether they were built: some times a second in a plain drag."""
        now, drag = time.perf_counter(), self.controls.held_drag
        plain = drag is not None and drag.is_plain and not self.controls.free
        self._only_drags = plain and not self._has_news
        if self._only_drags and now - self._built_at < PANEL_SECONDS:
            self.gui.show_again()
            return False
        self._has_news, self._built_at = False, now
        settings = self.scene.settings
        self.gui.dress(settings.theme, settings.panel_scale)
        self.gui.begin()
        self.gui.guarded(self.panels.draw)
        self.gui.end()
        if settings.panel_in_screenshots:
            self.recorder.save_screenshot()
        return True

    @property
    def size(self) -> tuple[int, int]:
        """The framebuffer's size in pixels, at least 1 x 1."""
        width, height = self.window.get_framebuffer_size()
        return max(width, 1), max(height, 1)

    def save_session(self) -> None:
        """Write the session into the current folder."""
        if not self.recorder.save_session(self.scene, self.session_start):
            self.saved()

    def save_project(self, path: Path | None = None) -> str:
        """Write a project, by default the one that is open, else one where dialogs begin.

        Returns:
            A sentence if that fails, else an empty string.
        """
        path = path or self.opening.path
        problem = self.recorder.save_project(self.scene, self.session_start, path)
        if not problem:
            self.project = path.absolute()
            self.saved()
            self.preferences.opened(path)
            untold = self.preferences.save()
            if untold:
                self.recorder.say(untold)
        return problem

    def saved(self) -> None:
        """A file has the session now; but for the end of a gesture, if one goes on."""
        if self.controls.mode in ("", "orbit", "pan"):
            self.scene.journal.mark_saved()
            if self.autosave is not None:
                self.autosave.end()

    def end(self) -> None:
        """The loop has ended, or another model follows: unsaved work is kept for another start."""
        for sentence in [] if self.autosave is None else self.autosave.leave():
            self.recorder.say(sentence)

    def close(self) -> None:
        """Finish a video, and give everything back; after an error too."""
        try:
            self.recorder.stop()
            self.takes.close()
            if self.train_job is not None:
                self.train_job.close()
        finally:
            if self.gui is not None:
                self.gui.close()
            if self.scene is not None:
                self.radiance.release()
            self.ctx.release()
            self.window.close()
