"""The question before the end: what would be lost, and what to do about it."""

from imgui_bundle import imgui

from .. import questions
from ..files import readable
from ..questions import FILM, TRAINING
from .widgets import was_entered

WIDTH = 420.0


def leaving_window(app) -> None:
    """Ask about a film, training or work that is kept nowhere; Enter is the first button."""
    imgui.push_text_wrap_pos(WIDTH)
    draw = {FILM: _film, TRAINING: _training}.get(app.leaving.about, _work)
    draw(app)
    imgui.pop_text_wrap_pos()
    imgui.same_line()
    if imgui.button("Stay"):
        questions.dismiss(app)


def _film(app):
    leaving, job = app.leaving, app.takes.job
    imgui.text("A film is being rendered.")
    done = "" if job is None or not job.count else f": {job.frame} of {job.count} frames are done"
    when = "The window closes when the film is ready" if leaving.waits else "It is not ready"
    imgui.text_wrapped(f"{when}{done}. If you stop it, what there is of it is kept as cut short.")
    if not leaving.waits:
        if imgui.button("Wait for it") or was_entered():
            leaving.waits = True
        imgui.same_line()
    if imgui.button("Stop it and quit"):
        questions.settle(app)


def _training(app):
    imgui.text("A model is being trained.")
    imgui.text_wrapped("If you quit, training stops, and what is done of it is written.")
    if imgui.button("Stop it and quit"):
        questions.settle(app)


def _work(app):
    imgui.text("Save the session before you quit?")
    imgui.text_wrapped("No file has what you did last. A session can be opened, and goes on there.")
    if app.leaving.problem:
        imgui.text_wrapped(readable(app.leaving.problem))
    if imgui.button("Save") or was_entered():
        questions.save(app)
    imgui.same_line()
    if app.leaving is not None and imgui.button("Discard"):
        questions.settle(app)
