"""deformrf view, whose states also say where buttons, fields and items of menus were drawn last.

    python tests/support/watched_viewer.py model.npz --log-events

"widgets" has the middle of each by its label, in points from the window's upper left corner, and
"pose" is a hash of where all vertices are, to the bit.
With CLOSELY in the environment, states come with each frame or so and have "items", all that was
drawn, with what it is and where; "twice", those that have an id that another one has; "popups",
the lists and menus that are open; "failed", panels that failed; and "values", the numbers of
settings, camera, material and timeline.
"""

import hashlib
import os
import sys

NAMES = (
    *("button", "small_button", "radio_button", "checkbox", "combo", "slider_float", "selectable"),
    *("begin_menu", "menu_item_simple", "collapsing_header", "input_text", "input_int2"),
    *("input_text_with_hint", "color_edit3", "tree_node", "invisible_button"),
)
CLOSELY = "WATCHED_CLOSELY"
OFTEN = 0.05  # s between two states
DRAWN = {}  # label: the number of the frame, x and y
ITEMS = {}  # id: the number of the frame, and what is told of it
TWICE = set()  # labels of which two have had one id in a frame: the one gets the other's clicks


def watch():
    """Note what is drawn from now on."""
    from imgui_bundle import imgui

    closely = CLOSELY in os.environ

    def noted(name, draw):
        def draw_and_note(label, *arguments, **named):
            one = _begun(imgui, name, label, arguments) if closely else None
            result = draw(label, *arguments, **named)
            low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
            place = 0.5 * (low.x + high.x), 0.5 * (low.y + high.y)
            DRAWN[label] = imgui.get_frame_count(), *place
            if closely:
                if ITEMS.get(one["id"], (-1,))[0] == imgui.get_frame_count():
                    TWICE.add(f"{label} in {one['window']}")
                one["rect"] = low.x, low.y, high.x, high.y
                one["on"] = result[-1] if isinstance(result, tuple) else result
                ITEMS[one["id"]] = imgui.get_frame_count(), one
            return result

        return draw_and_note

    for name in NAMES:
        setattr(imgui, name, noted(name, getattr(imgui, name)))


def _begun(imgui, kind, label, arguments):
    """What is told of an item before it is drawn."""
    window = imgui.internal.get_current_window()
    inner = window.clip_rect
    disabled = imgui.get_current_context().current_item_flags & imgui.ItemFlags_.disabled.value
    one = {"kind": kind, "label": label, "id": imgui.get_id(label), "window": window.name}
    one |= {"inside": [inner.min.x, inner.min.y, inner.max.x, inner.max.y]}
    one["scrolls"] = window.scroll_max.y > 0.0
    one["disabled"] = bool(disabled)
    if kind == "combo":
        one |= {"chosen": arguments[0], "count": len(arguments[1])}
    return one


def _popups(imgui):
    """Windows of open menus, lists and dialogs: name, rectangle, scroll, first row and height."""
    found = []
    for popup in imgui.get_current_context().open_popup_stack:
        window = popup.window
        if window is not None:
            at, size = window.pos, window.size
            rectangle = at.x, at.y, at.x + size.x, at.y + size.y
            found.append(
                {
                    "name": window.name,
                    "rect": rectangle,
                    "scroll": window.scroll.y,
                    "padding": window.window_padding.y,
                    "row": imgui.get_text_line_height_with_spacing(),
                }
            )
    return found


def _keyed(timeline):
    return {track: [key.tick for key in keys] for track, keys in timeline.keys.items()}


def _values(app):
    from deformrf.viewer.camera import values_of

    scene = app.scene
    body = {n: getattr(scene.body, n) for n in ("meters", "gravity", "air_drag", "wind")}
    strip = {"turn": app.strip.turn_seconds}
    finite = {n: v for n, v in vars(scene.body.material).items() if n != "yield_strain"}
    choices = {k: v for k, v in vars(app.takes.choices).items() if not k.startswith("_")}
    parts = {"body": body, "material": finite, "strip": strip, "camera": values_of(scene.orbit)}
    return parts | {"settings": vars(scene.settings), "film": choices}


def main():
    from deformrf.core.base.children import forget_current_folder

    forget_current_folder()
    from imgui_bundle import imgui

    from deformrf.commands import view
    from deformrf.viewer import events

    watch()
    state_of, closely = events.state_of, CLOSELY in os.environ

    def with_widgets(app):
        last = max((frame for frame, *_ in DRAWN.values()), default=0)
        scale = app.gui.scale
        shown = {n: [scale * x, scale * y] for n, (f, x, y) in DRAWN.items() if f == last}
        state = state_of(app) | {"widgets": shown}
        state["pose"] = hashlib.sha1(app.scene.positions.tobytes()).hexdigest()
        if closely:
            sys.modules["deformrf.viewer.app"].STATE_SECONDS = OFTEN
            state["items"] = [one for frame, one in ITEMS.values() if frame == last]
            state |= {"popups": _popups(imgui), "failed": sorted(app.gui._failed)}
            state["twice"] = sorted(TWICE)
            state |= {"values": _values(app), "said": app.recorder.message, "flying": app.fly.on}
            state["queued"] = len(imgui.get_current_context().input_events_queue)
            state |= {"scale": scale, "mode": app.controls.mode, "project": app.project}
            state |= {"unsaved": app.scene.journal.unsaved, "keyed": _keyed(app.scene.timeline)}
            state |= {"films": app.takes.job is not None, "playing": app.scene.timeline.playing}
            del state["vertices"][40:]
        return state

    events.state_of = with_widgets
    return view.main()


if __name__ == "__main__":
    sys.exit(main())
