"""The task *Rig*: joints, bones, clips."""

from functools import partial

from imgui_bundle import imgui

from ...wings.rig import METHODS
from ..actions import bone_line, name_bone, rest_bone
from ..document import SPEEDS
from .widgets import (
    button,
    checkbox,
    combo,
    named,
    section,
    setting,
    slider,
    text_field,
)

NO_BONES = "Place joints, and click on the object: where a leg begins, at its knee, at its foot."
NO_CLIPS = "Key poses of bones on the timeline, and save them as a clip."
SOFTNESS = """0: bones move all of the object;
more: only what is near the bones, and the solver moves the rest"""
SKINNING = "dual quaternion keeps the volume where bones twist"
FADES = "while one plays, its pose fades into that of the next"
SAVE_CLIP = "the timeline's poses of bones, with their times; Save a copy of the model keeps it"
SAVE_COPY = "the model with its bones, weights and clips, here"


def rig_panel(settings, rigging, posing, controls, actions, say):
    _tools(settings, actions)
    imgui.text_wrapped(bone_line(rigging))
    if rigging.skeleton is None:
        imgui.text_wrapped(NO_BONES)
        return
    _bone(settings, rigging, posing, controls, actions, say)
    if section("Skinning"):
        slider("softness", posing.softness, (0.0, 1.0), "%.2f", posing.set_softness, 0, SOFTNESS)
        combo("method", posing.method, METHODS, posing.set_skinning, SKINNING)
        button("Save a copy of the model", actions, "save_model", SAVE_COPY)


def _tools(settings, actions):
    joints = "Stop placing" if settings.tool == "joints" else "Place joints"
    button(joints, actions, "joints", "in the middle of what one clicks on")
    imgui.same_line()
    bones = "Stop posing" if settings.tool == "bones" else "Pose bones"
    button(bones, actions, "bones", "drag bones, or their tips")
    imgui.same_line()
    setting("shown", settings, "show_bones", actions.with_key("toggle_bones"))


def _bone(settings, rigging, posing, controls, actions, say):
    bone = rigging.chosen_bone
    if bone is not None:
        changed, text = imgui.input_text(named("bone"), rigging.skeleton.names[bone])
        if changed:
            name_bone(rigging, say, bone, text)
        if imgui.button("Bone at rest"):
            rest_bone(rigging, posing)
        imgui.same_line()
    button("All at rest", actions, "rest_bones")
    if bone is not None and settings.tool == "joints":
        imgui.same_line()
        if imgui.button("Delete joint"):
            controls.bones.delete()
        imgui.set_item_tooltip(actions.with_key("delete_key"))


def _choose(posing, name):
    """Play another clip if one plays; else show its beginning."""
    if posing.playing:
        posing.play_clip(name)
    else:
        posing.scrub_clip(name, 0.0)


def clips_panel(rigging, posing, strip, actions):
    """What plays, and how a clip is made of the timeline's keys."""
    if posing.chosen is None:
        imgui.text_wrapped(NO_CLIPS)
    else:
        _clip(rigging, posing, posing.chosen, actions)
    strip.clip_name = text_field("##clip name", strip.clip_name, "a name", width=120.0)
    imgui.same_line()
    button("Save clip", actions, "save_clip", SAVE_CLIP)


def _clip(rigging, posing, clip, actions):
    combo("clip", clip.name, [one.name for one in rigging.clips], partial(_choose, posing), FADES)
    button("Stop" if posing.playing else "Play", actions, "play_clip")
    imgui.same_line()
    checkbox("loop##clip", posing.loop, posing.loop_clip)
    imgui.same_line()
    if imgui.small_button("x"):
        rigging.delete_clip(clip.name)
    imgui.set_item_tooltip("delete it")
    seconds = posing.seconds if clip.name == posing.clip else 0.0
    text = f"%.2f of {clip.duration:.2f} s"
    slider("time", seconds, (0.0, clip.duration), text, partial(posing.scrub_clip, clip.name))
    slider("speed", posing.speed, SPEEDS, "%.2f", posing.set_clip_speed)
