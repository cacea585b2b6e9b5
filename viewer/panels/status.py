"""The line along the window's lower edge: what the mouse does, and how things stand."""

from imgui_bundle import imgui

from ..style import accent
from .film import RECORDING_RED, recording_line

BETWEEN = 18.0  # points
SELECTED = (
    "Drag a selected point or the gizmo: all go along.  Click beside: select none.  Wheel: zoom"
)
IN_A_DRAG = {"turn": "turn", "scale": "scale", "pin": "pin it there"}  # keys' actions
HELD_BY = {"pins": "its pins", "weight": "its weight", "wind": "the wind", "colliders": "contact"}


def status_height() -> float:
    """Of the line [points]."""
    return imgui.get_frame_height()


def status_line(scene, controls, times, radiance, fly, takes, recorder, actions) -> None:
    """Draw it into the window that is being built: how fast things are if there is space."""
    sign, state = recording_line(takes, recorder), state_line(scene)
    hint = hint_of(controls, fly, actions)
    if sign:
        imgui.text_colored(RECORDING_RED, sign)
        imgui.same_line(0.0, BETWEEN)
    color = accent(scene.settings.theme)
    if state in ("moving", "still", "playing"):
        color = imgui.get_style_color_vec4(imgui.Col_.text_disabled.value)
    state += f" ({actions.label('pause')}: go on)" * (state == "paused")
    count, fps = len(scene.handles.selected), 1.0 / max(times.frame_seconds(), 1e-6)
    facts = f"   {count} point{'s' * (count != 1)} selected" * bool(count)
    speed = f"   {radiance.refined:.0%} sharp   {fps:.0f} fps"
    at, left = imgui.get_cursor_screen_pos(), imgui.get_cursor_pos_x()
    right, size = imgui.get_window_width() - BETWEEN, imgui.calc_text_size(hint)
    for told in (facts + speed, facts):
        place = right - imgui.calc_text_size(state + told).x
        if left + size.x + BETWEEN <= place:
            break
    end = at.x + place - left - BETWEEN
    if end > at.x:
        low, lines = (min(at.x + size.x, end), at.y + size.y), imgui.get_window_draw_list()
        imgui.internal.render_text_ellipsis(lines, at, low, end, hint, size)
    imgui.dummy((1.0, size.y))
    imgui.same_line(max(place, 1.0))
    imgui.text_colored(color, state)
    imgui.same_line(0.0, 0.0)
    imgui.text_disabled(told)


def hint_of(controls, fly, actions) -> str:
    """What the mouse does now, and while it drags points what keys do."""
    if fly.on:
        return fly.line
    drag, points = controls.held_drag, controls.tool is controls.tools["grab"]
    if drag is not None:
        told = IN_A_DRAG | {drag.kind: "move again"} if points else {}
        keys = [f"{actions.label(name)}: {told[name]}" for name in IN_A_DRAG if name in told]
        return "   ".join([drag.line, *keys])
    hint = SELECTED if points and controls.scene.handles.selected else controls.tool.hint
    return f"{controls.tool.word}: {hint}"


def state_line(scene) -> str:
    """What the object does."""
    rescue, clock = scene.solver.rescue, scene.clock
    if rescue.running or rescue.given_up:
        return "rescuing ..." if rescue.running else "tangled: take Original shape"
    if rescue.held_by:
        return f"folded by {HELD_BY[rescue.held_by]}"
    if scene.timeline.shows_poses or scene.posing.playing:
        return "playing"
    return "paused" if clock.paused else "moving" if clock.moving else "still"


def pause_line(scene, actions) -> str:
    """What the view says while time stands still, of bending too; else empty."""
    follows = "; what you bend follows then" * (scene.settings.hand == "physics")
    follows = "; time does, too, when you bend" if scene.timeline.stands else follows
    return f"paused: {actions.label('pause')} goes on{follows}" * (state_line(scene) == "paused")
