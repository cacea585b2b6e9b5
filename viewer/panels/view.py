"""How the picture looks, and with how many pixels it is rendered."""

from imgui_bundle import imgui

RESOLUTIONS = {"automatic": None, "full": 1.0, "1/2": 0.5, "1/4": 0.25}


def view_panel(scene, actions, status):
    settings = scene.settings
    changed, color = imgui.color_edit3(
        "background", list(settings.background), imgui.ColorEditFlags_.no_inputs.value
    )
    if changed:
        settings.background = tuple(color)[:3]
    for attribute, label in (
        ("show_handles", "vertices"),
        ("show_wireframe", "wireframe"),
    ):
        imgui.same_line()
        changed, shown = imgui.checkbox(label, getattr(settings, attribute))
        if changed:
            setattr(settings, attribute, shown)
    _resolution(settings, status)
    if imgui.button("Reset camera"):
        actions.home()
    imgui.same_line()
    if imgui.button("Focus"):
        actions.focus()
    imgui.same_line()
    if imgui.button("Help"):
        actions.toggle_help()


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
    imgui.text_disabled(f"shown: {status.resolution:.0%}, {status.refined:.0%} refined")
