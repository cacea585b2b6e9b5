"""Actions on bones and clips."""

from ..document import TAIL, clean_name
from .action import action
from .editing import tool

NO_BONES = "there are no bones yet: J places joints"
NO_CLIPS = "there are no clips: key poses of bones on the timeline, and save them as one"

tool(
    *("joints", "place joints: click on the object; each goes on from the chosen one", "J"),
    "Rig/Place joints",
)
tool(
    "bones",
    "animate: drag a bone to turn it, its tip to reach, a root's head to move all",
    *("A", "Rig/Pose bones", "CTRL+TAB"),
)


@action("bones at rest", "SHIFT+A", "Rig/Bones at rest", "ALT+R")
def rest_bones(rigging, posing, controls, say):
    if rigging.skeleton is None:
        say(NO_BONES)
        return
    controls.cancel()
    posing.rest_bones(list(range(rigging.bone_count)))


def rest_bone(rigging, posing) -> None:
    """Bring the chosen bone to rest."""
    if rigging.chosen_bone is not None:
        posing.rest_bones([rigging.chosen_bone])


@action(
    *("play the chosen clip, or stop", "SHIFT+ENTER", "Rig/-Play"),
    on=lambda posing: posing.playing,
)
def play_clip(posing, controls, say):
    if posing.playing:
        posing.stop_clip()
    elif posing.chosen is None:
        say(NO_CLIPS)
    else:
        controls.cancel()
        posing.play_clip(posing.chosen.name)


@action("play clips again and again", menu="Rig/Loop", on=lambda posing: posing.loop)
def loop_clip(posing):
    posing.loop_clip(not posing.loop)


@action("a clip of the timeline's poses of bones", "SHIFT+C", "Rig/Clip")
def save_clip(rigging, strip, say):
    """Make a clip of the timeline's poses, under the name that was typed or the next number."""
    taken = {clip.name for clip in rigging.clips}
    numbers = (f"clip {n}" for n in range(1, len(taken) + 2))
    typed = clean_name(strip.clip_name)
    name = typed or next(one for one in numbers if one not in taken)
    try:
        rigging.save_clip(name)
    except ValueError as error:  # the keys are not of these bones
        say(str(error))
        return
    strip.clip_name = ""
    say(f"the timeline's poses are the clip {name!r}")


def name_bone(rigging, say, bone: int, typed: str) -> None:
    """Give a bone another name, unless it can't have it."""
    try:
        rigging.name_bone(bone, clean_name(typed))
    except ValueError as error:  # another one has it, or it is empty
        say(str(error))


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
