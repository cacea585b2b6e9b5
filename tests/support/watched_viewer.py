"""deformrf view, whose states also say where buttons, fields and items of menus were drawn last.

    python tests/support/watched_viewer.py model.npz --log-events

"widgets" has the middle of each by its label, in points from the window's upper left corner.
"""

import sys

NAMES = (
    *("button", "small_button", "radio_button", "checkbox", "combo", "slider_float", "selectable"),
    *("begin_menu", "menu_item_simple", "collapsing_header", "input_text", "input_int2"),
    *("input_text_with_hint", "color_edit3"),
)
DRAWN = {}  # label: the number of the frame, x and y


def watch():
    """Note what is drawn from now on."""
    from imgui_bundle import imgui

    def noted(draw):
        def draw_and_note(label, *arguments, **named):
            result = draw(label, *arguments, **named)
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            place = 0.5 * (low.x + high.x), 0.5 * (low.y + high.y)
            DRAWN[label] = imgui.get_frame_count(), *place
            return result

        return draw_and_note

    for name in NAMES:
        setattr(imgui, name, noted(getattr(imgui, name)))


def main():
    from deformrf.core.base.children import forget_current_folder

    forget_current_folder()
    from deformrf.commands import view
    from deformrf.viewer import events

    watch()
    state_of = events.state_of

    def with_widgets(app):
        last = max((frame for frame, *_ in DRAWN.values()), default=0)
        scale = app.gui.scale
        shown = {n: [scale * x, scale * y] for n, (f, x, y) in DRAWN.items() if f == last}
        return state_of(app) | {"widgets": shown}

    events.state_of = with_widgets
    return view.main()


if __name__ == "__main__":
    sys.exit(main())
