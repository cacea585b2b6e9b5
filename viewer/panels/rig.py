"""The task *Rig*: joints and bones; and, in the task *Animate*, their clips."""

from functools import partial

from imgui_bundle import imgui

from ...wings.rig import METHODS
from ..actions import bone_line, name_bone
from ..document import SPEEDS
from .widgets import (
    action_box,
    button,
    buttons,
    combo,
    delete_button,
    named,
    section,
    slider,
    text_field,
)

NO_BONES = "Place joints, and click on the object: where a leg begins, at its knee, at its foot."
NO_CLIPS = "Key poses of bones on the timeline, and save them as a clip."
SOFTNESS = """0: bones move all of the object;
more: only what is near the bones, and the solver moves the rest"""
SKINNING = "dual quaternion keeps the volume where bones twist"
FADES = "while one plays, its pose fades into that of the next"


def rig_panel(settings, rigging, posing, actions, say):
    buttons(actions, "joints", "bones")
    imgui.same_line()
    action_box(actions, "toggle_bones")
    imgui.text_wrapped(bone_line(rigging))
    if rigging.skeleton is None:
        imgui.text_wrapped(NO_BONES)
        return
    bone = rigging.chosen_bone
    if bone is not None:
        changed, text = imgui.input_text(named("bone"), rigging.skeleton.names[bone])
        if changed:
            name_bone(rigging, say, bone, text)
        if imgui.button("Bone at rest"):
            posing.rest_bones([bone])
        imgui.same_line()
    button(actions, "rest_bones")
    if bone is not None and settings.tool == "joints":
        imgui.same_line()
        button(actions, "delete_key", "Delete joint")
    if section("Skinning"):
        slider("softness", posing.softness, (0.0, 1.0), "%.2f", posing.set_softness, 0, SOFTNESS)
        combo("method", posing.method, METHODS, posing.set_skinning, SKINNING)
        button(actions, "save_model")


def _choose(posing, name):
    """Play another clip if one plays; else show its beginning."""
    if posing.playing:
        posing.play_clip(name)
    else:
        posing.scrub_clip(name, 0.0)


def clips_panel(rigging, posing, strip, actions):
    """What plays, and how a clip is made of the timeline's keys."""
    clip = posing.chosen
    if clip is None:
        imgui.text_wrapped(NO_CLIPS)
    else:
        names = [one.name for one in rigging.clips]
        combo("clip", clip.name, names, partial(_choose, posing), FADES)
        button(actions, "play_clip")
        imgui.same_line()
        action_box(actions, "loop_clip")
        imgui.same_line()
        delete_button(rigging.delete_clip, clip.name)
        seconds = posing.seconds if clip.name == posing.clip else 0.0
        text = f"%.2f of {clip.duration:.2f} s"
        slider("time", seconds, (0.0, clip.duration), text, partial(posing.scrub_clip, clip.name))
        slider("speed", posing.speed, SPEEDS, "%.2f", posing.set_clip_speed)
    strip.clip_name = text_field("##clip name", strip.clip_name, "a name", width=120.0)
    imgui.same_line()
    button(actions, "save_clip")
