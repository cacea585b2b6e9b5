"""The menu bar: made from the table of inputs, by their paths in the menus."""

from pathlib import Path

from imgui_bundle import imgui

from ..files import readable
from ..input import ACTIONS, inputs_of
from ..settings import KEYS
from .hand import hand_switch, switch_width
from .keys import keys_offer, offer_width, offers_keys

BETWEEN = 24.0  # points from the choice of keys to the switch
FIRST, LAST = "File", "Help"  # the others are between them, in the table's order


def menu_tree(inputs) -> dict:
    """Menus as nested dictionaries: title -> items; an item's title -> its Input.

    >>> menu_tree(INPUTS)["Edit"]["Undo"].key
    'CTRL+Z'
    """
    tree = {FIRST: {}}
    for entry in inputs:
        *menus, title = entry.menu.split("/")
        if title:
            menu = tree
            for name in menus:
                menu = menu.setdefault(name, {})
            menu[title] = entry
    return tree | {LAST: tree.pop(LAST, {})}


TREES = {keys: menu_tree(inputs_of(keys)) for keys in KEYS}


def menu_bar(app) -> float:
    """Draw it along the window's upper edge; returns its height [points]."""
    if not imgui.begin_main_menu_bar():
        return 0.0
    app.gui.guarded(_items, app, TREES[app.scene.settings.keys])
    app.gui.guarded(_switch, app)
    app.gui.claim()
    height = imgui.get_window_height()
    imgui.end_main_menu_bar()
    return height


def _switch(app):
    """Physics | Pose at the bar's right end, if there is space beside the menus.

    Left of it the choice of keys, as long as it is offered.
    """
    right = imgui.get_window_width() - switch_width() - imgui.get_style().window_padding.x
    left = right - offer_width() - BETWEEN
    if offers_keys(app) and left > imgui.get_cursor_pos_x():
        imgui.set_cursor_pos_x(left)
        keys_offer(app)
        imgui.same_line()
    imgui.set_cursor_pos_x(max(right, imgui.get_cursor_pos_x()))
    hand_switch(app)


def _items(app, menu):
    for title, item in menu.items():
        if not isinstance(item, dict):
            _item(app, title, item)
            if item.action == "open":
                recent_items(app)
        elif item and imgui.begin_menu(title):
            _items(app, item)
            imgui.end_menu()


def recent_items(app):
    """The files that were opened before."""
    if imgui.begin_menu("Open recent", bool(app.preferences.recent)):
        for number, path in enumerate(map(Path, app.preferences.recent)):
            if imgui.menu_item_simple(f"{readable(path.name)}##{number}"):
                app.asked = path
            imgui.set_item_tooltip(readable(path))
        imgui.end_menu()


def _item(app, title, entry):
    action = ACTIONS[entry.action]
    is_on = hasattr(action, "is_on") and bool(action.is_on(app))
    if imgui.menu_item_simple(title, entry.label, is_on):
        app.log("menu", action=entry.action)
        action(app)
    imgui.set_item_tooltip(entry.help)
