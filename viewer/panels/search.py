"""The search over all actions: what is typed filters them, Enter calls the chosen one."""

from imgui_bundle import imgui

from .widgets import was_entered

HEIGHT = 300.0
WAYS = {imgui.Key.up_arrow: -1, imgui.Key.down_arrow: 1}


def search_window(search, questions, actions, settings, width) -> None:
    """Draw it; the dialog is gone when an action is called."""
    if imgui.is_window_appearing():
        imgui.set_keyboard_focus_here()
    imgui.set_next_item_width(width)
    changed, search.text = imgui.input_text_with_hint("##search", "what to do", search.text)
    found = search.found(settings.keys)
    if changed:
        search.number = 0
    for key, by in WAYS.items():
        if imgui.is_key_pressed(key):
            search.move(by, len(found))
    entered = was_entered() and search.text.strip() and search.number < len(found)
    chosen = found[search.number] if entered else None
    height = min(HEIGHT, imgui.get_io().display_size.y - 120.0)
    if imgui.begin_child("found", (width, max(height, 60.0))):
        for number, entry in enumerate(found):
            chosen = _row(entry, number == search.number, width) or chosen
        if not found:
            imgui.text_disabled("nothing is called so")
    imgui.end_child()
    imgui.text_disabled("Up, Down: choose; Enter: do it; Esc: back")
    if chosen is not None:
        questions.dialog = None
        actions.call(chosen.action)


def _row(entry, is_chosen, width):
    """One action; it is returned when it is clicked."""
    clicked = imgui.selectable(f"{entry.title}##{entry.action}", is_chosen)[0]
    if is_chosen and imgui.is_window_focused():
        imgui.set_scroll_here_y()
    menu = entry.menu.rpartition("/")[0].replace("/", " > ").replace("-", "")
    for text, place in ((menu, 0.45), (entry.label, 0.8)):
        imgui.same_line(place * width)
        imgui.text_disabled(text)
    return entry if clicked else None
