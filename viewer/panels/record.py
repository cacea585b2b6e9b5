"""Screenshots and videos."""

from imgui_bundle import imgui

from ..actions import label_of
from .widgets import button, setting

RECORDING_RED = (0.80, 0.10, 0.10, 1.0)


def record_panel(app):
    settings, video = app.scene.settings, app.recorder.video
    button("Screenshot", app, "screenshot", label_of("screenshot"))
    imgui.same_line()
    button("Stop recording" if video else "Record", app, "record", label_of("record"))
    if video:
        imgui.text_colored(RECORDING_RED, f"{video.seconds:.1f} s")
        imgui.same_line()
        imgui.text(
            f"{video.frame_count} frames, {video.repeated_count} repeated, "
            f"{video.dropped_count} left out"
        )
    setting("transparent screenshots of the field alone", settings, "transparent_screenshots")
    setting("vertices in clips and screenshots", settings, "handles_in_clips")
    setting("panel in screenshots", settings, "panel_in_screenshots")
