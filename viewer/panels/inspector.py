"""The panel of the task: *Bend, Rig, Animate, Film, View*, each with what one needs for it."""

from collections.abc import Callable
from typing import NamedTuple

from imgui_bundle import imgui, imgui_ctx

from ..settings import TASKS
from . import view
from .bend import bend_panel, history_panel
from .film import filming_panel
from .rig import rig_panel
from .timeline import animate_panel
from .widgets import highlighted, icon, section


class TaskSection(NamedTuple):
    """A part of a task's panel; without a title it has no head."""

    title: str
    panel: Callable
    is_open: bool = True


SECTIONS = {
    "bend": (TaskSection("", bend_panel), TaskSection("History", history_panel, False)),
    "rig": (TaskSection("", rig_panel),),
    "animate": (TaskSection("", animate_panel),),
    "film": (TaskSection("", filming_panel),),
    "view": (
        TaskSection("Picture", view.picture_panel),
        TaskSection("Camera", view.camera_panel),
        TaskSection("Photographs", view.photographs_panel),  # if there are any
        TaskSection("Window", view.window_panel, False),
        TaskSection("Speed", view.speed_panel, False),
        TaskSection("Model", view.model_panel),
    ),
}
LEAST_PADDING = 6.0  # points, beside a word in its button
ICONS = dict(zip(TASKS, ("hand_pointer", "bone", "clock", "film", "eye"), strict=True))


def inspector(settings, panels, photographs, actions) -> None:
    """Draw the choice of the task, and its panel, into the window that is being built."""
    _tasks(settings, actions)
    imgui.separator()
    with imgui_ctx.begin_child("task"):
        imgui.set_scroll_x(0.0)  # Shift and the wheel would push it sideways
        for title, panel, is_open in SECTIONS[settings.task]:
            if panel is view.photographs_panel and photographs is None:
                continue
            if not title or section(title, is_open):
                with imgui_ctx.push_id(title):  # a button may be called like a head
                    panels.show(panel)


def _tasks(settings, actions):
    """A button for each of TASKS, as wide as its word asks; without words if they don't fit."""
    spacing, words = 2.0, [task.capitalize() for task in TASKS]
    widths = [imgui.calc_text_size(word).x for word in words]
    spare = imgui.get_content_region_avail().x - spacing * (len(TASKS) - 1) - sum(widths)
    fit = spare >= len(TASKS) * LEAST_PADDING
    for number, (task, word, width) in enumerate(zip(TASKS, words, widths, strict=True)):
        if number:
            imgui.same_line(0.0, spacing)
        label = word if fit else icon(ICONS[task])
        width = width + spare / len(TASKS) if fit else (sum(widths) + spare) / len(TASKS)
        with highlighted(settings.task == task):
            if imgui.button(f"{label}##{task}", (width, 0.0)):
                actions.call(f"task_{task}")
        imgui.set_item_tooltip(word)
