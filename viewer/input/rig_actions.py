"""Actions on bones and clips."""

from ..document import TAIL, clean_name
from .timeline_actions import delete_key

NO_BONES = "there are no bones yet: J places joints"
NO_CLIPS = "there are no clips: key poses of bones on the timeline, and save them as one"


def _play_clip(app):
    posing = app.scene.posing
    if posing.playing:
        posing.stop_clip()
    elif posing.chosen is None:
        app.recorder.say(NO_CLIPS)
    else:
        app.controls.cancel()
        posing.play_clip(posing.chosen.name)


_play_clip.is_on = lambda app: app.scene.posing.playing


def _loop_clip(app):
    app.scene.posing.loop_clip(not app.scene.posing.loop)


_loop_clip.is_on = lambda app: app.scene.posing.loop


def _rest_bones(app):
    """Bring all bones to rest, relative to their parents."""
    rigging = app.scene.rigging
    if rigging.skeleton is None:
        app.recorder.say(NO_BONES)
        return
    app.controls.cancel()
    app.scene.posing.rest_bones(list(range(rigging.bone_count)))


def rest_bone(app):
    """Bring the chosen bone to rest."""
    bone = app.scene.rigging.chosen_bone
    if bone is not None:
        app.scene.posing.rest_bones([bone])


def _save_clip(app):
    """Make a clip of the timeline's poses, under the name that was typed or the next number."""
    rigging = app.scene.rigging
    taken = {clip.name for clip in rigging.clips}
    numbers = (f"clip {n}" for n in range(1, len(taken) + 2))
    typed = clean_name(app.strip.clip_name)
    name = typed or next(one for one in numbers if one not in taken)
    try:
        rigging.save_clip(name)
    except ValueError as error:  # the keys are not of these bones
        app.recorder.say(str(error))
        return
    app.strip.clip_name = ""
    app.recorder.say(f"the timeline's poses are the clip {name!r}")


def name_bone(app, bone: int, typed: str) -> None:
    """Give a bone another name, unless it can't have it."""
    try:
        app.scene.rigging.name_bone(bone, clean_name(typed))
    except ValueError as error:  # another one has it, or it is empty
        app.recorder.say(str(error))


def bone_line(scene) -> str:
    """How many bones there are, and which joint is chosen."""
    rigging, count = scene.rigging, scene.rigging.bone_count
    counted = f"{count} bone{'s' * (count != 1)}"
    if rigging.selected is None:
        return counted
    if rigging.chosen_bone is None:
        return f"{counted}; the next joint makes one from the chosen joint"
    end = "" if rigging.selected[1] == TAIL else ", its head"
    return f"{counted}; chosen: {rigging.skeleton.names[rigging.chosen_bone]}{end}"


def _delete(app):
    """Delete the chosen key; while joints are placed, the chosen joint."""
    if app.scene.settings.tool != "joints":
        delete_key(app)
        return
    app.controls.cancel()
    if not app.controls.bones.delete():
        app.recorder.say("choose the joint to delete: click on it")


RIG_ACTIONS = {
    "save_clip": _save_clip,
    "delete_key": _delete,
    "play_clip": _play_clip,
    "loop_clip": _loop_clip,
    "rest_bones": _rest_bones,
}
