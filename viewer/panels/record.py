"""Screenshots and clips."""

from imgui_bundle import imgui

from ..controls import label_of

RECORDING_RED = (0.80, 0.10, 0.10, 1.0)


def record_panel(scene, actions, status):
    settings, recorder = scene.settings, status.recorder
    if imgui.button("Screenshot"):
        actions.screenshot()
    imgui.set_item_tooltip(label_of("screenshot"))
    imgui.same_line()
    if imgui.button("Stop recording" if recorder else "Record"):
        actions.record()
    imgui.set_item_tooltip(label_of("record"))
    if recorder:
        imgui.text_colored(RECORDING_RED, f"{recorder.seconds:.1f} s")
        imgui.same_line()
        imgui.text(
            f"{recorder.frame_count} frames, {recorder.repeated_count} repeated, "
            f"{recorder.dropped_count} left out"
        )
    changed, wanted = imgui.checkbox(
        "transparent screenshots of the field alone", settings.transparent_screenshots
    )
    if changed:
        settings.transparent_screenshots = wanted
    changed, wanted = imgui.checkbox("vertices in clips and screenshots", settings.handles_in_clips)
    if changed:
        settings.handles_in_clips = wanted
    changed, wanted = imgui.checkbox("panel in screenshots", settings.panel_in_screenshots)
    if changed:
        settings.panel_in_screenshots = wanted
