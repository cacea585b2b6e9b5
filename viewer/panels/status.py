"""The line along the window's lower edge: what the mouse does, and how things stand."""

from imgui_bundle import imgui

from .bend import state_line
from .film import RECORDING_RED, recording_line

BETWEEN = 18.0  # points


def status_height() -> float:
    """Of the line [points]."""
    return imgui.get_frame_height()


def status_line(
    controls, clock, solver, handles, times, radiance, fly, takes, recorder, actions
) -> None:
    """Draw it into the window that is being built."""
    right = _facts(clock, solver, handles, times, radiance, actions.label("pause"))
    width = imgui.calc_text_size(right).x
    sign = recording_line(takes, recorder)
    if sign:
        imgui.text_colored(RECORDING_RED, sign)
        imgui.same_line(0.0, BETWEEN)
    corner, whole = imgui.get_cursor_screen_pos(), imgui.get_window_width()
    end = imgui.get_window_pos().x + whole - width - 2.0 * BETWEEN
    hint = hint_of(controls, fly)
    size, lines = imgui.calc_text_size(hint), imgui.get_window_draw_list()
    if end > corner.x:
        low = corner.x + min(size.x, end - corner.x), corner.y + size.y
        imgui.internal.render_text_ellipsis(lines, corner, low, end, hint, size)
    imgui.dummy((1.0, size.y))
    imgui.same_line(max(whole - width - BETWEEN, 1.0))
    imgui.text_disabled(right)


def hint_of(controls, fly) -> str:
    """What the mouse does now."""
    if fly.on:
        return fly.line
    if controls.held_drag is not None:
        return controls.held_drag.line
    return f"{controls.tool.word}: {controls.tool.hint}"


def _facts(clock, solver, handles, times, radiance, key):
    fps, state = 1.0 / max(times.frame_seconds(), 1e-6), state_line(clock, solver)
    facts = [
        state + f" ({key}: go on)" * (state == "paused"),
        f"{radiance.refined:.0%} sharp",
        f"{fps:.0f} fps",
    ]
    count = len(handles.selected)
    if count:
        facts.insert(0, f"{count} point{'s' * (count != 1)} selected")
    return "   ".join(facts)
