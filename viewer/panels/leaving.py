"""The question before the end: what would be lost, and what to do about it."""

from imgui_bundle import imgui

from ...core.base.paths import working_folder
from ..files import readable
from ..questions import FILM, TRAINING
from .widgets import was_entered

WIDTH = 460.0


def leaving_window(questions, takes, project) -> None:
    """Ask about a film, training or work that no file has; Esc is to stay."""
    imgui.push_text_wrap_pos(WIDTH)
    if questions.leaving.about == FILM:
        _film(questions, takes.job)
    elif questions.leaving.about == TRAINING:
        _training(questions)
    else:
        _work(questions, project)
    imgui.pop_text_wrap_pos()
    imgui.same_line()
    if imgui.button("Cancel"):
        questions.dismiss()


def _film(questions, job):
    leaving = questions.leaving
    imgui.text("A film is being rendered")
    done = "" if job is None or not job.count else f" ({job.frame} of {job.count} frames are done)"
    when = "The window closes when it is ready" if leaving.waits else "It is not ready yet"
    imgui.text_wrapped(f"{when}{done}. A film that you stop is cut short, and its name says so.")
    imgui.text_disabled("Esc: cancel" if leaving.waits else "Enter: wait for it; Esc: cancel")
    if not leaving.waits:
        if imgui.button("Wait and quit") or was_entered():
            leaving.waits = True
        imgui.same_line()
    if imgui.button("Stop it and quit"):
        questions.settle()


def _training(questions):
    imgui.text("A model is being trained")
    imgui.text_wrapped("If you quit, training stops, and what is done of it is written.")
    imgui.text_disabled("Esc: cancel")
    if imgui.button("Stop it and quit"):
        questions.settle()


def _work(questions, project):
    imgui.text("Save what you did?")
    where = working_folder() if project is None else project
    kind = "a new project into " * (project is None)
    imgui.text_wrapped(f"No file has it yet. Save writes {kind}{readable(where)}.")
    if questions.leaving.problem:
        imgui.text_wrapped(readable(questions.leaving.problem))
    imgui.text_disabled("Enter: save; Esc: cancel")
    if imgui.button("Save and quit") or was_entered():
        questions.save()
    imgui.same_line()
    if imgui.button("Quit without saving") and questions.leaving is not None:
        questions.settle()
