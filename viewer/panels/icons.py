"""Icons by their names: glyphs of Font Awesome 6, which comes with imgui-bundle."""

from imgui_bundle import icons_fontawesome_6


def icon(name: str) -> str:
    """The glyph of a name, as "hand_pointer"."""
    return getattr(icons_fontawesome_6, f"ICON_FA_{name.upper()}")
