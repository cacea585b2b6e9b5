"""The window that offers to train a model of photographs."""

from imgui_bundle import imgui


def offer_panel(offer, begin, width) -> bool:
    """Ask whether photographs shall be trained; whether the user has answered."""
    imgui.text(offer.title)
    imgui.push_text_wrap_pos(width)
    for line in offer.lines():
        imgui.text_wrapped(line)
    imgui.pop_text_wrap_pos()
    if imgui.button("Train"):
        begin()
        return True
    imgui.same_line()
    return imgui.button("Not now")
