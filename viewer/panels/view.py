"""How the picture looks, and with how many pixels it is rendered."""

from imgui_bundle import imgui

from ...core.render import MODES, caption
from ..controls import label_of

RESOLUTIONS = {"automatic": None, "full": 1.0, "1/2": 0.5, "1/4": 0.25}
SLOWEST, FASTEST = 2.0, 120.0  # frames a second


def view_panel(scene, actions, status):
    _mode(scene)
    _background(scene.settings)
    _resolution(scene.settings, status)
    if imgui.button("Reset camera"):
        actions.home()
    imgui.same_line()
    if imgui.button("Focus"):
        actions.focus()
    imgui.same_line()
    if imgui.button("Help"):
        actions.toggle_help()


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
    _checkbox(settings, "checkerboard", "checkerboard")
    _checkbox(settings, "show_handles", "vertices")
    imgui.same_line()
    _checkbox(settings, "show_wireframe", "wireframe")


def _resolution(settings, status):
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
        changed, fps = imgui.slider_float(
            "target", settings.target_fps, SLOWEST, FASTEST, "%.0f frames/s",
            imgui.SliderFlags_.logarithmic.value | imgui.SliderFlags_.always_clamp.value,
        )  # fmt: skip
        imgui.set_item_tooltip("the resolution while things move follows it")
        if changed:
            settings.target_fps = fps
    _checkbox(settings, "accumulate", "average shifted images at rest")
    for line in shown_lines(status):
        imgui.text_disabled(line)


def shown_lines(status) -> tuple[str, str]:
    """The picture as it is: pixels and frame rate, and how far it is refined."""
    fps = 1.0 / max(status.times.frame_seconds(), 1e-6)
    pixels = f"{status.resolution:.0%}, pixels {1.0 / status.resolution:.1f} wide, {fps:.0f} fps"
    if status.refined < 1.0:
        saved = f", {status.saved}" if status.saved else ""
        return pixels, f"{status.refined:.0%} refined{saved}"
    if status.sample_count < 2:
        return pixels, "full"
    return pixels, f"full + {status.sample_count}/{status.most_samples} samples"


def _checkbox(settings, attribute, label):
    changed, value = imgui.checkbox(label, getattr(settings, attribute))
    if changed:
        setattr(settings, attribute, value)
