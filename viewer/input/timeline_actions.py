"""Actions on the timeline: keys, the playhead, what plays."""

from ..camera import values_of
from ..document import TICKS_PER_SECOND, as_time, clean_name

NO_KEYS = "there are no keys yet: K sets one at the playhead"


def _done(app, edit, *arguments):
    """Make an edit, or say why not: there are too many keys or poses."""
    try:
        edit(*arguments)
    except ValueError as error:
        app.recorder.say(str(error))
        return False
    return True


def _key(camera, pose):
    """A function that keys camera and pose at the playhead, or one of them."""

    def key(app):
        timeline, tick = app.scene.timeline, app.scene.timeline.head
        orbit = values_of(app.scene.orbit) if camera else None
        if not _done(app, timeline.key, tick, orbit, pose):
            return
        app.scene.settings.show_timeline = True
        kept = " and ".join(["camera"] * camera + ["pose"] * pose)
        app.recorder.say(f"key of {kept} at {as_time(tick)}")

    return key


def _play(app):
    timeline = app.scene.timeline
    if timeline.playing:
        timeline.stop()
    elif not timeline.end:
        app.recorder.say(NO_KEYS)
    else:
        app.controls.cancel()
        timeline.play()


_play.is_on = lambda app: app.scene.timeline.playing


def _to_key(step):
    """A function that puts the playhead on the next key, or on the one before."""

    def go(app):
        timeline = app.scene.timeline
        ticks = sorted({key.tick for keys in timeline.keys.values() for key in keys})
        beyond = [tick for tick in ticks if step * (tick - timeline.head) > 0]
        if beyond:
            app.controls.cancel()
            timeline.scrub(beyond[0] if step > 0 else beyond[-1])

    return go


def delete_key(app):
    """Delete the chosen key."""
    timeline = app.scene.timeline
    chosen = app.strip.chosen(timeline)
    if chosen is not None:
        timeline.delete_key(*chosen)
        app.strip.selected = None


def _copy_key(app):
    """Copy the selected key to the playhead."""
    timeline = app.scene.timeline
    chosen = app.strip.chosen(timeline)
    if chosen is not None and chosen[1] != timeline.head:
        if _done(app, timeline.copy_key, *chosen, timeline.head):
            app.strip.selected = chosen[0], timeline.head


def _turntable(app):
    ticks = round(app.strip.turn_seconds * TICKS_PER_SECOND)
    app.controls.cancel()
    app.scene.timeline.turntable(ticks, values_of(app.scene.orbit))
    app.scene.settings.show_timeline = True


def _save_pose(app):
    """Save the pose under the name that was typed, or the next number."""
    timeline = app.scene.timeline
    typed = clean_name(app.strip.pose_name)
    taken = {pose.name for pose in timeline.poses}
    numbers = (f"pose {n}" for n in range(1, len(taken) + 2))
    _done(app, timeline.save_pose, typed or next(one for one in numbers if one not in taken))
    app.strip.pose_name = ""


def _toggle_loop(app):
    app.scene.timeline.set_loop(not app.scene.timeline.loop)


_toggle_loop.is_on = lambda app: app.scene.timeline.loop


TIMELINE_ACTIONS = {
    "key": _key(True, True),
    "key_camera": _key(True, False),
    "key_pose": _key(False, True),
    "play": _play,
    "next_key": _to_key(1),
    "previous_key": _to_key(-1),
    "copy_key": _copy_key,
    "turntable": _turntable,
    "save_pose": _save_pose,
    "toggle_loop": _toggle_loop,
}
