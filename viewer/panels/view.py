"""The task *View*: the model, what the picture shows, the panels' looks, speed."""

from functools import partial

import numpy as np
from imgui_bundle import imgui

from ...core.render import MODES, caption
from ..files import readable
from ..layers import SAMPLE_COUNT
from ..memory import memory_line
from ..settings import MESH_RANGES, SIDES, SURFACES, THEMES
from .widgets import LOGARITHMIC, action_box, color, combo, number_setting, setting

RESOLUTIONS = {"automatic": None, "full": 1.0, "1/2": 0.5, "1/4": 0.25}
TARGETS = 2.0, 120.0  # frames a second
PANEL_SCALES = {"80 %": 0.8, "100 %": 1.0, "125 %": 1.25, "150 %": 1.5, "200 %": 2.0}
SLOW = 0.95  # of the clock, the pace of the object's time that is worth a word
SHIFTED_TOOLTIP = f"""when nothing moves, {SAMPLE_COUNT} images are rendered, each shifted by
another part of a pixel, and their mean is shown: edges get smooth"""
SHOWN_ON_MESH = {
    "toggle_surface": "the surface of the coarse mesh, over the picture",
    "toggle_strain": "strain is the largest |principal stretch - 1|",
    "toggle_volume": "the volume ratio is now to at rest",
}
SHOWN_TOOLTIP = """the picture's size relative to the window, how many of the window's pixels one of
its pixels is wide, and frames a second;
refined: the share of the full resolution that is rendered; steps × 2: rays take samples twice as
far apart; levels: finer details are left out; samples: images in the mean;
object time × 0.4: the object moves at 0.4 of its speed, as frames take too long"""
STAGES_TOOLTIP = """of the last image or strip; measuring waits after each stage and so takes time,
and on the CPU the times of all threads are added up"""


def model_panel(field, name):
    counts = f"{field.mesh.tet_count:,} tets, {field.mesh.vertex_count:,} vertices"
    imgui.text(readable(name))
    imgui.text_disabled(f"{counts}, {field.options.level_count} levels")
    psnr = (field.meta.get("test_mean") or {}).get("psnr")
    if psnr is not None:
        imgui.text_disabled(f"{psnr:.1f} dB on its test views")
    if field.attribution:
        imgui.text_wrapped(readable(field.attribution))


def picture_panel(settings, viewpoint, actions):
    """What the picture shows."""
    change = partial(setattr, settings, "mode")
    combo("show", settings.mode, MODES, change, actions.told("next_mode"))
    line = caption(settings.mode, viewpoint.depth_range)
    if line:
        imgui.text_disabled(line)
    color("background", settings.background, partial(setattr, settings, "background"))
    setting("checkerboard", settings, "checkerboard")
    imgui.same_line()
    action_box(actions, "toggle_ground")
    action_box(actions, "toggle_handles")
    for name in ("toggle_wireframe", "toggle_bones"):
        imgui.same_line()
        action_box(actions, name)
    _mesh(settings, actions)


def _mesh(settings, actions):
    change = partial(setattr, settings, "mesh_surface")
    lines = (actions.told(action, text) for action, text in SHOWN_ON_MESH.items())
    tooltip = ",\n".join(lines) + ", as means about vertices"
    combo("mesh", settings.mesh_surface, SURFACES, change, tooltip)
    if settings.mesh_surface == "hidden":
        return
    tooltip = "1 hides the picture"
    number_setting("opacity", settings, "mesh_opacity", (0.0, 1.0), "%.2f", tooltip=tooltip)
    if settings.mesh_surface != "plain":
        text = "strain %.2f" if settings.mesh_surface == "strain" else "1 ± %.2f"
        tooltip = "what the last colors of the legend mean"
        bounds = MESH_RANGES
        number_setting("colors to", settings, "mesh_range", bounds, text, LOGARITHMIC, tooltip)


def window_panel(settings):
    """The looks of the panels."""
    combo("colors", settings.theme, THEMES, partial(setattr, settings, "theme"))
    scale = next((name for name, one in PANEL_SCALES.items() if one == settings.panel_scale), "")
    names = [*PANEL_SCALES, *([] if scale else ["other"])]

    def choose(name):
        settings.panel_scale = PANEL_SCALES.get(name, settings.panel_scale)

    combo("letters", scale or "other", names, choose, "over what the system says")
    combo("panel at", settings.panel_side, SIDES, partial(setattr, settings, "panel_side"))


def speed_panel(settings, radiance, times, ctx):
    """How finely things are rendered while they move, and how long frames take."""

    def choose(name):
        settings.fixed_resolution = RESOLUTIONS[name]

    names = {factor: name for name, factor in RESOLUTIONS.items()}
    tooltip = "while things move; at rest the image is refined to full resolution"
    combo("resolution", names[settings.fixed_resolution], RESOLUTIONS, choose, tooltip)
    if settings.fixed_resolution is None:
        tooltip, text = "the resolution while things move follows it", "%.0f frames/s"
        number_setting("target", settings, "target_fps", TARGETS, text, LOGARITHMIC, tooltip)
    setting("average shifted images at rest", settings, "accumulate", SHIFTED_TOOLTIP)
    for line in shown_lines(radiance, times):
        imgui.text_disabled(line)
        imgui.set_item_tooltip(SHOWN_TOOLTIP)
    _times(settings, radiance, times, ctx)


def shown_lines(image, times) -> tuple[str, str]:
    """The picture of a RadianceLayer: its pixels and frame rate, and how far it is refined."""
    fps = 1.0 / max(times.frame_seconds(), 1e-6)
    pixels = f"{image.factor:.0%}, pixels {1.0 / image.factor:.1f} wide, {fps:.0f} fps"
    slow = [f"object time × {times.pace():.2g}"] if times.pace() < SLOW else []
    if image.refined < 1.0:
        names = {"step_factor": "steps × {}", "level_count": "{} levels"}
        saved = [names[name].format(value) for name, value in image.shown.cheaper.items()]
        return pixels, ", ".join([f"{image.refined:.0%} refined", *saved, *slow])
    if image.sample_count < 2:
        return pixels, ", ".join(["full", *slow])
    return pixels, f"full + {image.sample_count}/{image.most_samples} samples"


def _times(settings, radiance, times, ctx):
    mean = times.frame_seconds()
    imgui.text(f"{1e3 * mean:.1f} ms a frame, {1.0 / max(mean, 1e-6):.0f} frames a second")
    frames = 1e3 * np.array(times.frames, np.float32)
    imgui.plot_lines("##frames", frames, scale_min=0.0, graph_size=(-1.0, 40.0))
    _rows(times.means())
    imgui.text_disabled("means of the last second")
    setting("stages of rendering", settings, "time_rendering", STAGES_TOOLTIP)
    if settings.time_rendering:
        _rows(times.rendering)
    pace = times.pace()
    imgui.text(f"object time × {pace:.2g}" + " of the clock" * (pace < SLOW))
    imgui.set_item_tooltip("below 1, the object moves slower than it would: frames take too long")
    imgui.text(memory_line(radiance.device))
    imgui.text_disabled(f"renders on {radiance.device.name}")
    imgui.text_disabled(f"draws on {ctx.info['GL_RENDERER']}")
    imgui.text_disabled(f"frames go by {radiance.path}")


def _rows(seconds_of):
    for name, seconds in seconds_of.items():
        imgui.text_disabled(name)
        imgui.same_line(100.0)
        imgui.text(f"{1e3 * seconds:.2f} ms")
