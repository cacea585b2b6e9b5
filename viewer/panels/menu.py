"""The menu bar: made from the table of inputs, by their paths in the menus."""

from pathlib import Path

from imgui_bundle import imgui

from ..actions import inputs_of
from ..files import readable
from ..settings import KEYS
from .hand import hand_switch, switch_width
from .icons import icon
from .keys import keys_offer, offer_width, offers_keys
from .widgets import button, icon_button

BETWEEN = 16.0  # points between two groups at the right
SEARCH_WIDTH = 150.0
UNDO = {"rotate_left": "undo", "rotate_right": "redo"}  # icons, and what they call
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


def menu_bar(settings, handles, actions, preferences, opening) -> None:
    """Draw it along the window's upper edge.

    At its right end what becomes of what is let go, with its title in a wide window; left of it,
    where there is space beside the menus, the search and the choice of keys, while it is offered.
    """
    _items(TREES[settings.keys], actions, preferences, opening)
    for glyph, action in UNDO.items():
        icon_button(glyph, actions, action)
    left = imgui.get_cursor_pos_x()
    end = imgui.get_window_width() - imgui.get_style().window_padding.x
    offered = offer_width() + BETWEEN if offers_keys(preferences, settings) else 0.0
    beside = left + offered + SEARCH_WIDTH + BETWEEN
    titled = end - switch_width(True) > beside
    right = end - switch_width(titled)
    place = right - SEARCH_WIDTH - BETWEEN
    if place > left:
        keys_place = place - offered
        if offered and keys_place > left:
            imgui.set_cursor_pos_x(keys_place)
            keys_offer(settings, actions)
            imgui.same_line()
        imgui.set_cursor_pos_x(place)
        label = f"{icon('magnifying_glass')}  Search   {actions.label('search')}"
        button(label, actions, "search", "all actions, by their names", SEARCH_WIDTH)
    imgui.set_cursor_pos_x(max(right, imgui.get_cursor_pos_x()))
    hand_switch(settings, handles, actions, titled)


def _items(menu, actions, preferences, opening):
    for title, item in menu.items():
        if item is None:
            imgui.separator()
        elif not isinstance(item, dict):
            _item(title, item, actions)
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


def _item(title, entry, actions):
    if imgui.menu_item_simple(title, entry.label, actions.is_on(entry.action)):
        actions.call(entry.action)
    imgui.set_item_tooltip(entry.help)
