"""The window is closed in each of its states."""

import subprocess

from .hand import Gone

PART = "quitting"
SECONDS = 40.0


def drag(hand):
    """A drag that goes on."""
    width, height = hand.size
    hand.drag((0.4 * width, 0.5 * height), (25, -15), steps=4, release=False)


def free_drag(hand):
    hand.keys("ctrl+a")
    hand.find("move")
    hand.move(0.4 * hand.size[0], 0.4 * hand.size[1])


def film(hand):
    """A film that is rendered."""
    hand.bend()
    hand.find("turntable around")
    hand.calm()
    hand.keys("ctrl+F9")
    hand.fresh()
    hand.reach_and_click("Render", "button")
    hand.wait(lambda: hand.next_state()["films"], 40, "the film has begun")


def timeline(hand):
    """The timeline plays."""
    hand.keys("k")
    hand.fresh()
    hand.keys("shift+o")  # a turn of the camera, which plays
    hand.wait(lambda: hand.next_state()["playing"], 20, "it plays")


def recording(hand):
    hand.keys("F9")


def clip(hand):
    hand.keys("shift+F9")


def flight(hand):
    hand.keys("g")


def open_list(hand):
    hand.reach_and_click("Edit", "begin_menu")


def typed(hand):
    """Something is being typed into a slider."""
    hand.move(*hand.place("##stiffness"))
    hand.tool("keydown", "ctrl", "click", 1, "keyup", "ctrl")
    hand.fresh()
    hand.type("123")


def key_of(name):
    return lambda hand: hand.keys(name)


STATES = {  # what brings the window there; whether work is unsaved then, None: it may be
    "nothing done": (lambda hand: None, False),
    "work": (lambda hand: hand.bend(), True),
    "while dragging": (drag, True),
    "while dragging freely": (free_drag, None),
    "a menu open": (open_list, False),
    "typing": (typed, False),
    "the open dialog": (key_of("ctrl+o"), False),
    "the save dialog": (key_of("ctrl+shift+s"), False),
    "the film dialog": (key_of("ctrl+F9"), False),
    "the search": (key_of("ctrl+f"), False),
    "the help": (key_of("F1"), False),
    "the timeline plays": (timeline, True),
    "recording": (recording, False),
    "a clip": (clip, False),
    "flying": (flight, False),
    "a film is rendered": (film, True),
}
WAYS = "ctrl+q", "close"


def every_end(hand, again):
    """Quit in each state, by the key and by the window's cross."""
    for name, (begin, has_work) in STATES.items():
        for way in WAYS:
            step = f"{name}, {way}"
            hand.tally.tried(PART, name)
            try:
                hand.calm()
                begin(hand)
                hand.check(PART, f"{step}, before")
                _quit(hand, step, way, has_work)
            except (Gone, TimeoutError) as error:
                hand.note(PART, step, f"{type(error).__name__}: {error}")
            hand = again(hand)
    return hand


def _quit(hand, step, way, has_work):
    """Ask to quit, and answer until the process ends with 0."""
    _ask(hand, way)
    asked = []
    for _ in range(6):
        try:
            hand.process.wait(1.5)
            break
        except subprocess.TimeoutExpired:
            pass
        try:
            _answer(hand, step, way, asked)
        except Gone:  # meanwhile
            break
    try:
        code = hand.process.wait(SECONDS)
    except subprocess.TimeoutExpired:
        hand.note(PART, step, "it does not end")
        return
    if code:
        hand.note(PART, step, f"exit code {code}")
    if has_work and not asked:
        hand.note(PART, step, "it ended without a question")
    if asked and has_work is False:
        hand.note(PART, step, "a question about nothing")
    for entry in hand.events("said"):
        hand.note(PART, step, entry["line"])
    for line in hand._logged():
        hand.note(PART, step, line)


def _answer(hand, step, way, asked):
    """Lose what would be lost; ask again if nothing was asked."""
    state = hand.check(PART, step)
    hand.tool("mouseup", 1)
    if state["question"] != "leaving":
        _ask(hand, way)
        return
    asked.append("leaving")
    labels = [i["label"] for i in state["items"] if i["kind"] == "button"]
    wanted = "Stop it and quit" if "Stop it and quit" in labels else "Quit without saving"
    if not hand.reach_and_click(wanted, "button"):
        hand.note(PART, step, f"{wanted} can't be clicked on")


def _ask(hand, way):
    if way == "close":
        hand.ask_to_close()
    else:
        hand.keys(way)
