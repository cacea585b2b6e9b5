"""The strip of tools at the window's left edge: an icon for each, the one in the hand in color."""

from imgui_bundle import imgui

from .icons import icon
from .widgets import highlighted

BUTTON, GAP = 34.0, 3.0  # points: a side of a button, and between two of them
GROUPS = ("grab", "box", "lasso"), ("push", "stiffen", "soften"), ("joints", "bones")
DELETING = ("delete", "delete box", "delete lasso")
ACTIONS = {"push": "toggle_push"}  # of tools, where they aren't called like their action


def strip_width() -> float:
    """What the strip takes of the window [points]."""
    return BUTTON + 2.0 * imgui.get_style().window_padding.x * 0.6


def tool_strip(controls, actions) -> None:
    """Draw it into the window that is being built."""
    imgui.push_style_var(imgui.StyleVar_.item_spacing.value, (GAP, GAP))
    for number, group in enumerate((*GROUPS, DELETING)):
        if number:
            imgui.spacing()
            imgui.separator()
            imgui.spacing()
        for name in group:
            _button(controls, actions, controls.tools[name])
    imgui.pop_style_var()


def _button(controls, actions, tool):
    action = ACTIONS.get(tool.name, tool.name.replace(" ", "_"))
    with highlighted(controls.tool is tool):
        if imgui.button(f"{icon(tool.icon)}##{tool.name}", (BUTTON, BUTTON - 4.0)):
            actions.call(action)
    imgui.set_item_tooltip(f"{actions.with_key(action, tool.title)}\n{tool.hint}")
