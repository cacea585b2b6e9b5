"""The section on what was done: undo, redo, and the session."""

from imgui_bundle import imgui

from .widgets import button

SHOWN = 8  # steps


def history_panel(journal, actions):
    button("Undo", actions, "undo")
    imgui.same_line()
    button("Redo", actions, "redo")
    imgui.same_line()
    button("Save session", actions, "save_session", "deformrf render makes a film of it")
    for line, undone in shown_steps(journal):
        (imgui.text_disabled if undone else imgui.text)(line)


def shown_steps(journal):
    """The steps around the cursor: each one's line, and whether it is undone."""
    count = len(journal.steps)
    if not count:
        return [("nothing was changed yet", True)]
    first = max(min(journal.cursor - SHOWN // 2, count - SHOWN), 0)
    numbers = range(first, min(first + SHOWN, count))
    return [(f"{n + 1}  {journal.steps[n].label}", n >= journal.cursor) for n in numbers]
