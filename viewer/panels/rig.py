"""The section on bones: joints, poses, clips."""

from functools import partial

from imgui_bundle import imgui

from ...wings.rig import METHODS
from ..document import SPEEDS
from ..input import bone_line, name_bone, rest_bone
from .widgets import button, checkbox, combo, setting, slider, with_key

SOFTNESS = """0: bones move all of the object;
more: only what is near the bones, and the solver moves the rest"""
SKINNING = "dual quaternion keeps the volume where bones twist"
FADES = "while one plays, its pose fades into that of the next"
SAVE_CLIP = "the timeline's poses of bones, with their times; Save copy keeps it with the model"
SAVE_COPY = "the model with its bones, weights and clips, here"


def rig_panel(app):
    scene = app.scene
    _tools(app)
    imgui.text_disabled(bone_line(scene))
    if scene.rigging.skeleton is None:
        return
    _bone(app)
    posing = scene.posing
    slider("softness", posing.softness, (0.0, 1.0), "%.2f", posing.set_softness, tooltip=SOFTNESS)
    combo("skinning", posing.method, METHODS, posing.set_skinning, SKINNING)
    _clips(app)
    _save(app)


def _tools(app):
    settings = app.scene.settings
    joints = "Stop placing" if settings.tool == "joints" else "Place joints"
    button(joints, app, "joints", "in the middle of what one clicks on")
    imgui.same_line()
    bones = "Stop posing" if settings.tool == "bones" else "Pose bones"
    button(bones, app, "bones", "drag bones, or their tips")
    imgui.same_line()
    setting("shown", settings, "show_bones", with_key(app, "toggle_bones"))


def _bone(app):
    rigging, bone = app.scene.rigging, app.scene.rigging.chosen_bone
    if bone is not None:
        changed, text = imgui.input_text("bone", rigging.skeleton.names[bone])
        if changed:
            name_bone(app, bone, text)
        if imgui.button("Bone at rest"):
            rest_bone(app)
        imgui.same_line()
    button("All at rest", app, "rest_bones")
    if bone is not None and app.scene.settings.tool == "joints":
        imgui.same_line()
        if imgui.button("Delete joint"):
            app.controls.bones.delete()
        imgui.set_item_tooltip(with_key(app, "delete_key"))


def _choose(posing, name):
    """Play another clip if one plays; else show its beginning."""
    if posing.playing:
        posing.play_clip(name)
    else:
        posing.scrub_clip(name, 0.0)


def _clips(app):
    posing, clip = app.scene.posing, app.scene.posing.chosen
    if clip is None:
        return
    names = [one.name for one in app.scene.rigging.clips]
    combo("clip", clip.name, names, partial(_choose, posing), FADES)
    button("Stop" if posing.playing else "Play", app, "play_clip")
    imgui.same_line()
    checkbox("loop##clip", posing.loop, posing.loop_clip)
    imgui.same_line()
    if imgui.small_button("x"):
        app.scene.rigging.delete_clip(clip.name)
    imgui.set_item_tooltip("delete it")
    seconds = posing.seconds if clip.name == posing.clip else 0.0
    text = f"%.2f of {clip.duration:.2f} s"
    slider("time", seconds, (0.0, clip.duration), text, partial(posing.scrub_clip, clip.name))
    slider("speed", posing.speed, SPEEDS, "%.2f", posing.set_clip_speed)


def _save(app):
    _, app.strip.clip_name = imgui.input_text_with_hint("##clip", "a name", app.strip.clip_name)
    imgui.same_line()
    button("Save clip", app, "save_clip", SAVE_CLIP)
    button("Save copy", app, "save_model", SAVE_COPY)
