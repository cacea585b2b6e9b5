"""Buttons and keys that are held, as numbers."""

# pyglet's; the modules that name them can't be imported without a display.
LEFT, MIDDLE, RIGHT = 1, 2, 4
SHIFT, CTRL, ALT = 1, 2, 4
OTHER_NAMES = {  # of digits: the number pad's, X11's for it without Num Lock, US Shift+digit
    **{f"NUM_{n}": f"_{n}" for n in range(10)},
    **{"NUM_END": "_1", "NUM_PAGE_DOWN": "_3", "NUM_NEXT": "_3", "NUM_BEGIN": "_5"},
    **{"NUM_HOME": "_7", "NUM_LEFT": "_4", "NUM_RIGHT": "_6", "NUM_UP": "_8", "NUM_DOWN": "_2"},
    **{"EXCLAMATION": "_1", "POUND": "_3", "HASH": "_3", "AMPERSAND": "_7"},
}


def key_name(symbol) -> str:
    """Pyglet's name of a key."""
    from pyglet.window import key  # not at the top: it needs a display, or headless mode

    return key.symbol_string(symbol)
