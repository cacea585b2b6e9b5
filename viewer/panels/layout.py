"""Where the panels are: one window with sections, the help overlay, the line of messages."""

from imgui_bundle import imgui

from .deform import deform_panel
from .help import help_overlay, hints_panel
from .model import model_panel
from .record import record_panel
from .stats import stats_panel
from .view import view_panel

SECTIONS = (
    ("Model", model_panel, True),
    ("Bend", deform_panel, True),
    ("View", view_panel, True),
    ("Record", record_panel, True),
    ("Time", stats_panel, False),
    ("Mouse", hints_panel, True),
)
PANEL_WIDTH = 330.0
MARGIN = 12.0
FLOATING = (
    imgui.WindowFlags_.no_decoration.value
    | imgui.WindowFlags_.no_saved_settings.value
    | imgui.WindowFlags_.always_auto_resize.value
    | imgui.WindowFlags_.no_nav.value
)


def draw_panels(gui, scene, actions, status) -> None:
    """Everything that lies over the view."""
    if scene.settings.show_panel:
        _main_panel(gui, scene, actions, status)
    if scene.settings.show_help:
        _help(gui, scene, actions, status)
    if status.message:
        show_message(status.message)


def _main_panel(gui, scene, actions, status):
    height = imgui.get_io().display_size.y
    imgui.set_next_window_pos((MARGIN, MARGIN), imgui.Cond_.first_use_ever.value)
    imgui.set_next_window_size_constraints(
        (PANEL_WIDTH, 0.0), (PANEL_WIDTH, max(height - 2.0 * MARGIN, 100.0))
    )
    imgui.begin("deformrf", flags=imgui.WindowFlags_.always_auto_resize.value)
    imgui.push_item_width(0.52 * PANEL_WIDTH)
    for title, panel, is_open in SECTIONS:
        flags = imgui.TreeNodeFlags_.default_open.value if is_open else 0
        if imgui.collapsing_header(title, flags):
            imgui.push_id(title)  # a button may be called like a header, as Record is
            gui.guarded(panel, scene, actions, status)
            imgui.pop_id()
    imgui.pop_item_width()
    gui.claim()
    imgui.end()


def _help(gui, scene, actions, status):
    size = imgui.get_io().display_size
    imgui.set_next_window_pos((0.5 * size.x, 0.5 * size.y), pivot=(0.5, 0.5))
    imgui.begin("help", flags=FLOATING)
    gui.guarded(help_overlay, scene, actions, status)
    gui.claim()
    imgui.end()


def show_message(text: str) -> None:
    """One line at the bottom of the window."""
    size = imgui.get_io().display_size
    imgui.set_next_window_pos((0.5 * size.x, size.y - MARGIN), pivot=(0.5, 1.0))
    imgui.begin("message", flags=FLOATING | imgui.WindowFlags_.no_inputs.value)
    imgui.text(text)
    imgui.end()
