"""The choice of keys, offered once, at the first start, in the menu bar: it covers nothing."""

from imgui_bundle import imgui

from ..input import ACTIONS
from ..settings import KEYS
from .hand import radio_width

TITLE, CLOSE = "Keys:", "x"
LATER = "The menu Help has them, too"


def offers_keys(app) -> bool:
    """Whether the choice shows: preferences are kept, and it was neither made nor closed."""
    return app.preferences.path is not None and not app.scene.settings.has_chosen_keys


def offer_width() -> float:
    """What the choice takes of a line [points]."""
    style = imgui.get_style()
    texts = [imgui.calc_text_size(text).x + style.item_spacing.x for text in (TITLE, CLOSE)]
    buttons = [radio_width(_title(name)) + style.item_spacing.x for name in KEYS.values()]
    return sum(texts + buttons) + 2.0 * style.frame_padding.x


def keys_offer(app) -> None:
    """A button for each of KEYS, and one that leaves them as they are."""
    chosen = app.scene.settings.keys
    imgui.text_disabled(TITLE)
    for keys, name in KEYS.items():
        imgui.same_line()
        if imgui.radio_button(_title(name), chosen == keys):
            ACTIONS[f"keys_{keys}"](app)
        imgui.set_item_tooltip(LATER)
    imgui.same_line()
    if imgui.small_button(CLOSE):
        ACTIONS[f"keys_{chosen}"](app)
    imgui.set_item_tooltip(LATER)


def _title(name):
    return f"{name}'s"
