"""The switch that is always in sight: what becomes of what a hand lets go."""

from imgui_bundle import imgui

from ..settings import HANDS
from .widgets import segments

TOLD = {
    "physics": "Physics: what you let go swings back",
    "pose": "Pose: what you let go stays where it is, golden; a click on it frees it",
}
TITLE = "When let go:"
WORDS = dict(zip(HANDS, ("springs back", "stays"), strict=True))


def switch_width(titled: bool) -> float:
    """What the switch takes of a line [points]."""
    padding = 2.0 * imgui.get_style().frame_padding.x
    words = sum(imgui.calc_text_size(word).x + padding + 1.0 for word in WORDS.values())
    title = imgui.calc_text_size(TITLE).x + imgui.get_style().item_spacing.x
    return words + title * titled


def hand_switch(settings, handles, actions, titled: bool) -> None:
    """A button for each of HANDS."""
    if titled:
        imgui.text_disabled(TITLE)
        imgui.same_line()
    segments(
        WORDS,
        settings.hand,
        handles.choose_hand,
        lambda hand: actions.with_key("pose", TOLD[hand]),
    )
