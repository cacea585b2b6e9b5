"""Times of a frame, and the devices in use."""

import numpy as np
from imgui_bundle import imgui

from .widgets import setting

STAGES_TOOLTIP = """of the last image or strip; measuring waits after each stage and so takes time,
and on the CPU the times of all threads are added up"""


def stats_panel(app):
    times, settings = app.times, app.scene.settings
    mean = times.frame_seconds()
    imgui.text(f"{1e3 * mean:.1f} ms a frame, {1.0 / max(mean, 1e-6):.0f} frames a second")
    frames = 1e3 * np.array(times.frames, np.float32)
    imgui.plot_lines("##frames", frames, scale_min=0.0, graph_size=(-1.0, 40.0))
    _rows(times.medians())
    setting("stages of rendering", settings, "time_rendering", STAGES_TOOLTIP)
    if settings.time_rendering:
        _rows(times.rendering)
    imgui.text_disabled(f"renders on {app.radiance.device.name}")
    imgui.text_disabled(f"draws on {app.ctx.info['GL_RENDERER']}")
    imgui.text_disabled(f"frames go by {app.radiance.path}")


def _rows(seconds_of):
    for name, seconds in seconds_of.items():
        imgui.text_disabled(name)
        imgui.same_line(100.0)
        imgui.text(f"{1e3 * seconds:.2f} ms")
