"""The switch that is always in sight: what becomes of what a hand lets go."""

from imgui_bundle import imgui

from ..settings import HANDS
from .widgets import with_key

TOLD = {
    "physics": "what you let go swings back",
    "pose": "what you let go stays where it is, golden; a click on it lets it go",
}


def switch_width() -> float:
    """What the switch takes of a line [points]."""
    own = sum(radio_width(hand.capitalize()) for hand in HANDS)
    return own + imgui.get_style().item_spacing.x * (len(HANDS) - 1)


def radio_width(title: str) -> float:
    """What a radio button takes of a line [points]."""
    spacing = imgui.get_style().item_inner_spacing.x
    return imgui.get_frame_height() + spacing + imgui.calc_text_size(title).x


def hand_switch(app) -> None:
    """A button for each of HANDS."""
    for hand in HANDS:
        if hand != HANDS[0]:
            imgui.same_line()
        if imgui.radio_button(hand.capitalize(), app.scene.settings.hand == hand):
            app.scene.handles.choose_hand(hand)
        imgui.set_item_tooltip(with_key(app, "pose", TOLD[hand]))
