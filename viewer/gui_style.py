"""How the panels look: light, with the red of the control vertices."""

from pathlib import Path

import imgui_bundle
from imgui_bundle import imgui

FONT = Path(imgui_bundle.__file__).parent / "assets" / "fonts" / "Roboto" / "Roboto-Regular.ttf"
FONT_SIZE = 16.0
ACCENT = (0.80, 0.16, 0.13)  # the red of the control vertices


def apply_style() -> None:
    """Set font, shapes and colors of the current ImGui context."""
    if FONT.is_file():
        imgui.get_io().fonts.add_font_from_file_ttf(str(FONT), FONT_SIZE)
    style = imgui.get_style()
    imgui.style_colors_light()
    style.window_rounding, style.frame_rounding, style.grab_rounding = 8.0, 4.0, 4.0
    style.window_border_size, style.frame_border_size = 1.0, 0.0
    style.window_padding, style.frame_padding = (12.0, 10.0), (8.0, 4.0)
    style.item_spacing = (8.0, 6.0)
    colors = imgui.Col_
    dark = tuple(0.8 * c for c in ACCENT)
    for name, color in {
        colors.text_disabled: (0.38, 0.39, 0.42, 1.0),
        colors.window_bg: (0.97, 0.97, 0.98, 0.94),
        colors.border: (0.0, 0.0, 0.0, 0.12),
        colors.title_bg: (0.90, 0.90, 0.92, 0.96),
        colors.title_bg_active: (0.90, 0.90, 0.92, 0.96),
        colors.frame_bg: (0.88, 0.89, 0.91, 1.0),
        colors.frame_bg_hovered: (0.84, 0.85, 0.88, 1.0),
        colors.frame_bg_active: (0.80, 0.81, 0.85, 1.0),
        colors.button: (0.86, 0.87, 0.90, 1.0),
        colors.button_hovered: (*ACCENT, 0.35),
        colors.button_active: (*ACCENT, 0.6),
        colors.header: (0.90, 0.90, 0.92, 1.0),
        colors.header_hovered: (*ACCENT, 0.2),
        colors.header_active: (*ACCENT, 0.35),
        colors.slider_grab: (*ACCENT, 0.9),
        colors.slider_grab_active: (*dark, 1.0),
        colors.check_mark: (*ACCENT, 1.0),
        colors.plot_lines: (*ACCENT, 1.0),
        colors.plot_histogram: (*ACCENT, 0.75),  # progress bars
    }.items():
        style.set_color_(name, color)
