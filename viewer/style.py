"""The looks of the panels: shapes, and the colors of THEMES.

Neutral grays, so that they don't tint what one sees of the picture; one color for what is chosen.
"""

from imgui_bundle import imgui

ACCENT = {"dark": (0.98, 0.40, 0.25), "light": (0.80, 0.16, 0.13)}  # the control vertices' red
GRAYS = {  # of the window, fields, hovered fields, buttons, headers, lines, text, faint text
    "dark": (0.145, 0.225, 0.28, 0.25, 0.20, 0.36, 0.92, 0.66),
    "light": (0.965, 0.885, 0.85, 0.865, 0.915, 0.76, 0.10, 0.38),
}


def accent(theme: str, alpha: float = 1.0) -> tuple[float, float, float, float]:
    """The color of what is chosen."""
    return (*ACCENT[theme], alpha)


def apply_style(theme: str) -> None:
    """Give the panels the shapes of all themes, and the colors of one."""
    style, colors = imgui.get_style(), imgui.Col_
    (imgui.style_colors_dark if theme == "dark" else imgui.style_colors_light)()
    style.window_rounding, style.frame_rounding, style.grab_rounding = 6.0, 4.0, 4.0
    style.popup_rounding, style.scrollbar_size = 6.0, 10.0
    style.window_border_size, style.frame_border_size = 1.0, 0.0
    style.window_padding, style.frame_padding = (10.0, 8.0), (7.0, 4.0)
    style.item_spacing, style.item_inner_spacing = (7.0, 6.0), (6.0, 4.0)
    style.separator_text_border_size = 1.0
    window, field, hovered, button, header, line, text, faint = (
        (gray, gray, gray + 0.008) for gray in GRAYS[theme]
    )
    for name, color in {
        colors.text: (*text, 1.0),
        colors.text_disabled: (*faint, 1.0),
        colors.window_bg: (*window, 0.97),
        colors.popup_bg: (*window, 0.99),
        colors.menu_bar_bg: (*window, 1.0),
        colors.border: (*line, 0.6),
        colors.separator: (*line, 0.8),
        colors.frame_bg: (*field, 1.0),
        colors.frame_bg_hovered: (*hovered, 1.0),
        colors.frame_bg_active: (*hovered, 1.0),
        colors.button: (*button, 1.0),
        colors.button_hovered: accent(theme, 0.45),
        colors.button_active: accent(theme, 0.7),
        colors.header: (*header, 1.0),
        colors.header_hovered: accent(theme, 0.25),
        colors.header_active: accent(theme, 0.4),
        colors.slider_grab: accent(theme, 0.4),
        colors.slider_grab_active: accent(theme, 0.9),
        colors.check_mark: accent(theme),
        colors.scrollbar_bg: (0.0, 0.0, 0.0, 0.0),
        colors.scrollbar_grab: (*line, 1.0),
        colors.modal_window_dim_bg: (0.0, 0.0, 0.0, 0.25),  # over what a dialog keeps from input
        colors.plot_lines: accent(theme),
        colors.plot_histogram: accent(theme, 0.6),  # progress bars
    }.items():
        style.set_color_(name, color)
