"""The section on the view: model, view mode, and resolution."""

from imgui_bundle import imgui

from ...core.render import MODES, caption
from ..actions import label_of
from .widgets import LOGARITHMIC, button, number_setting, setting

RESOLUTIONS = {"automatic": None, "full": 1.0, "1/2": 0.5, "1/4": 0.25}
TARGETS = 2.0, 120.0  # frames a second


def model_panel(app):
    scene, field = app.scene, app.scene.field
    counts = f"{field.mesh.tet_count:,} tets, {field.mesh.vertex_count:,} vertices"
    imgui.text(scene.name)
    imgui.text_disabled(f"{counts}, {field.options.level_count} levels")
    psnr = (field.meta.get("test_mean") or {}).get("psnr")
    if psnr is not None:
        imgui.text_disabled(f"{psnr:.1f} dB on its test views")


def view_panel(app):
    _mode(app.scene)
    _background(app.scene.settings)
    _resolution(app)
    button("Reset camera", app, "home")
    imgui.same_line()
    button("Focus", app, "focus")
    imgui.same_line()
    button("Help", app, "toggle_help")


def _mode(scene):
    settings = scene.settings
    changed, chosen = imgui.combo("show", MODES.index(settings.mode), list(MODES))
    imgui.set_item_tooltip(f"next one: {label_of('next_mode')}")
    if changed:
        settings.mode = MODES[chosen]
    line = caption(settings.mode, scene.depth_range)
    if line:
        imgui.text_disabled(line)


def _background(settings):
    changed, color = imgui.color_edit3(
        "background", list(settings.background), imgui.ColorEditFlags_.no_inputs.value
    )
    if changed:
        settings.background = tuple(color)[:3]
    imgui.same_line()
    setting("checkerboard", settings, "checkerboard")
    setting("vertices", settings, "show_handles")
    imgui.same_line()
    setting("wireframe", settings, "show_wireframe")


def _resolution(app):
    settings = app.scene.settings
    wanted = None if settings.automatic_resolution else settings.fixed_resolution
    names = list(RESOLUTIONS)
    current = list(RESOLUTIONS.values()).index(wanted)
    changed, chosen = imgui.combo("resolution", current, names)
    imgui.set_item_tooltip("while things move; at rest the image is refined to full resolution")
    if changed:
        factor = RESOLUTIONS[names[chosen]]
        settings.automatic_resolution = factor is None
        settings.fixed_resolution = factor or 1.0
    if settings.automatic_resolution:
        flags = LOGARITHMIC | imgui.SliderFlags_.always_clamp.value
        tooltip = "the resolution while things move follows it"
        number_setting("target", settings, "target_fps", TARGETS, "%.0f frames/s", flags, tooltip)
    setting("average shifted images at rest", settings, "accumulate")
    for line in shown_lines(app.radiance, app.times):
        imgui.text_disabled(line)


def shown_lines(image, times) -> tuple[str, str]:
    """The picture of a RadianceLayer: its pixels and frame rate, and how far it is refined."""
    fps = 1.0 / max(times.frame_seconds(), 1e-6)
    pixels = f"{image.factor:.0%}, pixels {1.0 / image.factor:.1f} wide, {fps:.0f} fps"
    if image.refined < 1.0:
        names = {"step_factor": "steps × {}", "level_count": "{} levels"}
        saved = [names[name].format(value) for name, value in image.shown.cheaper.items()]
        return pixels, ", ".join([f"{image.refined:.0%} refined", *saved])
    if image.sample_count < 2:
        return pixels, "full"
    return pixels, f"full + {image.sample_count}/{image.most_samples} samples"
