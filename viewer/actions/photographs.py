"""Actions that jump to the cameras of a data set's photographs."""

from functools import partial

from ..camera import is_seen_from, places, seen_from
from ..settings import PHOTOGRAPHS
from .action import action

WITHOUT = "there are no photographs: give the data set's folder with --data, or drop it here"


def line_of(photographs) -> str:
    """Which one is looked at."""
    if photographs.shown is None:
        return f"{len(photographs)} photographs"
    return f"{photographs.index + 1} of {len(photographs)}: {photographs.shown.name}"


def _jump(by, photographs, settings, viewpoint, controls, fly, center, say):
    """Move the camera to another photograph's; without a step, show it elsewhere, or not."""
    where = settings.photograph
    if photographs is None:
        say(WITHOUT)
        return
    if not by:
        where = PHOTOGRAPHS[(PHOTOGRAPHS.index(where) + 1) % len(PHOTOGRAPHS)]
    else:
        where = "over" if where == "hidden" else where
        try:
            photographs.step(by)
        except (OSError, ValueError) as error:  # a DatasetError is one
            say(str(error))
            return
    show_photograph(photographs, settings, viewpoint, controls, fly, center, where)
    say(photographs.says() if by else f"photograph: {where}")


def show_photograph(photographs, settings, viewpoint, controls, fly, center, where: str) -> None:
    """Show the one that was read over the render, beside it, or not, and look from its camera."""
    settings.photograph = where
    photograph = photographs.shown
    if photograph is None or where == "hidden":
        return
    fly.end()
    _look_from(photograph, viewpoint, controls, center, _places(controls, where))


for _name, _title, _key, _by, _help in (
    ("next_photograph", "Next", "BRACKETRIGHT", 1, "next photograph, from its camera"),
    ("previous_photograph", "Before", "BRACKETLEFT", -1, "photograph before"),
    (
        *("place_photograph", "Over, beside or hidden", "BACKSLASH", 0),
        "photograph over the render, beside it, or hidden",
    ),
):
    action(_help, _key, f"View/Photograph/{_title}", name=_name)(partial(_jump, _by))


def _places(controls, where):
    return places(controls.size, controls.panels, controls.ratio, where)


def _look_from(photograph, viewpoint, controls, center, shown):
    orbit, size = viewpoint.orbit, controls.size
    viewpoint.orbit = seen_from(photograph, orbit, size, shown.half_size, center)


def placed_photograph(photographs, settings, viewpoint, controls, center):
    """The photograph that is to be drawn, or None, and its Places; one beside covers the view.

    One over the render is drawn as long as the camera is where it was taken.
    """
    photograph = None if photographs is None else photographs.shown
    where = settings.photograph
    if photograph is None or where == "hidden":
        return None, None
    shown = _places(controls, where)
    if is_seen_from(photograph, viewpoint.orbit):
        # The window or a panel may have another size now.
        _look_from(photograph, viewpoint, controls, center, shown)
    elif where == "over":
        return None, None
    controls.covered = shown.covered
    return photograph, shown
