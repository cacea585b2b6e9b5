"""The switch that is always in sight: what becomes of what a hand lets go."""

from imgui_bundle import imgui

from ..settings import HANDS
from .widgets import segments

TOLD = {
    "physics": "what you let go swings back",
    "pose": "what you let go stays where it is, golden; a click on it lets it go",
}
WORDS = {hand: hand.capitalize() for hand in HANDS}


def switch_width() -> float:
    """What the switch takes of a line [points]."""
    padding = 2.0 * imgui.get_style().frame_padding.x
    return sum(imgui.calc_text_size(word).x + padding + 1.0 for word in WORDS.values())


def hand_switch(settings, handles, actions) -> None:
    """A button for each of HANDS."""
    segments(
        WORDS,
        settings.hand,
        handles.choose_hand,
        lambda hand: actions.with_key("pose", TOLD[hand]),
    )
