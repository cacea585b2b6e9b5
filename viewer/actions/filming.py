"""Actions that record, film and take pictures."""

from functools import partial

from .action import action, method, toggle

method(
    "takes.start_or_stop",
    "mark what you do from now on: a film of it is rendered afterwards, in full",
    *("F9", "Film/Record what I do"),
    name="record",
    on="takes.recording",
    stop="Stop recording",
)


def _ask(kind, takes):
    takes.ask(kind)


for _name, _kind, _key, _menu, _of in (
    ("save_film", "", "CTRL+F9", "Make a film", "the timeline, of what was recorded, or a turn"),
    ("film_timeline", "timeline", "", "Film the timeline", "the timeline"),
    ("film_turntable", "turntable", "", "Film a turntable", "a turn around the object as it is"),
):
    action(f"a film of {_of}", _key, f"Film/{_menu}...", name=_name)(partial(_ask, _kind))


@action(
    "what a film of the chosen size shows of the view",
    menu="Film/-Frame guide",
    on="takes.shows_frame",
)
def frame_guide(takes):
    takes.shows_frame = not takes.shows_frame


method(
    *("recorder.start_or_stop", "a video of the view as it shows, coarse while things move"),
    *("SHIFT+F9", "Film/-Record the screen"),
    name="record_screen",
    on="recorder.video",
    stop="Stop recording the screen",
)
_help = "a picture of the view, into the current folder"
method("recorder.screenshot", _help, "F2", "Film/-Save a picture")
toggle(
    "transparent_screenshots",
    "pictures are of the field alone, with its opacity",
    menu="Film/Pictures without background",
    name="toggle_transparent",
)
toggle(
    "handles_in_clips",
    "pictures and clips of the screen have red points and bones in them; films are asked for",
    menu="Film/Red points in pictures and screen clips",
)
_help = "pictures are of the whole window"
toggle("panel_in_screenshots", _help, menu="Film/Panels in pictures")
