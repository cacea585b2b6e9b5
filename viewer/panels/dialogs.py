"""The dialogs: the choice of a file, and what went wrong."""

from pathlib import Path

from imgui_bundle import imgui

from ..actions import ActionSearch
from ..files import FileDialog, Problem, readable
from ..training import TrainOffer
from .offering import offer_panel
from .search import search_window
from .widgets import was_entered

WIDTH, LIST_HEIGHT = 520.0, 280.0


def dialog_window(questions, begin_training, actions, settings) -> None:
    """Draw the dialog of a window; it is None once the user has answered."""
    width, dialog = min(WIDTH, imgui.get_io().display_size.x - 60.0), questions.dialog
    if isinstance(dialog, TrainOffer):
        done = offer_panel(dialog, begin_training, width)
    elif isinstance(dialog, ActionSearch):
        search_window(dialog, questions, actions, settings, width)
        return
    else:
        done = {FileDialog: _choice, Problem: _problem}[type(dialog)](dialog, width)
    if done:
        questions.dialog = None


def _problem(problem, width):
    imgui.text(readable(problem.title))
    imgui.push_text_wrap_pos(width)
    imgui.text_wrapped(readable(problem.sentence))
    if problem.log_file is not None:
        imgui.text_disabled(readable(f"more in {problem.log_file}"))
    imgui.pop_text_wrap_pos()
    return imgui.button("Close") or was_entered()


def _choice(dialog, width):
    """Draw the folder's entries; returns whether the dialog is done."""
    imgui.text(dialog.title)
    imgui.set_next_item_width(width)
    flags = imgui.InputTextFlags_  # what is typed after an error takes the place of the path
    flags = flags.enter_returns_true.value | flags.auto_select_all.value
    if not imgui.is_any_item_active():  # keys are for the path, after an error, too
        imgui.set_keyboard_focus_here()
    entered, dialog.text = imgui.input_text("##path", dialog.text, flags)
    # Enter twice in slow frames: the field has the keys again some frames after the first one.
    done = (bool(entered) or was_entered()) and dialog.choose(dialog.typed())
    height = min(LIST_HEIGHT, imgui.get_io().display_size.y - 150.0)
    if imgui.begin_child("entries", (width, max(height, 60.0)), imgui.ChildFlags_.borders.value):
        if imgui.selectable("..", False)[0]:
            dialog.choose(Path(".."))
        for number, (name, is_folder) in enumerate(list(dialog.entries)):
            imgui.push_id(number)  # two names may look the same
            if imgui.selectable(readable(name) + "/" * is_folder, False)[0]:
                done = dialog.choose(Path(name)) or done
            imgui.pop_id()
        if not dialog.entries:
            imgui.text_disabled(f"no {' or '.join(dialog.endings)} here")
    imgui.end_child()
    if dialog.problem:
        imgui.text_wrapped(readable(dialog.problem))
    if imgui.button("Save" if dialog.name else "Open"):
        done = dialog.choose(dialog.typed()) or done
    imgui.same_line()
    return imgui.button("Cancel") or done
