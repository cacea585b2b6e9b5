"""The timeline's strip along the window's lower edge, and the section on saved poses."""

from functools import partial

from imgui_bundle import imgui

from ..document import (
    EASINGS,
    LONGEST,
    MOTIONS,
    TICKS_PER_SECOND,
    TRACKS,
    WEIGHTS,
    TimeScale,
    as_time,
    shown_ticks,
)
from ..input import delete_key
from .widgets import button, checkbox, combo, slider, with_key

STRIP_HEIGHT = 144.0
RULER, LANE = 20.0, 22.0  # heights
NAMES = 70.0  # the width of the tracks' names
KEY = 7.0  # from a key's middle to its corners
GAP = 13.0  # between groups of buttons
TURNS = 1.0, 60.0  # s
MOTION = """between pose keys: interpolation moves all vertices straight from one to the next;
physics moves what the keys hold, pinned or by the mouse, and the rest follows;
between poses of bones, bones turn, and softness says what follows them"""
EASING = "on the way from this key to the next one"
HINT = "{} sets a key at the playhead. Drag keys to move them, with Ctrl to copy them."
STANDS = "Time stands still at this pose. A drag or {} lets it go on; {} keys what you make of it."
COLORS = {
    "ruler": (0.88, 0.89, 0.91, 1.0),
    "lane": (0.93, 0.93, 0.95, 1.0),
    "line": (0.0, 0.0, 0.0, 0.10),
    "text": (0.38, 0.39, 0.42, 1.0),
    "head": (0.80, 0.16, 0.13, 1.0),
    "camera": (0.20, 0.42, 0.70, 1.0),
    "pose": (0.86, 0.50, 0.10, 1.0),
    "edge": (1.0, 1.0, 1.0, 1.0),
    "chosen": (0.0, 0.0, 0.0, 0.9),
}


def timeline_strip(app):
    _buttons(app)
    _tracks(app)
    _chosen_key(app)


def _buttons(app):
    timeline = app.scene.timeline
    button("Stop" if timeline.playing else "Play", app, "play")
    imgui.same_line()
    checkbox("loop", timeline.loop, timeline.set_loop, "play again and again")
    imgui.same_line()
    imgui.text(f"{as_time(timeline.head)} / {as_time(timeline.end)}")
    imgui.same_line(0.0, GAP)
    button("Key", app, "key", "camera and pose at the playhead")
    imgui.same_line()
    button("Camera", app, "key_camera", "key the camera alone")
    imgui.same_line()
    button("Pose", app, "key_pose", "key the pose alone")
    imgui.same_line(0.0, GAP)
    button("Turntable", app, "turntable", "camera keys around what it looks at, in a loop")
    imgui.same_line()
    imgui.set_next_item_width(58.0)
    slider(
        "##turn",
        app.strip.turn_seconds,
        TURNS,
        "%.0f s",
        partial(setattr, app.strip, "turn_seconds"),
        tooltip="of a turn",
    )
    imgui.same_line(0.0, GAP)
    imgui.set_next_item_width(110.0)
    combo("##motion", timeline.motion, MOTIONS, timeline.set_motion, MOTION)


# -- the tracks --------------------------------------------------------------------------------


def _tracks(app):
    timeline, strip = app.scene.timeline, app.strip
    at, width = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail().x
    imgui.invisible_button("tracks", (max(width, 1.0), RULER + LANE * len(TRACKS)))
    if not strip.holds:  # while something is dragged, its ground stays
        ticks = min(shown_ticks(timeline), LONGEST)
        strip.scale = TimeScale(at.x + NAMES, max(width - NAMES - 2.0 * KEY, 1.0), ticks)
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
            app.recorder.say(problem)
    _draw_tracks(app, at, width)


def _draw_tracks(app, at, width):
    timeline, strip, draw = app.scene.timeline, app.strip, imgui.get_window_draw_list()
    scale, color = strip.scale, {name: imgui.get_color_u32(c) for name, c in COLORS.items()}
    right, bottom = at.x + width, at.y + RULER + LANE * len(TRACKS)
    draw.add_rect_filled((at.x, at.y), (right, at.y + RULER), color["ruler"], 4.0)
    draw.add_rect_filled((at.x, at.y + RULER), (right, bottom), color["lane"], 4.0)
    draw.push_clip_rect((at.x, at.y), (right, bottom), True)
    number = 0
    while (tick := round(number * scale.step * TICKS_PER_SECOND)) <= scale.ticks:
        x = scale.place(tick)
        draw.add_line((x, at.y + 13.0), (x, bottom), color["line"])
        draw.add_text((x + 3.0, at.y + 1.0), color["text"], f"{number * scale.step:g}")
        number += 1
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


def _diamond(draw, x, y, fill, edge):
    corners = (x, y - KEY), (x + KEY, y), (x, y + KEY), (x - KEY, y)
    draw.add_quad_filled(*corners, fill)
    draw.add_quad(*corners, edge, 1.5)


def _chosen_key(app):
    timeline, strip = app.scene.timeline, app.strip
    chosen = strip.chosen(timeline)
    if chosen is None:
        stands = timeline.stands and not timeline.playing
        labels = [with_key(app, action) for action in ("pause", "key")[not stands :]]
        imgui.align_text_to_frame_padding()
        imgui.text_disabled((STANDS if stands else HINT).format(*labels))
        return
    track, tick = chosen
    (key,) = (key for key in timeline.keys[track] if key.tick == tick)
    imgui.align_text_to_frame_padding()
    imgui.text_disabled(f"{track} at {as_time(tick)}")
    imgui.same_line()
    imgui.set_next_item_width(88.0)
    combo("easing", key.easing, EASINGS, partial(timeline.ease_key, track, tick), EASING)
    imgui.same_line()
    button("Copy", app, "copy_key", "to the playhead")
    imgui.same_line()
    if imgui.button("Delete"):
        delete_key(app)
    imgui.set_item_tooltip(with_key(app, "delete_key"))


# -- saved poses -------------------------------------------------------------------------------


def poses_panel(app):
    timeline, strip = app.scene.timeline, app.strip
    _, strip.pose_name = imgui.input_text_with_hint("##pose", "a name", strip.pose_name)
    imgui.same_line()
    button("Save pose", app, "save_pose", "to blend it with others")
    for pose in timeline.poses:
        imgui.push_id(pose.name)
        change = partial(timeline.blend_pose, pose.name)
        slider(pose.name, pose.weight, WEIGHTS, "%.2f", change, tooltip="how much of it")
        imgui.same_line()
        if imgui.small_button("x"):
            timeline.delete_pose(pose.name)
        imgui.set_item_tooltip("delete it")
        imgui.pop_id()
    if timeline.poses:
        imgui.text_disabled("what they differ by from the rest shape")
