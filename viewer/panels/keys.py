"""The choice of keys, offered once, at the first start, in the menu bar: it covers nothing."""

from imgui_bundle import imgui

from ..settings import KEYS

TITLE, CLOSE = "Keys:", "x"
LATER = "The menu Help has them, too"


def offers_keys(preferences, settings) -> bool:
    """Whether the choice shows: preferences are kept, and it was neither made nor closed."""
    return preferences.path is not None and not settings.has_chosen_keys


def offer_width() -> float:
    """What the choice takes of a line [points]."""
    style, names = imgui.get_style(), [f"{name}'s" for name in KEYS.values()]
    words = sum(
        imgui.calc_text_size(one).x + style.item_spacing.x for one in (TITLE, CLOSE, *names)
    )
    rings = len(KEYS) * (imgui.get_frame_height() + style.item_inner_spacing.x)
    return words + rings + 2.0 * style.frame_padding.x


def keys_offer(settings, actions) -> None:
    """A button for each of KEYS, and one that leaves them as they are."""
    imgui.text_disabled(TITLE)
    for keys, name in KEYS.items():
        imgui.same_line()
        if imgui.radio_button(f"{name}'s", settings.keys == keys):
            actions.call(f"keys_{keys}")
        imgui.set_item_tooltip(LATER)
    imgui.same_line()
    if imgui.small_button(CLOSE):
        actions.call(f"keys_{settings.keys}")
    imgui.set_item_tooltip(LATER)
