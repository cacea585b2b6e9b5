"""Actions on the timeline: keys, the playhead, what plays."""

from functools import partial

from ..camera import values_of
from ..document import TICKS_PER_SECOND, as_time
from .action import action, toggle
from .bones import done, free_name

NO_KEYS = "there are no keys yet: K sets one at the playhead"

toggle("show_timeline", "timeline", "SHIFT+T", "Animate/Timeline")


def _key(camera, pose, timeline, viewpoint, settings, say):
    """Key camera and pose at the playhead, or one of them."""
    tick = timeline.head
    orbit = values_of(viewpoint.orbit) if camera else None
    if done(say, timeline.key, tick, orbit, pose):
        settings.show_timeline = True
        kept = " and ".join(["camera"] * camera + ["pose"] * pose)
        say(f"key of {kept} at {as_time(tick)}")


for _name, _what, _key_name, _menu, _help in (
    ("key", (True, True), "K", "-Key both", "key camera and pose at the playhead"),
    ("key_camera", (True, False), "CTRL+K", "Key camera", "key the camera alone"),
    ("key_pose", (False, True), "SHIFT+K", "Key pose", "key the pose alone"),
):
    action(_help, _key_name, f"Animate/{_menu}", name=_name)(partial(_key, *_what))


@action(
    *("play the timeline, or stop", "ENTER", "Animate/-Play timeline"),
    on="timeline.playing",
    stop="Stop timeline",
)
def play(timeline, controls, say):
    if timeline.playing:
        timeline.stop()
    elif not timeline.end:
        say(NO_KEYS)
    else:
        controls.cancel()
        timeline.play()


def _to_key(step, timeline, controls):
    """Put the playhead on the next key, or on the one before."""
    ticks = sorted({key.tick for keys in timeline.keys.values() for key in keys})
    beyond = [tick for tick in ticks if step * (tick - timeline.head) > 0]
    if beyond:
        controls.cancel()
        timeline.scrub(beyond[0] if step > 0 else beyond[-1])


action("next key", "PAGEDOWN", "Animate/Next key", name="next_key")(partial(_to_key, 1))
action("key before", "PAGEUP", "Animate/Key before", name="previous_key")(partial(_to_key, -1))


@action("delete the chosen key; while joints are placed, the joint", "DELETE", "Animate/Delete key")
def delete_key(timeline, strip, settings, controls, say):
    if settings.tool == "joints":
        controls.cancel()
        if not controls.bones.delete():
            say("choose the joint to delete: click on it")
        return
    chosen = strip.chosen(timeline)
    if chosen is not None:
        timeline.delete_key(*chosen)
        strip.selected = None


@action("copy the chosen key to the playhead", "CTRL+D", "Animate/Copy key")
def copy_key(timeline, strip, say):
    chosen = strip.chosen(timeline)
    if chosen is not None and chosen[1] != timeline.head:
        if done(say, timeline.copy_key, *chosen, timeline.head):
            strip.selected = chosen[0], timeline.head


@action("camera keys around what it looks at, in a loop", "SHIFT+O", "Animate/-Turntable")
def turntable(timeline, strip, viewpoint, settings, controls):
    ticks = round(strip.turn_seconds * TICKS_PER_SECOND)
    controls.cancel()
    timeline.turntable(ticks, values_of(viewpoint.orbit))
    settings.show_timeline = True


@action("save the pose, to blend it with others", menu="Animate/Save pose")
def save_pose(timeline, strip, say):
    """Save the pose under the name that was typed, or the next number."""
    taken = {pose.name for pose in timeline.poses}
    done(say, timeline.save_pose, free_name(strip.pose_name, "pose", taken))
    strip.pose_name = ""


@action("the timeline plays again and again", menu="Animate/Loop", on="timeline.loop")
def toggle_loop(timeline):
    timeline.set_loop(not timeline.loop)
