"""The task *Film*: pictures, recordings, films."""

from functools import partial

from imgui_bundle import imgui

from .widgets import beside, button, checkbox, setting

RECORDING_RED = (0.95, 0.25, 0.20, 1.0)
RECORD_TOOLTIP = """marks a part of what you do,
of which a film is rendered afterwards, in full quality"""
GUIDE = "what a film of the chosen size shows of the view"
CLIP_TOOLTIP = "a video of the view as it shows, coarse while things move"


def filming_panel(settings, takes, recorder, actions):
    label = "Stop recording" if takes.recording else "Record what I do"
    button(label, actions, "record", RECORD_TOOLTIP)
    beside("Make a film...")
    button(
        "Make a film...", actions, "save_film", "of the timeline, of what was recorded, or a turn"
    )
    beside("Save a picture")
    button("Save a picture", actions, "screenshot", "of the view, into the current folder")
    video = recorder.video
    label = "Stop the clip" if video else "Record the screen"
    button(label, actions, "record_screen", CLIP_TOOLTIP)
    if recording_line(takes, recorder):
        imgui.text_colored(RECORDING_RED, recording_line(takes, recorder))
    if video:
        imgui.text(
            f"{video.frame_count} frames, {video.repeated_count} repeated, "
            f"{video.dropped_count} left out"
        )
    checkbox("frame guide", takes.shows_frame, partial(setattr, takes, "shows_frame"), GUIDE)
    setting("pictures without background", settings, "transparent_screenshots")
    setting("red points in clips and pictures", settings, "handles_in_clips")
    setting("panels in pictures", settings, "panel_in_screenshots")


def recording_line(takes, recorder) -> str:
    """What is being recorded, and how long; empty if nothing."""
    lines = [f"recording, {takes.seconds:.1f} s"] if takes.recording else []
    if recorder.video:
        lines.append(f"clip of the screen, {recorder.video.seconds:.1f} s")
    return "; ".join(lines)
