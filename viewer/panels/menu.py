"""The menu bar: made from the table of inputs, by their paths in the menus.

At its right are the search, the choice of keys while it is offered (once, at the first start: there
it covers nothing), and the switch that says what becomes of what a hand lets go.
"""

from pathlib import Path

from imgui_bundle import imgui

from ..actions import inputs_of
from ..files import readable
from ..settings import HANDS, KEYS
from .widgets import button, icon, radio, segments

BETWEEN = 16.0  # points between two groups at the right
SEARCH_WIDTHS = 150.0, 82.0, 32.0  # of the search with its key, its word, or without
KEYS_TITLE, KEYS_CLOSE = "Keys:", "x"
KEYS_LATER = "The menu Help has them, too"
HAND_TITLE, HAND_WORDS = "When let go:", dict(zip(HANDS, ("springs back", "stays"), strict=True))
HAND_TOLD = {
    "physics": "What you let go swings back",
    "pose": "What you let go stays where it is, violet; a click on it frees it",
}
LINE = "-"  # before a title, under which a line is drawn


def menu_tree(inputs) -> dict:
    """Menus as nested dictionaries: title -> items; an item's title -> its Input.

    A line between items is an item LINE with a number, whose Input is None.

    >>> menu_tree(INPUTS)["Edit"]["Undo"].key
    'CTRL+Z'
    """
    tree = {}
    for entry in inputs:
        *menus, last = entry.menu.split("/")
        if last:
            menu = tree
            for name in menus:
                menu = _after_line(menu, name).setdefault(name.removeprefix(LINE), {})
            _after_line(menu, last)[last.removeprefix(LINE)] = entry
    return tree


def _after_line(menu, title):
    """The menu, with a line before a title that asks for one and isn't there yet."""
    if title.startswith(LINE) and title.removeprefix(LINE) not in menu:
        menu[f"{LINE}{len(menu)}"] = None
    return menu


TREES = {keys: menu_tree(inputs_of(keys)) for keys in KEYS}


def menu_bar(settings, handles, controls, actions, preferences, opening) -> None:
    """Draw it along the window's upper edge: at the right what there is space for."""
    _items(TREES[settings.keys], actions, preferences, opening)
    ways = ("left", "undo", controls.undoes), ("right", "redo", controls.redoes)
    for way, action, label in ways:
        imgui.begin_disabled(not label)
        button(actions, action, f"{icon(f'rotate_{way}')}##{action}")
        imgui.end_disabled()
    left = imgui.get_cursor_pos_x()
    end = imgui.get_window_width() - imgui.get_style().window_padding.x
    offered = offer_width() + BETWEEN if offers_keys(preferences, settings) else 0.0
    titled = end - switch_width(True) > left
    right = end - switch_width(titled)
    space = right - BETWEEN - left - offered
    left_out = next((n for n, width in enumerate(SEARCH_WIDTHS) if width < space), 2)
    width, words = SEARCH_WIDTHS[left_out], ("  Search", f"   {actions.label('search')}")
    place = right - width - BETWEEN
    if place > left:
        if offered and place - offered > left:
            imgui.set_cursor_pos_x(place - offered)
            keys_offer(settings, actions)
            imgui.same_line()
        imgui.set_cursor_pos_x(place)
        label = icon("magnifying_glass") + "".join(words[: 2 - left_out])
        button(actions, "search", label, width)
    imgui.set_cursor_pos_x(max(right, imgui.get_cursor_pos_x()))
    hand_switch(settings, handles, actions, titled)


def switch_width(titled: bool) -> float:
    """What the switch of the hand takes of a line [points]."""
    style = imgui.get_style()
    words = _width(HAND_WORDS.values(), 2.0 * style.frame_padding.x + 1.0)
    return words + titled * _width([HAND_TITLE], style.item_spacing.x)


def _width(words, beside):
    """What words take of a line, each with so much beside it [points]."""
    return sum(imgui.calc_text_size(word).x + beside for word in words)


def hand_switch(settings, handles, actions, titled: bool) -> None:
    """A button for each of HANDS: always in sight."""
    if titled:
        imgui.text_disabled(HAND_TITLE)
        imgui.same_line()

    def told(hand):
        return actions.told("pose", HAND_TOLD[hand])

    segments(HAND_WORDS, settings.hand, handles.choose_hand, told)


# -- the choice of keys ------------------------------------------------------------------------


def offers_keys(preferences, settings) -> bool:
    """Whether the choice shows: preferences are kept, and it was neither made nor closed."""
    return preferences.path is not None and not settings.has_chosen_keys


def offer_width() -> float:
    """What the choice takes of a line [points]."""
    style, names = imgui.get_style(), [f"{name}'s" for name in KEYS.values()]
    words = _width([KEYS_TITLE, KEYS_CLOSE, *names], style.item_spacing.x)
    rings = len(KEYS) * (imgui.get_frame_height() + style.item_inner_spacing.x)
    return words + rings + 2.0 * style.frame_padding.x


def keys_offer(settings, actions) -> None:
    """A button for each of KEYS, and one that leaves them as they are."""
    imgui.text_disabled(KEYS_TITLE)
    for keys, name in KEYS.items():
        imgui.same_line()
        if radio(f"{name}'s", settings.keys == keys):
            actions.call(f"keys_{keys}")
        imgui.set_item_tooltip(KEYS_LATER)
    imgui.same_line()
    if imgui.small_button(KEYS_CLOSE):
        actions.call(f"keys_{settings.keys}")
    imgui.set_item_tooltip(KEYS_LATER)


# -- the menus ---------------------------------------------------------------------------------


def _items(menu, actions, preferences, opening):
    for title, item in menu.items():
        if item is None:
            imgui.separator()
        elif not isinstance(item, dict):
            on = actions.is_on(item.action)
            shown = item.stop if on and item.stop else title
            if imgui.menu_item_simple(shown, item.label, on and not item.stop):
                actions.call(item.action)
            imgui.set_item_tooltip(item.help)
            if item.action == "open":
                recent_items(preferences, opening)
        elif item and imgui.begin_menu(title):
            _items(item, actions, preferences, opening)
            imgui.end_menu()


def recent_items(preferences, opening):
    """The files that were opened before."""
    if imgui.begin_menu("Open recent", bool(preferences.recent)):
        for number, path in enumerate(map(Path, preferences.recent)):
            if imgui.menu_item_simple(f"{readable(path.name)}##{number}"):
                opening.asked = path
            imgui.set_item_tooltip(readable(path))
        imgui.end_menu()
