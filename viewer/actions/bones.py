"""Actions on bones and clips."""

from ..document import TAIL, clean_name
from .action import action
from .editing import tool

NO_BONES = "there are no bones yet: J places joints"
NO_CLIPS = "there are no clips: key poses of bones on the timeline, and save them as one"

tool(
    *("joints", "place joints: click on the object; each goes on from the chosen one", "J"),
    "Rig/Place joints",
    stop="Stop placing",
)
tool(
    "bones",
    "animate: drag a bone to turn it, its tip to reach, a root's head to move all",
    *("A", "Rig/Pose bones", "CTRL+TAB"),
    stop="Stop posing",
)


def done(say, edit, *arguments) -> bool:
    """Make an edit, or say why not: there are too many of them, or a name is taken."""
    try:
        edit(*arguments)
    except ValueError as error:
        say(str(error))
        return False
    return True


def free_name(typed: str, kind: str, taken) -> str:
    """The name that was typed, else "KIND 1" or the next number that is free."""
    numbers = (f"{kind} {n}" for n in range(1, len(taken) + 2))
    return clean_name(typed) or next(one for one in numbers if one not in taken)


@action("bring all bones to rest", "SHIFT+A", "Rig/All bones at rest", "ALT+R")
def rest_bones(rigging, posing, controls, say):
    if rigging.skeleton is None:
        say(NO_BONES)
        return
    controls.cancel()
    posing.rest_bones(list(range(rigging.bone_count)))


@action(
    *("play the chosen clip, or stop", "SHIFT+ENTER", "Rig/-Play clip"),
    on="posing.playing",
    stop="Stop clip",
)
def play_clip(posing, controls, say):
    if posing.playing:
        posing.stop_clip()
    elif posing.chosen is None:
        say(NO_CLIPS)
    else:
        controls.cancel()
        posing.play_clip(posing.chosen.name)


@action("play clips again and again", menu="Rig/Loop clip", on="posing.loop")
def loop_clip(posing):
    posing.loop_clip(not posing.loop)


@action(
    "make a clip of the timeline's poses of bones, with their times", "SHIFT+C", "Rig/Save clip"
)
def save_clip(rigging, strip, say):
    """Make the clip under the name that was typed, or the next number."""
    name = free_name(strip.clip_name, "clip", {clip.name for clip in rigging.clips})
    if done(say, rigging.save_clip, name):  # else the keys are not of these bones
        strip.clip_name = ""
        say(f"the timeline's poses are the clip {name!r}")


def name_bone(rigging, say, bone: int, typed: str) -> None:
    """Give a bone another name, unless another one has it, or it is empty."""
    done(say, rigging.name_bone, bone, clean_name(typed))


def bone_line(rigging) -> str:
    """How many bones there are, and which joint is chosen."""
    count = rigging.bone_count
    counted = f"{count} bone{'s' * (count != 1)}"
    if rigging.selected is None:
        return counted
    if rigging.chosen_bone is None:
        return f"{counted}; the next joint makes one from the chosen joint"
    end = "" if rigging.selected[1] == TAIL else ", its head"
    return f"{counted}; chosen: {rigging.skeleton.names[rigging.chosen_bone]}{end}"
