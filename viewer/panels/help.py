"""The help: all gestures and keys by tasks, that of the panel first; a field filters them."""

from imgui_bundle import imgui, imgui_ctx

from ..actions import SECTIONS, inputs_of, section_of, told_of
from .widgets import section, text_field

WIDTH, HEIGHT = 620.0, 520.0  # points, at most
MARGIN = 30.0


def help_size() -> tuple[float, float]:
    """Of its window."""
    size = imgui.get_io().display_size
    return min(WIDTH, size.x - 2.0 * MARGIN), min(HEIGHT, size.y - 4.0 * MARGIN)


def help_window(settings, gui) -> None:
    imgui.align_text_to_frame_padding()
    imgui.text("Keys and gestures")
    imgui.same_line(imgui.get_window_width() - 60.0)
    if imgui.button("Close"):
        settings.show_help = False
    gui.help_filter = text_field("##filter", gui.help_filter, "filter: a key, or what it does")
    task = settings.task.capitalize()
    entries = [one for one in inputs_of(settings.keys) if one.label]
    found = [one for one in entries if told_of(one, gui.help_filter)]
    with imgui_ctx.begin_child("inputs"):
        for name in sorted(SECTIONS, key=lambda name: name != task):  # the others as they are
            shown = [one for one in found if section_of(one) == name]
            if shown and section(name):
                _table(name, shown)
        if not found:
            imgui.text_disabled("nothing is called so")


def _table(name, entries):
    if imgui.begin_table(name, 2, imgui.TableFlags_.sizing_stretch_prop.value):
        imgui.table_setup_column("key", imgui.TableColumnFlags_.width_stretch.value, 0.34)
        imgui.table_setup_column("help", imgui.TableColumnFlags_.width_stretch.value, 0.66)
        for text in (text for entry in entries for text in (entry.label, entry.help)):
            imgui.table_next_column()
            imgui.text_wrapped(text)
        imgui.end_table()
