"""The task *Rig*: joints and bones; and, in the task *Animate*, their clips."""

from functools import partial

from imgui_bundle import imgui

from ...wings.rig import METHODS
from ..actions import bone_line, name_bone
from ..document import SPEEDS
from . import widgets as w

NO_BONES = "Place joints, and click on the object: where a leg begins, at its knee, at its foot."
NO_CLIPS = "Key poses of bones on the timeline, and save them as a clip."
SOFTNESS = """0: bones move all of the object;
more: only what is near the bones, and the solver moves the rest"""
SKINNING = "dual quaternion keeps the volume where bones twist"
FADES = "while one plays, its pose fades into that of the next"


def rig_panel(settings, rigging, posing, actions, say):
    w.buttons(actions, "joints", "bones", "toggle_bones")
    imgui.text_wrapped(bone_line(rigging))
    if rigging.skeleton is None:
        imgui.text_wrapped(NO_BONES)
        return
    bone = rigging.chosen_bone
    if bone is not None:
        changed, text = imgui.input_text(w.named("bone"), rigging.skeleton.names[bone])
        if changed:
            name_bone(rigging, say, bone, text)
        if imgui.button("Bone at rest"):
            posing.rest_bones([bone])
        imgui.same_line()
    w.button(actions, "rest_bones")
    if bone is not None and settings.tool == "joints":
        imgui.same_line()
        w.button(actions, "delete_key", "Delete joint")
    if w.section("Skinning"):
        w.slider("softness", posing.softness, posing.set_softness, (0.0, 1.0), "%.2f", 0, SOFTNESS)
        w.combo("method", posing.method, posing.set_skinning, METHODS, SKINNING)
        w.button(actions, "save_model")


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
        w.combo("clip", clip.name, partial(_choose, posing), names, FADES)
        w.buttons(actions, "play_clip", "loop_clip")
        imgui.same_line()
        w.delete_button(rigging.delete_clip, clip.name)
        seconds = posing.seconds if clip.name == posing.clip else 0.0
        text = f"%.2f of {clip.duration:.2f} s"
        w.slider("time", seconds, partial(posing.scrub_clip, clip.name), (0.0, clip.duration), text)
        w.slider("speed", posing.speed, posing.set_clip_speed, SPEEDS, "%.2f")
    strip.clip_name = w.text_field("##clip name", strip.clip_name, "a name", width=120.0)
    imgui.same_line()
    w.button(actions, "save_clip")
