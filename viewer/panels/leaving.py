"""The question before the end: what would be lost, and what to do about it."""

from imgui_bundle import imgui

from .. import questions
from ..files import readable
from ..questions import FILM, TRAINING
from .widgets import was_entered

WIDTH = 460.0


def leaving_window(app) -> None:
    """Ask about a film, training or work that no file has; Esc is to stay."""
    imgui.push_text_wrap_pos(WIDTH)
    draw = {FILM: _film, TRAINING: _training}.get(app.leaving.about, _work)
    draw(app)
    imgui.pop_text_wrap_pos()
    imgui.same_line()
    if imgui.button("Stay"):
        questions.dismiss(app)


def _film(app):
    leaving, job = app.leaving, app.takes.job
    imgui.text("A film is being rendered")
    done = "" if job is None or not job.count else f" ({job.frame} of {job.count} frames are done)"
    when = "The window closes when it is ready" if leaving.waits else "It is not ready yet"
    imgui.text_wrapped(f"{when}{done}. A film that you stop is cut short, and its name says so.")
    imgui.text_disabled("Esc: stay" if leaving.waits else "Enter: wait for it; Esc: stay")
    if not leaving.waits:
        if imgui.button("Wait and quit") or was_entered():
            leaving.waits = True
        imgui.same_line()
    if imgui.button("Stop it and quit"):
        questions.settle(app)


def _training(app):
    imgui.text("A model is being trained")
    imgui.text_wrapped("If you quit, training stops, and what is done of it is written.")
    imgui.text_disabled("Esc: stay")
    if imgui.button("Stop it and quit"):
        questions.settle(app)


def _work(app):
    imgui.text("Save what you did?")
    project = None if app.project is None else readable(app.project.name)
    where = project or "a session into the current folder"
    imgui.text_wrapped(f"No file has it yet. Save writes {where}.")
    if app.leaving.problem:
        imgui.text_wrapped(readable(app.leaving.problem))
    imgui.text_disabled("Enter: save; Esc: stay")
    if imgui.button("Save") or was_entered():
        questions.save(app)
    imgui.same_line()
    if imgui.button("Discard") and app.leaving is not None:
        questions.settle(app)
