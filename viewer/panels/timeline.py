"""The task *Animate*: the timeline's strip along the lower edge, and saved poses."""

from functools import cache, partial

from imgui_bundle import imgui, imgui_ctx

from ..document import (
    EASINGS,
    MOTIONS,
    TICKS_PER_SECOND,
    TRACKS,
    WEIGHTS,
    TimeScale,
    as_time,
    shown_ticks,
)
from . import widgets as w
from .rig import clips_panel

STRIP_HEIGHT = 144.0
RULER, LANE = 20.0, 22.0  # heights
NAMES = 70.0  # the width of the tracks' names
KEY = 7.0  # from a key's middle to its corners
GAP = 13.0  # between groups of buttons
CLOSE_WIDTH = 62.0  # from the right edge to the button that closes it
WIDE = 800.0  # of a strip with space for whole words
STEPS = """1  Let what you bend stay (top right), or pose bones; turn the view. Key both: {key}.
2  Move the red line, and make the next key.
3  Play timeline: {play}. Turntable ({turn}): the camera goes around the object."""
MOTION = """between pose keys: interpolation moves all vertices straight from one to the next;
physics moves what the keys hold, pinned or by the mouse, and the rest follows;
between poses of bones, bones turn, and softness says what follows them"""
EASING = "on the way from this key to the next one"
HINT = "{} sets a key at the playhead. Drag keys to move them, with Ctrl to copy them."
GRAYS = {  # ruler, lanes, lines, text, a key's edge, a chosen key's, what is beyond the end
    "dark": (0.21, 0.17, 0.35, 0.65, 0.12, 1.0, 0.12),
    "light": (0.89, 0.94, 0.85, 0.38, 1.0, 0.0, 0.98),
}
COLORS = {
    "head": (0.95, 0.35, 0.25, 1.0),
    "camera": (0.33, 0.57, 0.90, 1.0),
    "pose": (0.95, 0.62, 0.18, 1.0),
}


def timeline_strip(timeline, strip, settings, actions, say):
    _buttons(timeline, strip, actions)
    _tracks(timeline, strip, settings.theme, say)
    _chosen_key(timeline, strip, actions)
    imgui.same_line()
    imgui.set_cursor_pos_x(max(imgui.get_cursor_pos_x(), imgui.get_window_width() - CLOSE_WIDTH))
    w.button(actions, "toggle_timeline", "Close")


def _buttons(timeline, strip, actions):
    is_wide = imgui.get_content_region_avail().x >= WIDE
    w.button(actions, "play", "" if is_wide else actions.title("play").partition(" ")[0])
    imgui.same_line()
    imgui.text(f"{as_time(timeline.head)} / {as_time(timeline.end)}")
    imgui.same_line(0.0, w.APART)
    w.buttons(actions, "toggle_loop")
    for name, gap in (("key", GAP), ("key_camera", -1.0), ("key_pose", -1.0), ("turntable", GAP)):
        imgui.same_line(0.0, gap)
        w.button(actions, name)
    imgui.same_line()
    imgui.set_next_item_width(84.0 if is_wide else 58.0)
    turn, text = w.of(strip, "turn_seconds"), "%.0f s" + " a turn" * is_wide
    w.slider("##turn", *turn, (1.0, 60.0), text, tooltip="how long a turn takes")
    imgui.same_line(0.0, GAP)
    imgui.set_next_item_width(110.0)
    w.combo("##motion", timeline.motion, timeline.set_motion, MOTIONS, MOTION)


# -- the tracks --------------------------------------------------------------------------------


def _tracks(timeline, strip, theme, say):
    at, width = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail().x
    imgui.invisible_button("tracks", (max(width, 1.0), RULER + LANE * len(TRACKS)))
    if not strip.holds:  # while something is dragged, its ground stays
        right = max(width - NAMES - 2.0 * KEY, 1.0)
        strip.scale = TimeScale(at.x + NAMES, right, shown_ticks(timeline))
    mouse = imgui.get_io().mouse_pos
    if imgui.is_item_activated():
        row = int((mouse.y - at.y - RULER) // LANE)
        on_track = mouse.y >= at.y + RULER and row < len(TRACKS)
        strip.press(timeline, TRACKS[row] if on_track else None, mouse.x)
    elif imgui.is_item_active() and strip.holds:
        strip.drag(timeline, mouse.x)
    if imgui.is_item_deactivated():
        problem = strip.drop(timeline, imgui.get_io().key_ctrl)
        if problem:
            say(problem)
    _draw_tracks(timeline, strip, theme, at, width)


@cache
def _colors(theme):
    names = "ruler", "lane", "line", "text", "edge", "chosen", "beyond"
    grays = {n: (g, g, g, 1.0) for n, g in zip(names, GRAYS[theme], strict=True)}
    grays["beyond"] = (*grays["beyond"][:3], 0.5)
    return {name: imgui.get_color_u32(c) for name, c in (grays | COLORS).items()}


def _draw_tracks(timeline, strip, theme, at, width):
    draw, scale, color = imgui.get_window_draw_list(), strip.scale, _colors(theme)
    right, bottom = at.x + width, at.y + RULER + LANE * len(TRACKS)
    draw.push_clip_rect((at.x, at.y), (right, bottom), True)
    _draw_ruler(timeline, scale, draw, color, at, right, bottom)
    chosen = strip.chosen(timeline)
    for row, track in enumerate(TRACKS):
        y = at.y + RULER + LANE * (row + 0.5)
        draw.add_line((at.x, y + 0.5 * LANE), (right, y + 0.5 * LANE), color["line"])
        draw.add_text((at.x + 8.0, y - 8.0), color["text"], track)
        keys = timeline.keys[track]
        if len(keys) > 1:
            ends = (scale.place(keys[0].tick), y), (scale.place(keys[-1].tick), y)
            draw.add_line(*ends, color[track], 1.5)
        for key in keys:
            one = track, key.tick
            dragged = strip.holds == "key" and strip.selected == one
            x = scale.place(strip.to_tick if dragged else key.tick)
            _diamond(draw, x, y, color[track], color["chosen" if chosen == one else "edge"])
    x = scale.place(timeline.head)
    draw.add_line((x, at.y + 6.0), (x, bottom), color["head"], 2.0)
    draw.add_triangle_filled((x - 6.0, at.y), (x + 6.0, at.y), (x, at.y + 9.0), color["head"])
    draw.pop_clip_rect()


def _draw_ruler(timeline, scale, draw, color, at, right, bottom):
    """Seconds, and the lanes below them; what is beyond the film's end is faint."""
    draw.add_rect_filled((at.x, at.y), (right, at.y + RULER), color["ruler"], 4.0)
    draw.add_rect_filled((at.x, at.y + RULER), (right, bottom), color["lane"], 4.0)
    step = scale.step * TICKS_PER_SECOND
    for number in range(int(scale.ticks / step + 1e-6) + 1):
        x = scale.place(number * step)
        draw.add_line((x, at.y + 13.0), (x, bottom), color["line"])
        draw.add_text((x + 3.0, at.y + 1.0), color["text"], f"{number * scale.step:g}")
    if timeline.end:
        end = scale.place(timeline.end)
        draw.add_rect_filled((end, at.y), (right, bottom), color["beyond"])


def _diamond(draw, x, y, fill, edge):
    corners = (x, y - KEY), (x + KEY, y), (x, y + KEY), (x - KEY, y)
    draw.add_quad_filled(*corners, fill)
    draw.add_quad(*corners, edge, 1.5)


def _chosen_key(timeline, strip, actions):
    chosen = strip.chosen(timeline)
    if chosen is None:
        imgui.align_text_to_frame_padding()
        imgui.text_disabled(HINT.format(actions.label("key")))
        return
    track, tick = chosen
    (key,) = (key for key in timeline.keys[track] if key.tick == tick)
    imgui.align_text_to_frame_padding()
    imgui.text_disabled(f"{track} at {as_time(tick)}")
    imgui.same_line()
    imgui.set_next_item_width(88.0)
    change = partial(timeline.ease_key, track, tick)
    w.combo("##easing", key.easing, change, list(EASINGS), EASING)
    for name in ("copy_key", "delete_key"):
        imgui.same_line()
        w.button(actions, name)


# -- saved poses -------------------------------------------------------------------------------


def animate_panel(timeline, strip, rigging, posing, actions):
    """Keys in a few words, clips, and saved poses."""
    key, play, turn = (actions.label(name) for name in ("key", "play", "turntable"))
    imgui.text_wrapped(STEPS.format(key=key, play=play, turn=turn))
    w.buttons(actions, "toggle_timeline")
    if w.section("Clips of bones", bool(rigging.clips)):
        clips_panel(rigging, posing, strip, actions)
    if w.section("Saved poses", bool(timeline.poses)):
        _poses(timeline, strip, actions)


def _poses(timeline, strip, actions):
    strip.pose_name = w.text_field("##pose", strip.pose_name, "a name", width=150.0)
    imgui.same_line()
    w.button(actions, "save_pose")
    for pose in timeline.poses:
        with imgui_ctx.push_id(pose.name):
            w.delete_button(timeline.delete_pose, pose.name)
            imgui.same_line()
            change = partial(timeline.blend_pose, pose.name)
            w.slider(pose.name, pose.weight, change, WEIGHTS, "%.2f", tooltip="how much of it")
    if timeline.poses:
        imgui.text_disabled("what they differ by from the rest shape")
