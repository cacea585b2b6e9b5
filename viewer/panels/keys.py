"""The choice of keys that is offered once, at the first start."""

from imgui_bundle import imgui

from ..input import ACTIONS
from ..questions import question
from ..settings import KEYS

LATER = "Help in the menus has them, too"


def offers_keys(app) -> bool:
    """Whether the choice shows: preferences are kept, and it was neither made nor closed."""
    is_new = app.preferences.path is not None and not app.scene.settings.has_chosen_keys
    return is_new and not (app.fly.on or app.takes.job or question(app))


def keys_offer(app) -> None:
    """A button for each of KEYS, and one that leaves them as they are."""
    settings = app.scene.settings
    imgui.align_text_to_frame_padding()
    imgui.text("Keys:")
    for keys, name in KEYS.items():
        imgui.same_line()
        if imgui.radio_button(f"{name}'s", settings.keys == keys):
            ACTIONS[f"keys_{keys}"](app)
        imgui.set_item_tooltip(LATER)
    imgui.same_line()
    if imgui.small_button("x"):
        settings.has_chosen_keys = True
    imgui.set_item_tooltip(LATER)
