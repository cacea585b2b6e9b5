"""Actions that record and film."""

from .action import action


@action(
    *("start or stop recording, for a film rendered in full", "F9", "Film/Record"),
    on=lambda takes: takes.recording,
)
def record(takes):
    takes.start_or_stop()


@action("a film of the timeline, of what was recorded, or of a turn", "CTRL+F9", "Film/Film...")
def save_film(takes):
    takes.ask()


@action("a film of the timeline", menu="Film/Film the timeline...")
def film_timeline(takes):
    takes.ask("timeline")


@action("a film of a turn around the object as it is", menu="Film/Film a turntable...")
def film_turntable(takes):
    takes.ask("turntable")


@action(
    "what a film of the chosen size shows of the view",
    menu="Film/-Frame guide",
    on=lambda takes: takes.shows_frame,
)
def frame_guide(takes):
    takes.shows_frame = not takes.shows_frame


@action(
    *("clip of the screen", "SHIFT+F9", "Film/-Record screen"),
    on=lambda recorder: recorder.video is not None,
)
def record_screen(recorder):
    recorder.start_or_stop()
