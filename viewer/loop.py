"""App: the window, what is drawn in it, and the loop of frames.

A frame lets time pass in the scene, renders the field if anything changed, draws it and
the control vertices into the canvas, the panels on top, and shows the canvas.  Without a
display the same frames go into files.
"""

import time
from concurrent.futures import ThreadPoolExecutor

import pyglet

from . import orbit as orbits
from . import script
from .actions import Actions
from .capture import Capture
from .controls import Controls
from .events import state_of
from .gl import Canvas
from .handlers import Activity, Handlers
from .loading import Progress, kernel_modules, prepare
from .mesh_layer import MeshLayer
from .radiance_layer import RadianceLayer
from .recorder import without_background
from .status import Status
from .upload import choose_path

FRAME_SECONDS = 1.0 / 60.0  # the shortest frame, where vsync sets none
AWAKE_SECONDS = 1.0  # of frames after an event: panels answer over several of them
POLL_SECONDS = 1.0 / 30.0  # between two looks for events at rest
REDRAW_SECONDS = 0.5  # between two frames at rest, for messages that go and curves that grow
STATE_SECONDS = 0.5  # between two "state" events in the log


class App:
    """A window onto one model.

    Attributes:
        scene: Set by `load`.
        actions: What keys and buttons do, set by `load`.
        frame_count: Frames drawn so far.
    """

    def __init__(self, window, ctx, log, gui: bool = True):
        """Take a window and its context, register for its events, and add panels if wanted."""
        self.window, self.ctx, self.log = window, ctx, log
        self.scene = None
        self.status = Status(gl_renderer=ctx.info["GL_RENDERER"])
        self.canvas = Canvas(ctx)
        self.capture = Capture(self.canvas, self.status, log)
        self.frame_count = 0
        self._last_state = 0.0
        self.handlers = Handlers(self)
        window.push_handlers(self.handlers)
        self.gui = None
        if gui:
            from .gui import Gui

            self.gui = Gui(window)  # pushed after the view's, asked before it
        self.activity = Activity(window)
        self._drawn_at = 0.0

    # -- start ---------------------------------------------------------------------------

    def load(self, field, name: str, device: str, interop: str = "auto", fps: int = 30) -> None:
        """Show a model; compiles the kernels and therefore may take a while.

        Raises:
            ValueError: interop is "buffer", and CUDA and OpenGL share no buffers.
        """
        import warp as wp

        self.status.device = wp.get_device(device).name
        self.status.interop = choose_path(self.ctx, device, interop)
        progress = Progress(kernel_modules(device))
        if self.gui is None:
            scene, renderer = prepare(field, name, device, progress)
        else:
            with ThreadPoolExecutor(1) as pool:
                preparing = pool.submit(prepare, field, name, device, progress)
                while not preparing.done():
                    self._splash(f"preparing {name}", progress)
                scene, renderer = preparing.result()
        self.radiance = RadianceLayer(self.ctx, renderer, device, self.status.interop)
        self.mesh = MeshLayer(self.ctx, scene)
        self.controls = Controls(scene, self.radiance.depth_image, self.log)
        self.actions = Actions(
            scene, self.controls, self.capture, self.status, fps, self._request_close
        )
        self.scene = scene

    def _splash(self, title, progress):
        from .panels import loading_window

        self.window.switch_to()
        self.window.dispatch_events()
        self.canvas.use(self.size)
        self.ctx.clear(0.94, 0.94, 0.95, 1.0)
        self.gui.begin()
        loading_window(title, progress)
        self.gui.end()
        self.canvas.show(self.size)
        self.window.flip()
        time.sleep(0.05)

    # -- loops ---------------------------------------------------------------------------

    def run(self, frame_count: int | None = None) -> None:
        """Show frames until the window is closed, or that many.

        Without a number of frames, none is drawn while there is nothing new to see.
        """
        last = time.perf_counter()
        while not self.window.has_exit and self.frame_count != frame_count:
            pyglet.clock.tick()
            self.window.switch_to()
            self.window.dispatch_events()
            if self.window.has_exit:
                break
            now = time.perf_counter()
            elapsed, last = now - last, now
            if frame_count is None and self._quiet(now) and not self._rest():
                continue
            self.frame(elapsed)
            time.sleep(max(0.0, FRAME_SECONDS - (time.perf_counter() - now)))

    def _rest(self) -> bool:
        """Do what there is to do without a frame; whether it is to be seen in one."""
        times, radiance = self.status.times, self.radiance
        before = radiance.sample_count
        if radiance.settled:
            time.sleep(POLL_SECONDS)
        else:
            radiance.update(self.scene, self.controls.camera, times)
        times.rest()
        return radiance.sample_count != before

    def _quiet(self, now) -> bool:
        """Whether the next frame would look like the last one."""
        return (
            now - self._drawn_at < REDRAW_SECONDS
            and now - self.activity.last_event > AWAKE_SECONDS
            and self.radiance.refined == 1.0
            and not self.scene.moving
            and not self.capture.wants_screenshot
            and self.status.recorder is None
        )

    def run_offline(self, frame_count: int, fps: int, drag=None, screenshot=None):
        """Render frames one after another, each in full; yields the number of each.

        The screenshot shows the last frame, or the last one before a drag is let go.
        """
        shot = frame_count - 1 if drag is None else script.hold_ends(frame_count) - 1
        for number in range(frame_count):
            if drag is not None:
                script.play(drag, self.scene, number, frame_count)
            if screenshot is not None and number == shot:
                self.capture.screenshot(screenshot)
            self.window.switch_to()
            self.frame(1.0 / fps, whole=True)
            yield number

    def frame(self, seconds: float, whole: bool = False) -> None:
        """One frame: `seconds` pass; all pixels are rendered at once if `whole`."""
        scene, times = self.scene, self.status.times
        size = self.size
        self.controls.size = size
        self.controls.ratio = size[0] / max(self.window.width, 1)
        if self.gui is not None and self.gui.mouse_on_panel and not self.controls.mode:
            scene.hover = None
        with times.stage("simulate"):
            scene.advance(seconds)
        camera = self.controls.camera
        self.radiance.update(scene, camera, times, whole or self._wants_transparent)
        self._report()
        with times.stage("draw"):
            self._draw(camera, size)
        with times.stage("panel"):
            self._draw_panels()
        with times.stage("flip"):
            if self.gui is not None:
                self.canvas.show(size)
                self.window.flip()
        times.end_frame()
        self._log_state()
        self.frame_count += 1
        self._drawn_at = time.perf_counter()

    def _report(self):
        status, radiance = self.status, self.radiance
        status.resolution, status.refined = radiance.factor, radiance.refined
        status.sample_count, status.most_samples = radiance.sample_count, radiance.most_samples
        status.saved = ", ".join(
            {"step_factor": f"steps × {value}", "level_count": f"{value} levels"}[name]
            for name, value in radiance.cheaper.items()
        )

    def _draw(self, camera, size):
        clip_range = orbits.clip_range(self.scene.orbit)
        self.canvas.use(size)
        self.radiance.draw(camera, clip_range)
        if not self.scene.settings.handles_in_clips:
            self._capture_view()
        self.mesh.draw(self.scene, camera, clip_range)
        if self.scene.settings.handles_in_clips:
            self._capture_view()

    def _capture_view(self):
        self.capture.view_drawn()
        if self._wants_transparent:
            image, background = self.radiance.color_image(), self.scene.settings.background
            self.capture.save_screenshot(without_background(image, background))
        elif self.gui is None or not self.scene.settings.panel_in_screenshots:
            self.capture.save_screenshot()

    @property
    def _wants_transparent(self):
        return self.capture.wants_screenshot and self.scene.settings.transparent_screenshots

    def _draw_panels(self):
        if self.gui is None:
            return
        from .panels import draw_panels

        self.gui.begin()
        draw_panels(self.gui, self.scene, self.actions, self.status)
        self.gui.end()
        if self.scene.settings.panel_in_screenshots:
            self.capture.save_screenshot()

    def close(self) -> None:
        """Finish a clip, and give everything back."""
        try:
            self.capture.stop()
        finally:
            if self.gui is not None:
                self.gui.close()
            if self.scene is not None:
                self.radiance.release()
            self.ctx.release()
            self.window.close()

    def _request_close(self):
        self.window.has_exit = True

    @property
    def size(self) -> tuple[int, int]:
        """The framebuffer's size in pixels, at least 1 x 1."""
        width, height = self.window.get_framebuffer_size()
        return max(width, 1), max(height, 1)

    def _log_state(self):
        now = time.perf_counter()
        ready = self.frame_count == 0
        if not self.log.enabled or (now - self._last_state < STATE_SECONDS and not ready):
            return
        self._last_state = now
        self.log("ready" if ready else "state", **state_of(self))
