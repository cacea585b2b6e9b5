"""Every dialog is opened, gets wrong paths and names, and is closed in every way."""

import os
import signal
import time
import zipfile
from functools import partial

from .hand import TEXTS, Gone
from .widgets import choose, use

OPEN, SAVE = "open", "save as"
SECONDS = 5.0  # until a window has answered
HOW = {OPEN: "ctrl+o", SAVE: "ctrl+shift+s", "film": "ctrl+F9", "search": "ctrl+f"}
ASKED = {OPEN: "dialog", SAVE: "dialog", "film": "film", "search": "dialog", "leaving": "leaving"}


def wrong_files(folder) -> dict:
    """Files and paths that can't be opened, by what is wrong with them."""
    folder.mkdir(exist_ok=True)
    (folder / "closed").mkdir()
    (folder / "closed" / "in.deformrf").write_bytes(b"PK")
    os.chmod(folder / "closed", 0)
    locked = folder / "locked.deformrf"
    locked.write_bytes(b"PK")
    os.chmod(locked, 0)
    (folder / "none.deformrf").write_text("no project")
    (folder / "none.npz").write_text("no model")
    (folder / "none.jsonl").write_text("no session")
    (folder / "other.txt").write_text("another ending")
    (folder / "empty.deformrf").write_bytes(b"")
    with zipfile.ZipFile(folder / "hollow.deformrf", "w") as made:
        made.writestr("project.json", "{}")
    return {
        "a folder that is not there": folder / "absent" / "a.deformrf",
        "a folder without permission": folder / "closed" / "in.deformrf",
        "a file without permission": locked,
        "an empty name": "",
        "blanks": "   ",
        "a name with a slash": "a/b/c.deformrf",
        "a root": "/",
        "a folder of no files": "/proc/a.deformrf",
        "nobody's home": "~nobody-there/a.deformrf",
        "a file as a folder": folder / "none.npz" / "a.deformrf",
        "5,000 characters": "n" * 5000,
        "5,000 with folders": "/".join(["folder"] * 700) + "/a.deformrf",
        "a NUL, a line and a tab": "a\tb.deformrf",
        "no project": folder / "none.deformrf",
        "no model": folder / "none.npz",
        "no session": folder / "none.jsonl",
        "another ending": folder / "other.txt",
        "an empty file": folder / "empty.deformrf",
        "a hollow zip": folder / "hollow.deformrf",
        "non-Latin": "жñ日.deformrf",
    }


def every_dialog(hand, again):
    """All of it; returns the last window."""
    wrong = wrong_files(hand.folder.parent / f"wrong-{hand.size[0]}")
    for which in (OPEN, SAVE):
        for name, path in wrong.items():
            for way in ("Return", "button"):
                step = f"{name}, {way}"
                go = partial(_wrong_path, which=which, path=str(path), way=way, step=step)
                hand = _with(hand, again, which, go, step)
    for which, key in HOW.items():
        for way in ("Escape", "a click beside", "two clicks beside, Escape", "the key again"):
            go = partial(_ended, which=which, key=key, way=way)
            hand = _with(hand, again, which, go, way)
    for name, text in TEXTS.items():
        hand = _with(hand, again, "search", partial(_searched, name=name, text=text), name)
    hand = _with(hand, again, "film", _film_fields, "its fields")
    hand = _with(hand, again, "leaving", _leaving, "all ways")
    return _with(hand, again, "recovery", partial(_recovery, again=again), "all ways")


def _with(hand, again, part, call, step="all"):
    try:
        return call(hand) or hand
    except (Gone, TimeoutError) as error:
        hand.note(f"dialog {part}", step, f"{type(error).__name__}: {error}")
        return again(hand)


def _opened(hand, which, key):
    hand.calm()
    hand.keys(key)
    if not _soon(hand, lambda state: state["question"] == ASKED[which]):
        hand.note(f"dialog {which}", key, f"is not shown, but {hand.state()['question']!r}")
    return hand.fresh()


def _soon(hand, condition):
    """Whether something is so within some seconds, on a machine with other work."""
    end = time.monotonic() + SECONDS
    while not condition(hand.fresh()):
        if time.monotonic() > end:
            return False
        hand.next_state()
    return True


def _wrong_path(hand, which, path, way, step):
    part = f"dialog {which}"
    hand.tally.tried(part, "wrong paths")
    _opened(hand, which, HOW[which])
    hand.keys("ctrl+a")
    hand.type(path)
    hand.fresh()
    if way == "Return":
        hand.keys("Return")
    else:
        hand.reach_and_click("Open" if which == OPEN else "Save", "button")
    state = hand.check(part, step)
    shown = state["question"] == "dialog"
    if which == OPEN and not _soon(hand, lambda state: state["question"] == "dialog"):
        hand.note(part, step, f"nothing is said of it: {state['said']!r}")
    if not shown and which == SAVE:
        hand.tally.tried(part, "of these written")
        print(f"  saved: {step}: {state['project']}", flush=True)
    hand.calm()


def _ended(hand, which, key, way):
    part = f"dialog {which}"
    hand.tally.tried(part, "ended by Esc, beside or again")
    state = _opened(hand, which, key)
    before = state["values"]
    if way == "Escape":
        hand.keys("Escape")
    elif way == "the key again":
        hand.keys(key)
    else:
        for _ in range(1 + way.startswith("two")):
            hand.click(0.08 * hand.size[0] + 60, 0.85 * hand.size[1])
        if way.endswith("Escape"):
            hand.keys("Escape")
    state = hand.check(part, way)
    if way.endswith("Escape") and state["question"]:
        hand.note(part, way, f"it stays: {state['question']!r}")
    if state["values"]["camera"] != before["camera"]:
        hand.note(part, way, "the camera has moved")
    hand.calm()


def _searched(hand, name, text):
    part = "dialog search"
    hand.tally.tried(part, "texts")
    _opened(hand, "search", HOW["search"])
    hand.type(text)
    hand.keys("Down", "Down", "Up")
    hand.check(part, f"search for {name}")
    if name not in ("empty", "text"):
        hand.keys("Return")
    hand.check(part, f"Enter after {name}")
    hand.calm()


def _film_fields(hand):
    """Texts as its name and folder; sizes; Enter and Render with a name that can't be."""
    part = "dialog film"
    wrong = {**TEXTS, "a slash": "a/b", "long name": "n" * 400, "dots": "..", "root": "/"}
    for label in ("##name", "##folder"):
        for name, text in wrong.items():
            hand.tally.tried(part, f"{label} typed")
            _opened(hand, "film", HOW["film"])
            hand.reach_and_click(label, "input_text")
            hand.keys("ctrl+a")
            hand.type(text)
            hand.keys("Tab")
            hand.check(part, f"{label} {name}")
            if label == "##name" or name == "long":  # root may write into "/"
                hand.reach_and_click("Render", "button")
                hand.check(part, f"{label} {name}, Render")
                _end_film(hand)
            hand.calm()
    _film_choices(hand, part)


def _film_choices(hand, part):
    _opened(hand, "film", HOW["film"])
    done = set()
    while True:
        if hand.fresh()["question"] != "film":
            _end_film(hand)
            _opened(hand, "film", HOW["film"])
        kinds = "combo", "checkbox", "input_int2", "radio_button", "slider_float"
        found = [
            i
            for i in hand.fresh()["items"]
            if i["kind"] in kinds and not i["disabled"] and "film" in i["window"]
        ]
        one = next((i for i in found if i["id"] not in done), None)
        if one is None:
            break
        done.add(one["id"])
        hand.tally.tried(part, one["kind"])
        hand.stays = "film"
        try:
            use(hand, part, one, f"{one['kind']} {one['label']!r}")
            if one["label"] in ("##size", "##format"):  # the last value has a field or a box
                choose(hand, one, one["count"] - 1)
            hand.check(part, one["label"])
        finally:
            hand.stays = ""
    hand.calm()


def _end_film(hand):
    """Stop a film that has begun."""
    if hand.fresh()["films"]:
        hand.tally.tried("dialog film", "films begun and ended")
        if not _soon(hand, lambda state: "End it here" in state["widgets"]):
            hand.note("dialog film", "end it here", "there is no such button")
        hand.next_state()  # in its first frame the window isn't where it will be
        hand.reach_and_click("End it here", "small_button")
        hand.wait(lambda: not hand.next_state()["films"], 60, "the film is ended")
        hand.check("dialog film", "end it here")


def _leaving(hand):
    part = "dialog leaving"
    for way in ("Escape", "Cancel", "ctrl+q", "beside", "ctrl+o", "close"):
        hand.tally.tried(part, way)
        if not hand.fresh()["unsaved"]:
            hand.bend()
        if way == "close":
            hand.ask_to_close()
        else:
            hand.keys("ctrl+q")
        state = hand.check(part, f"asked, before {way}")
        if state["question"] != "leaving":
            hand.note(part, way, "is not asked")
        if way == "Cancel":
            hand.press("Cancel")
        elif way == "beside":
            hand.click(0.08 * hand.size[0] + 60, 0.85 * hand.size[1])
        elif way != "close":
            hand.keys(way)
        state = hand.check(part, way)
        stays = way in ("ctrl+q", "beside", "ctrl+o", "close")
        if (state["question"] == "leaving") != stays:
            hand.note(part, way, f"the question is {state['question']!r}")
        hand.calm()


def _recovery(hand, again):
    """A viewer that was killed: its session is offered, whichever way it is answered."""
    part = "dialog recovery"
    for way in ("Escape", "beside", "Ask again next time", "ctrl+o", "Return", "Delete it"):
        hand.tally.tried(part, way)
        if not hand.fresh()["unsaved"]:
            hand.bend()
        hand.wait(partial(_kept, hand), 40, "the session is kept")
        hand.process.send_signal(signal.SIGKILL)
        hand.process.wait(20)
        hand = again(hand, same=True)
        state = hand.check(part, f"offered, before {way}")
        if state["question"] != "recovery":
            hand.note(part, way, f"it is not offered: {state['question']!r}")
        if way in ("Ask again next time", "Delete it"):
            hand.press(way)
        elif way == "beside":
            hand.click(0.08 * hand.size[0] + 60, 0.85 * hand.size[1])
        else:
            hand.keys(way)
        state = hand.check(part, way)
        if way == "Return":
            hand.wait(partial(_undoes, hand), 40, "it goes on")
            hand.check(part, "gone on")
        hand.calm()
        if way != "Delete it" and not _kept(hand):
            hand.note(part, way, "the session that was kept is gone")
    return hand


def _undoes(hand):
    return hand.next_state()["undoes"]


def _kept(hand):
    return [*hand.folder.glob("state/deformrf/sessions/*.jsonl")]
