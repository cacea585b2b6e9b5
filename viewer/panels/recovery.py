"""The question what to do with a session whose viewer did not end in order."""

import os
import time

from imgui_bundle import imgui

from ..files import readable
from .widgets import was_entered


def recovery_window(questions, opening, say):
    """Offer to go on with it; `questions.left_behind` is its path until that is decided."""
    path = questions.left_behind
    minutes = (time.time() - path.stat().st_mtime) / 60.0 if os.path.exists(path) else 0.0
    imgui.text("A session of this model was left behind.")
    imgui.text_disabled(readable(f"{minutes:.0f} minutes ago; kept in {path}"))
    if imgui.button("Go on with it") or was_entered():
        opening.asked = path  # before the next frame: the window shows how far it is
    imgui.same_line()
    if imgui.button("Delete it"):
        questions.left_behind = None
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            say(f"can't delete {path}: {error.strerror}")
    imgui.same_line()
    if imgui.button("Ask again next time"):
        questions.left_behind = None
