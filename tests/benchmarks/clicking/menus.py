"""Every entry of every menu is clicked on."""

from .hand import MAIN, Gone

PART = "menus"
KEYS = "Help", "Keys of deformrf"


def every_entry(hand, again) -> object:
    """Click on each; `again` gives another window after one has ended.  Returns the last window."""
    paths = paths_of(hand)
    for path in paths:
        step = " > ".join(path)
        hand.tally.tried(PART, path[0])
        try:
            if path[-1] == "Quit":
                hand.bend()
            if not press(hand, path):
                hand.note(PART, step, "is out of sight")
            state = hand.check(PART, step)
            if path[-1] == "Quit" and state["question"] != "leaving":
                hand.note(PART, step, "no question about unsaved work")
            state = hand.calm()
            if state["values"]["settings"]["keys"] != "deformrf" and not press(hand, KEYS):
                hand.note(PART, step, "keys can't be chosen back")
        except (Gone, TimeoutError) as error:
            hand.note(PART, step, f"{type(error).__name__}: {error}")
            hand = again(hand)
    return hand


def paths_of(hand):
    """The titles that lead to each entry."""
    tops = [i["label"] for i in hand.calm()["items"] if i["kind"] == "begin_menu"]
    found = []
    for top in tops:
        found += _below(hand, (top,))
        hand.calm()
    return found


def _below(hand, path):
    if not _open(hand, path):
        return []
    state, found = hand.fresh(), []
    name = state["popups"][-1]["name"] if state["popups"] else ""
    for one in [i for i in state["items"] if i["window"] == name]:
        if one["kind"] == "menu_item_simple":
            found.append((*path, one["label"]))
        elif one["kind"] == "begin_menu" and not one["disabled"]:
            found += _below(hand, (*path, one["label"]))
    return found


def _open(hand, path):
    """Open a menu, whatever is open now."""
    hand.calm()
    for depth, title in enumerate(path):
        one = next((i for i in hand.fresh()["items"] if _is(i, title, depth, hand)), None)
        if one is None or not hand.reach_and_click(one["id"], "begin_menu"):
            return False
    return len(hand.fresh()["popups"]) >= len(path)


def _is(item, title, depth, hand):
    """Whether it is the one of that title in the menu of that depth."""
    window = MAIN if depth == 0 else hand.state()["popups"][depth - 1]["name"]
    popups = hand.state()["popups"]
    return (
        item["label"] == title
        and (depth == 0 or len(popups) >= depth)
        and (item["window"] == window)
    )


def press(hand, path) -> bool:
    """Click on an entry."""
    if not _open(hand, path[:-1]):
        return False
    popups = hand.state()["popups"]
    for one in hand.state()["items"]:
        if one["label"] == path[-1] and one["window"] == popups[-1]["name"]:
            return hand.reach_and_click(one["id"], "menu_item")
    return False
