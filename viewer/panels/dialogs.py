"""The questions in the middle: a file, an action, a training, what to do with what was done."""

import os
import time
from pathlib import Path

from imgui_bundle import imgui, imgui_ctx

from ..actions import ActionSearch
from ..files import FileDialog, Problem, readable
from ..questions import FILM, TRAINING, WORK
from ..training import TrainOffer
from .widgets import answers, was_entered

WIDTH, LIST_HEIGHT = 520.0, 280.0
LEAVING_WIDTH = 460.0
GO_ON = {FILM: ("Wait and quit", "wait for it"), WORK: ("Save and quit", "save")}
WAYS = {imgui.Key.up_arrow: -1, imgui.Key.down_arrow: 1}


def dialog_window(questions, watcher, actions, settings) -> None:
    """Draw the dialog of a window; it is None once the user has answered."""
    width, dialog = min(WIDTH, imgui.get_io().display_size.x - 60.0), questions.dialog
    with imgui_ctx.push_text_wrap_pos(width):
        imgui.text(readable(dialog.title))
        if isinstance(dialog, TrainOffer):
            done = _offer(dialog, watcher)
        elif isinstance(dialog, ActionSearch):
            done = _search(dialog, settings.keys, width)
        else:
            done = {FileDialog: _choice, Problem: _problem}[type(dialog)](dialog, width)
    if done:
        questions.dialog = None
        if isinstance(dialog, ActionSearch):
            actions.call(done)


def _offer(offer, watcher):
    for line in offer.lines():
        imgui.text_wrapped(line)
    answer = answers("Train", "Not now")
    if answer == "Train":
        watcher.begin_offered()
    return bool(answer)


def _problem(problem, width):
    imgui.text_wrapped(readable(problem.sentence))
    if problem.log_file is not None:
        imgui.text_disabled(readable(f"more in {problem.log_file}"))
    return bool(answers("Close", enter="Close"))


def _choice(dialog, width):
    """Draw the folder's entries; returns whether the dialog is done."""
    imgui.set_next_item_width(width)
    flags = imgui.InputTextFlags_  # what is typed after an error takes the place of the path
    flags = flags.enter_returns_true.value | flags.auto_select_all.value
    if not imgui.is_any_item_active():  # keys are for the path, after an error, too
        imgui.set_keyboard_focus_here()
    entered, dialog.text = imgui.input_text("##path", dialog.text, flags)
    # Enter twice in slow frames: the field has the keys again some frames after the first one.
    done = (bool(entered) or was_entered()) and dialog.choose(dialog.typed())
    with imgui_ctx.begin_child("entries", _list_size(width), imgui.ChildFlags_.borders.value):
        if imgui.selectable("..", False)[0]:
            dialog.choose(Path(".."))
        for number, (name, is_folder) in enumerate(list(dialog.entries)):
            with imgui_ctx.push_id(number):  # two names may look the same
                if imgui.selectable(readable(name) + "/" * is_folder, False)[0]:
                    done = dialog.choose(Path(name)) or done
        if not dialog.entries:
            imgui.text_disabled(f"no {' or '.join(dialog.endings)} here")
    if dialog.problem:
        imgui.text_wrapped(readable(dialog.problem))
    takes = "Save" if dialog.name else "Open"
    answer = answers(takes, "Cancel", marked=takes)
    return answer == "Cancel" or (bool(answer) and dialog.choose(dialog.typed())) or done


def _list_size(width):
    return width, max(min(LIST_HEIGHT, imgui.get_io().display_size.y - 150.0), 60.0)


# -- the search over all actions ---------------------------------------------------------------


def _search(search, keys, width):
    """What is typed filters them; the name of the one that was chosen by Enter or a click."""
    if imgui.is_window_appearing():
        imgui.set_keyboard_focus_here()
    imgui.set_next_item_width(width)
    changed, search.text = imgui.input_text_with_hint("##search", "what to do", search.text)
    found = search.found(keys)
    if changed:
        search.number = 0
    chooses = bool(search.text.strip())  # so far, Enter would call what comes first of all
    for key, by in WAYS.items() if chooses else ():
        if imgui.is_key_pressed(key):
            search.move(by, len(found))
    entered = was_entered() and chooses and search.number < len(found)
    chosen = found[search.number].action if entered else ""
    with imgui_ctx.begin_child("found", _list_size(width)):
        for number, entry in enumerate(found):
            if _row(entry, chooses and number == search.number, width):
                chosen = entry.action
        if not found:
            imgui.text_disabled("nothing is called so")
    imgui.text_disabled("Up, Down: choose; Enter: do it; Esc: back" if chooses else "Esc: back")
    return chosen


def _row(entry, is_chosen, width):
    """Draw one action; whether it is clicked."""
    clicked = imgui.selectable(f"{entry.title}##{entry.action}", is_chosen)[0]
    if is_chosen and imgui.is_window_focused():
        imgui.set_scroll_here_y()
    menu = entry.menu.rpartition("/")[0].replace("/", " > ").replace("-", "")
    for text, place in ((menu, 0.45), (entry.label, 0.8)):
        imgui.same_line(place * width)
        imgui.text_disabled(text)
    return clicked


# -- the end -----------------------------------------------------------------------------------


def leaving_window(questions, takes, opening) -> None:
    """Ask about a film, training or work that no file has; Esc is to stay."""
    leaving = questions.leaving
    title, text = _loss(leaving, takes.job, opening)
    label, entered = GO_ON.get(leaving.about, ("", "")) if not leaving.waits else ("", "")
    with imgui_ctx.push_text_wrap_pos(LEAVING_WIDTH):
        imgui.text(title)
        imgui.text_wrapped(readable(text))
        if leaving.problem:
            imgui.text_wrapped(readable(leaving.problem))
        imgui.text_disabled(f"Enter: {entered}; Esc: cancel" if label else "Esc: cancel")
    lose = "Quit without saving" if leaving.about == WORK else "Stop it and quit"
    answer = answers(*filter(None, [label]), lose, "Cancel", enter=label)
    if answer == lose:
        questions.settle()
    elif answer == "Cancel":
        questions.dismiss()
    elif answer and leaving.about == WORK:
        questions.save()
    elif answer:
        leaving.waits = True


def _loss(leaving, job, opening):
    """What would be lost, in a few words and in more."""
    if leaving.about == TRAINING:
        text = "If you quit, training stops, and what is done of it is written."
        return "A model is being trained", text
    if leaving.about == WORK:
        return "Save what you did?", f"No file has it yet. Save writes {opening.path}."
    done = "" if job is None or not job.count else f" ({job.frame} of {job.count} frames are done)"
    when = "The window closes when it is ready" if leaving.waits else "It is not ready yet"
    text = f"{when}{done}. A film that you stop is cut short, and its name says so."
    return "A film is being rendered", text


# -- a session that was left behind ------------------------------------------------------------


def recovery_window(questions, opening, say):
    """Offer to go on with it; `questions.left_behind` is its path until that is decided."""
    path = questions.left_behind
    minutes = (time.time() - path.stat().st_mtime) / 60.0 if os.path.exists(path) else 0.0
    imgui.text("A session of this model was left behind.")
    imgui.text_disabled(readable(f"{minutes:.0f} minutes ago; kept in {path}"))
    answer = answers("Go on with it", "Delete it", "Ask again next time", enter="Go on with it")
    if answer == "Go on with it":
        opening.asked = path  # before the next frame: the window shows how far it is
    elif answer:
        questions.left_behind = None
    if answer == "Delete it":
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            say(f"can't delete {path}: {error.strerror}")
