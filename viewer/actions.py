"""What keys and buttons do; one method each, named in controls.INPUTS."""

from ..core.render import MODES


class Actions:
    """The user's commands to one App."""

    def __init__(self, scene, controls, capture, status, fps: int, close):
        self._scene, self._controls = scene, controls
        self._capture, self._status = capture, status
        self._fps = fps
        self._close = close

    def focus(self):
        self._scene.focus()

    def home(self):
        self._scene.home()

    def reset(self):
        self._controls.cancel()
        self._scene.reset()

    def pause(self):
        self._scene.paused = not self._scene.paused

    def single_step(self):
        self._scene.single_step()

    def next_mode(self):
        settings = self._scene.settings
        settings.mode = MODES[(MODES.index(settings.mode) + 1) % len(MODES)]

    def toggle_handles(self):
        self._toggle("show_handles")
        self._scene.hover = None

    def toggle_wireframe(self):
        self._toggle("show_wireframe")

    def toggle_panel(self):
        self._toggle("show_panel")

    def toggle_help(self):
        self._toggle("show_help")

    def screenshot(self):
        self._capture.screenshot()

    def record(self):
        """Start a clip, or finish the one that is being recorded."""
        if self._status.recorder is None:
            self._capture.start(self._fps)
        else:
            self._capture.stop()

    def cancel(self):
        self._controls.cancel()

    def quit(self):
        self._close()

    def _toggle(self, setting):
        settings = self._scene.settings
        setattr(settings, setting, not getattr(settings, setting))
