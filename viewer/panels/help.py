"""The help: all gestures and keys, in the sections of the menus, with a field that filters them."""

from itertools import groupby

from imgui_bundle import imgui

from ..actions import SECTIONS, inputs_of, section_of
from .widgets import text_field

WIDTH, HEIGHT = 620.0, 520.0  # points, at most
MARGIN = 30.0


def help_size() -> tuple[float, float]:
    """Of its window."""
    size = imgui.get_io().display_size
    return min(WIDTH, size.x - 2.0 * MARGIN), min(HEIGHT, size.y - 4.0 * MARGIN)


def help_window(settings, gui) -> None:
    """Draw it into the window that is being built."""
    imgui.align_text_to_frame_padding()
    imgui.text("Keys and gestures")
    imgui.same_line(imgui.get_window_width() - 60.0)
    if imgui.button("Close"):
        settings.show_help = False
    gui.help_filter = text_field("##filter", gui.help_filter, "filter: a key, or what it does")
    words = gui.help_filter.lower().split()
    if imgui.begin_child("inputs"):
        entries = [entry for entry in inputs_of(settings.keys) if entry.label]
        for section, group in groupby(sorted(entries, key=_order), section_of):
            shown = [one for one in group if all(w in _told(one) for w in words)]
            if shown:
                imgui.separator_text(section)
                _table(section, shown)
    imgui.end_child()


def _order(entry):
    return SECTIONS.index(section_of(entry))


def _told(entry):
    return f"{entry.label} {entry.help} {entry.menu}".lower()


def _table(name, entries):
    if imgui.begin_table(name, 2, imgui.TableFlags_.sizing_stretch_prop.value):
        imgui.table_setup_column("key", imgui.TableColumnFlags_.width_stretch.value, 0.34)
        imgui.table_setup_column("help", imgui.TableColumnFlags_.width_stretch.value, 0.66)
        for entry in entries:
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.text_wrapped(entry.label)
            imgui.table_next_column()
            imgui.text_wrapped(entry.help)
        imgui.end_table()
