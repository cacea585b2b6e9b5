"""Where the time goes, and on what."""

import numpy as np
from imgui_bundle import imgui

STAGES_TOOLTIP = """of the last image or strip; measuring waits after each stage and so takes time,
and on the CPU the times of all threads are added up"""


def stats_panel(scene, actions, status):
    frames = np.array(status.times.frames, np.float32)
    mean = status.times.frame_seconds()
    imgui.text(f"{1e3 * mean:.1f} ms a frame, {1.0 / max(mean, 1e-6):.0f} frames a second")
    imgui.plot_lines("##frames", 1e3 * frames, scale_min=0.0, graph_size=(-1.0, 40.0))
    for name, seconds in status.times.medians().items():
        _row(name, seconds)
    settings = scene.settings
    changed, wanted = imgui.checkbox("stages of rendering", settings.time_rendering)
    imgui.set_item_tooltip(STAGES_TOOLTIP)
    if changed:
        settings.time_rendering = wanted
    if settings.time_rendering:
        for name, seconds in status.times.rendering.items():
            _row(name, seconds)
    imgui.text_disabled(f"renders on {status.device}")
    imgui.text_disabled(f"draws on {status.gl_renderer}")
    imgui.text_disabled(f"frames go by {status.interop}")


def _row(name, seconds):
    imgui.text_disabled(name)
    imgui.same_line(100.0)
    imgui.text(f"{1e3 * seconds:.2f} ms")
