"""App: the window, what is drawn in it, and the loop of frames.

A frame lets time pass in the scene, renders the field if anything changed, draws it and
the control vertices into the canvas, the panels on top, and shows the canvas.  Without a
display the same frames go into files.
"""

import time
from concurrent.futures import ThreadPoolExecutor

import pyglet

from ..core.render.render import Renderer
from . import orbit as orbits
from . import script
from .actions import Actions
from .capture import Capture
from .controls import Controls
from .events import state_of
from .gl import Canvas
from .handlers import Handlers
from .mesh_layer import MeshLayer
from .radiance_layer import RadianceLayer
from .scene import Scene
from .status import Status
from .surface import visible_points
from .upload import choose_path

ACTIVE_SECONDS, IDLE_SECONDS = 1.0 / 60.0, 1.0 / 30.0  # shortest frame, where vsync sets none
STATE_SECONDS = 0.5  # between two "state" events in the log


class App:
    """A window onto one model.

    Attributes:
        scene: Set by `load`.
        actions: What keys and buttons do, set by `load`.
    """

    def __init__(self, window, ctx, log, gui: bool = True):
        """Take a window and its context, register for its events, and add panels if wanted."""
        self.window, self.ctx, self.log = window, ctx, log
        self.scene = None
        self.status = Status(gl_renderer=ctx.info["GL_RENDERER"])
        self.canvas = Canvas(ctx)
        self.capture = Capture(self.canvas, self.status, log)
        self._frame_count = 0
        self._last_state = 0.0
        self.handlers = Handlers(self)
        window.push_handlers(self.handlers)
        self.gui = None
        if gui:
            from .gui import Gui

            self.gui = Gui(window)  # pushed last, asked first

    # -- start ---------------------------------------------------------------------------

    def load(self, field, name: str, device: str, interop: str = "auto", fps: int = 30) -> None:
        """Show a model; compiles the kernels and therefore may take a while.

        Raises:
            ValueError: interop is "buffer", and CUDA and OpenGL share no buffers.
        """
        import warp as wp

        self.status.device = wp.get_device(device).name
        self.status.interop = choose_path(self.ctx, device, interop)
        if self.gui is None:
            scene, renderer = _prepare(field, name, device)
        else:
            with ThreadPoolExecutor(1) as pool:
                preparing = pool.submit(_prepare, field, name, device)
                while not preparing.done():
                    self._splash(f"{name}: preparing; compiling kernels takes a while once")
                scene, renderer = preparing.result()
        self.radiance = RadianceLayer(self.ctx, renderer, device, self.status.interop)
        self.mesh = MeshLayer(self.ctx, scene)
        self.controls = Controls(scene, self.radiance.depth_image, self.log)
        self.actions = Actions(
            scene, self.controls, self.capture, self.status, fps, self._request_close
        )
        self.scene = scene

    def _splash(self, text):
        from .panels.layout import show_message

        self.window.switch_to()
        self.window.dispatch_events()
        self.canvas.use(self.size)
        self.ctx.clear(0.94, 0.94, 0.95, 1.0)
        self.gui.begin()
        show_message(text, centered=True)
        self.gui.end()
        self.canvas.show(self.size)
        self.window.flip()
        time.sleep(0.05)

    # -- loops ---------------------------------------------------------------------------

    def run(self, frame_count: int | None = None) -> None:
        """Show frames until the window is closed, or that many."""
        last = time.perf_counter()
        while not self.window.has_exit and self._frame_count != frame_count:
            pyglet.clock.tick()
            self.window.switch_to()
            self.window.dispatch_events()
            if self.window.has_exit:
                break
            now = time.perf_counter()
            self.frame(now - last)
            last = now
            idle = not self.scene.moving and self.radiance.refined == 1.0
            idle = idle and now - self.handlers.last_event > 1.0 and self.status.recorder is None
            shortest = IDLE_SECONDS if idle else ACTIVE_SECONDS
            time.sleep(max(0.0, shortest - (time.perf_counter() - now)))

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
        self.radiance.update(scene, camera, times, whole)
        self.status.resolution = self.radiance.factor
        self.status.refined = self.radiance.refined
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
        self._frame_count += 1

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
        if self.gui is None or not self.scene.settings.panel_in_screenshots:
            self.capture.save_screenshot()

    def _draw_panels(self):
        if self.gui is None:
            return
        from .panels.layout import draw_panels

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
        ready = self._frame_count == 0
        if not self.log.enabled or (now - self._last_state < STATE_SECONDS and not ready):
            return
        self._last_state = now
        self.log("ready" if ready else "state", **state_of(self))


def _prepare(field, name, device):
    """Scene and renderer, every kernel compiled."""
    rest = field.mesh.rest_vertices
    renderer = Renderer(field, device)
    renderer.set_vertices(rest)
    scene = Scene(field, name, device, visible_points(renderer, rest))
    scene.warm_up()
    return scene, renderer
