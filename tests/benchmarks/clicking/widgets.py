"""Every button, box, list, slider and field of the panels is used."""

from functools import partial

from .hand import TEXTS, Gone

TASKS = "Bend", "Rig", "Animate", "Film", "View"
MOST = 150  # widgets of a task
BUTTONS = "button", "small_button", "radio_button", "selectable"
FIELDS = "input_text", "input_text_with_hint"
MENUS = "begin_menu", "menu_item_simple"


def every_widget(hand, again):
    """Use all that the five tasks show; returns the last window."""
    done = set()
    for task in TASKS:
        part = f"task {task}"
        hand = _safely(hand, again, part, "its button", partial(_go, task=task))
        for _ in range(MOST):
            try:
                one = _next(hand, task, done)
            except (Gone, TimeoutError) as error:
                hand.note(part, "looking", f"{type(error).__name__}: {error}")
                hand = again(hand)
                continue
            if one is None:
                break
            step = f"{one['kind']} {one['label']!r}"
            one_use = partial(_use_once, part=part, one=one, step=step, task=task)
            hand = _safely(hand, again, part, step, one_use)
    return hand


def _use_once(hand, part, one, step, task):
    hand.tally.tried(part, one["kind"])
    use(hand, part, one, step)
    hand.check(part, step)
    hand.calm()
    _go(hand, task)


def _safely(hand, again, part, step, call):
    try:
        call(hand)
    except (Gone, TimeoutError) as error:
        hand.note(part, step, f"{type(error).__name__}: {error}")
        hand = again(hand)
    return hand


def _go(hand, task):
    """Show the panel of a task."""
    state = hand.calm()
    if state["values"]["settings"]["task"] != task.lower():
        one = next(i for i in state["items"] if i["label"].endswith(f"##{task.lower()}"))
        hand.reach_and_click(one["id"])
    if task == "Animate" and not hand.fresh()["values"]["settings"]["show_timeline"]:
        hand.keys("shift+t")


def _next(hand, task, done):
    """Something that was not used yet, the task's own first."""
    items = [i for i in hand.fresh()["items"] if i["kind"] not in MENUS and not i["disabled"]]
    items.sort(key=lambda i: (i["kind"] == "collapsing_header", i["kind"] == "small_button"))
    for one in items:
        own = "task" in one["window"] and "##" + task.lower() not in one["label"]
        key = (task if own else "", one["id"], one["label"])
        if key not in done:
            done.add(key)
            return one
    return None


def use(hand, part, one, step):
    key, kind = one["id"], one["kind"]
    if hand.reach(key, kind) is None:
        if hand.item(key, kind) is not None:
            hand.note(part, step, "is out of sight")
    elif kind == "combo":
        _choose_each(hand, part, one, step)
    elif kind == "slider_float":
        _type_each(hand, part, one, step, ctrl=True)
        x, y = hand.reach(key, kind) or (0, 0)
        hand.drag((x, y), (12, 0), steps=2)
    elif kind in FIELDS:
        _type_each(hand, part, one, step)
    elif kind == "input_int2":
        _type_each(hand, part, one, step, share=0.25)
        _type_each(hand, part, one, step, share=0.75)
    elif kind == "color_edit3":
        _pick_colors(hand, part, one, step)
    elif kind == "invisible_button":
        _drag_over(hand, part, one, step)
    elif kind in ("checkbox", "collapsing_header", "tree_node"):
        _on_and_off(hand, part, one, step)
    else:
        hand.reach_and_click(key, kind)


def _on_and_off(hand, part, one, step):
    """Twice; heads stay open."""
    key, kind = one["id"], one["kind"]
    for _ in range(2):
        hand.reach_and_click(key, kind)
        hand.check(part, step)
        if kind != "checkbox":
            break
        hand.calm()
    one = hand.item(key, kind)
    if one is not None and kind != "checkbox" and not one["on"]:
        hand.reach_and_click(key, kind)


def choose(hand, one, number) -> bool:
    """Click on a value of a list, by its number; whether the list has opened."""
    hand.next_state()  # what was chosen before may have moved it
    if not hand.reach_and_click(one["id"], "combo"):
        return False
    for _ in range(20):
        state = hand.fresh()
        popups = [p for p in state["popups"] if "Combo" in p["name"]]
        if not popups:
            return False
        popup, scale = popups[-1], state["scale"]
        left, top, right, low = popup["rect"]
        y = top + popup["padding"] + (number + 0.45) * popup["row"] - popup["scroll"]
        if top + 2 < y < low - 2:
            break
        hand.move(scale * 0.5 * (left + right), scale * 0.5 * (top + low))
        hand.tool("click", 5 if y >= low - 2 else 4)
    hand.click(scale * (left + 20.0), scale * y)
    return True


def _choose_each(hand, part, one, step):
    """Every value of a list, the one that was chosen last."""
    count, chosen = one["count"], one["chosen"]
    for number in [*(n for n in range(count) if n != chosen), chosen]:
        if not choose(hand, one, number):
            if hand.item(one["id"], "combo") is not None:
                hand.note(part, step, "its list doesn't open")
            return
        hand.check(part, f"{step}, value {number}")
        hand.tally.tried(part, "values of lists")
        now = hand.item(one["id"], "combo")
        if now is not None and now["chosen"] != number and now["count"] == count:
            # "custom" and the like can't be chosen.
            hand.tally.tried(part, "values that say what else is so")
        hand.calm()


def _type_each(hand, part, one, step, ctrl=False, share=None):
    """All texts into a field."""
    for name, text in TEXTS.items():
        place = hand.reach(one["id"], one["kind"])
        if place is None:
            return
        if share is not None:
            left, _, right, _ = hand.item(one["id"], one["kind"])["rect"]
            place = hand.state()["scale"] * (left + share * (right - left)), place[1]
        hand.move(*place)
        if ctrl:
            hand.tool("keydown", "ctrl", "click", 1, "keyup", "ctrl")
        else:
            hand.tool("click", 1)
        hand.fresh()
        hand.keys("ctrl+a")
        hand.type(text)
        hand.keys("Tab" if hand.stays else "Return")  # which would answer what is asked
        hand.check(part, f"{step}, {name}")
        hand.tally.tried(part, f"typed: {name}")
        hand.calm()


def _pick_colors(hand, part, one, step):
    """Clicks all over the box in which colors are chosen, and texts into its fields."""
    for row in range(8):
        if not hand.reach_and_click(one["id"], one["kind"]):
            return
        state = hand.fresh()
        if not state["popups"]:
            hand.note(part, step, "its box doesn't open")
            return
        (left, top, right, low), scale = state["popups"][-1]["rect"], state["scale"]
        for column, text in ((0.2, "nan"), (0.5, "1e400"), (0.8, "-inf")):
            x, y = left + column * (right - left), top + (row + 0.5) / 8.0 * (low - top)
            hand.click(scale * x, scale * y)
            hand.keys("ctrl+a")
            hand.type(text)
            hand.keys("Return")
            hand.check(part, f"{step}, {text} at {column} {row}")
        hand.calm()


def _drag_over(hand, part, one, step):
    """Clicks and drags on the tracks of the timeline."""
    left, top, right, low = one["rect"]
    scale = hand.state()["scale"]
    for share in (0.02, 0.3, 0.6, 0.98):
        for height in (0.15, 0.5, 0.85):
            x, y = left + share * (right - left), top + height * (low - top)
            hand.drag((scale * x, scale * y), (40 if share < 0.5 else -40, 0), steps=2)
            hand.check(part, f"{step} at {share} {height}")
