"""The task *View*: the model, what the picture shows, the camera, the panels' looks, speed."""

import math
from functools import partial

import numpy as np
from imgui_bundle import imgui, imgui_ctx

from ...core.render import MODES, caption
from ..actions import AXIS_VIEWS, FROM_VIEW, UPS, line_of, set_up, show_photograph, up_name
from ..camera import widened
from ..files import readable
from ..layers import SAMPLE_COUNT
from ..memory import memory_line
from ..settings import MESH_RANGES, ORBIT_KEYS, PHOTOGRAPHS, SIDES, SURFACES, TARGETS, THEMES
from . import widgets as w

WIDER = "the distance changes with it, so that the object stays as large"
PHOTOGRAPH = "over the render as long as the camera is where it was taken, or beside it"
ORBIT = "the key with which a drag on the object turns the view"
UP = "what the horizon is level to: some captures lie on their side"
RESOLUTIONS = {"automatic": None, "full": 1.0, "1/2": 0.5, "1/4": 0.25}
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
    w.combo("show", *w.of(settings, "mode"), MODES, actions.told("next_mode"))
    line = caption(settings.mode, viewpoint.depth_range)
    if line:
        imgui.text_disabled(line)
    w.color("background", *w.of(settings, "background"))
    w.checkbox("checkerboard", *w.of(settings, "checkerboard"))
    w.beside(actions.title("toggle_ground"), True)
    w.buttons(actions, "toggle_ground")
    w.buttons(actions, "toggle_handles", "toggle_wireframe", "toggle_bones")
    lines = (actions.told(action, text) for action, text in SHOWN_ON_MESH.items())
    tooltip = ",\n".join(lines) + ", as means about vertices"
    w.combo("mesh", *w.of(settings, "mesh_surface"), SURFACES, tooltip)
    if settings.mesh_surface == "hidden":
        return
    opacity = w.of(settings, "mesh_opacity")
    w.slider("opacity", *opacity, (0.0, 1.0), "%.2f", tooltip="1 hides the picture")
    if settings.mesh_surface != "plain":
        text = "strain %.2f" if settings.mesh_surface == "strain" else "1 ± %.2f"
        most, tooltip = w.of(settings, "mesh_range"), "what the last colors of the legend mean"
        w.slider("colors to", *most, MESH_RANGES, text, w.LOGARITHMIC, tooltip)


# -- the camera ----------------------------------------------------------------------------------


def camera_panel(viewpoint, settings, actions):
    orbit = viewpoint.orbit

    def widen(degrees):
        viewpoint.orbit = widened(orbit, math.radians(degrees))

    w.buttons(actions, *AXIS_VIEWS, "fly", "home", "focus")
    angle = math.degrees(orbit.field_of_view)
    w.slider("field of view", angle, widen, (5.0, 100.0), "%.0f°", tooltip=WIDER)
    w.buttons(actions, "toggle_parallel")
    w.combo("up", up_name(orbit), partial(set_up, viewpoint), [*UPS, FROM_VIEW], UP)
    if settings.grab_anywhere:
        w.combo("orbit on the object with", *w.of(settings, "orbit_key"), ORBIT_KEYS, ORBIT)
    viewpoint.new_name = w.text_field("##name", viewpoint.new_name, "a name", width=150.0)
    imgui.same_line()
    w.button(actions, "save_view")
    for name in list(viewpoint.saved):
        with imgui_ctx.push_id(name):
            w.delete_button(viewpoint.delete, name)
            imgui.same_line()
            room = imgui.get_content_region_avail().x - 2.0 * imgui.get_style().frame_padding.x
            if imgui.button(w.fitting(name, room)):
                viewpoint.go_to(name)
            imgui.set_item_tooltip(name)


def photographs_panel(photographs, settings, viewpoint, controls, fly, center, actions):
    """The data set's photographs, if its folder was given."""
    w.button(actions, "previous_photograph", "<")
    imgui.same_line()
    w.button(actions, "next_photograph", ">")
    imgui.same_line()
    imgui.text_disabled(line_of(photographs))
    change = partial(show_photograph, photographs, settings, viewpoint, controls, fly, center)
    w.combo("photograph", settings.photograph, change, PHOTOGRAPHS, PHOTOGRAPH)
    if settings.photograph == "over":
        w.slider("opacity", *w.of(settings, "photo_opacity"), (0.0, 1.0), "%.2f")


# -- the window, and its speed -------------------------------------------------------------------


def window_panel(settings):
    w.combo("colors", *w.of(settings, "theme"), THEMES)
    w.combo("letters", *w.of(settings, "panel_scale"), PANEL_SCALES, "over what the system says")
    w.combo("panel at", *w.of(settings, "panel_side"), SIDES)


def speed_panel(settings, radiance, times, ctx):
    """How finely things are rendered while they move, and how long frames take."""
    tooltip = "while things move; when all is still, the image is refined to full resolution"
    w.combo("resolution", *w.of(settings, "fixed_resolution"), RESOLUTIONS, tooltip)
    if settings.fixed_resolution is None:
        tooltip, text = "the resolution while things move follows it", "%.0f frames/s"
        w.slider("target", *w.of(settings, "target_fps"), TARGETS, text, w.LOGARITHMIC, tooltip)
    w.checkbox("average shifted images when still", *w.of(settings, "accumulate"), SHIFTED_TOOLTIP)
    for line in shown_lines(radiance, times):
        imgui.text_disabled(line)
        imgui.set_item_tooltip(SHOWN_TOOLTIP)
    frames = 1e3 * np.array(times.frames, np.float32)
    text = f"{1e3 * times.frame_seconds():.1f} ms a frame"
    imgui.plot_lines("##frames", frames, 0, text, scale_min=0.0, graph_size=(-1.0, 40.0))
    _rows(times.means())
    imgui.text_disabled("means of the last second")
    w.checkbox("stages of rendering", *w.of(settings, "time_rendering"), STAGES_TOOLTIP)
    if settings.time_rendering:
        _rows(times.rendering)
    imgui.text(memory_line(radiance.device))
    renders, draws = radiance.device.name, ctx.info["GL_RENDERER"]
    for line in (f"renders on {renders}", f"draws on {draws}", f"frames go by {radiance.path}"):
        imgui.text_disabled(line)


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


def _rows(seconds_of):
    for name, seconds in seconds_of.items():
        imgui.text_disabled(name)
        imgui.same_line(100.0)
        imgui.text(f"{1e3 * seconds:.2f} ms")
