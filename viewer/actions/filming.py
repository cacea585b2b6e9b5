"""Actions that record and film."""

from .action import action


@action(
    *("start or stop recording, for a film rendered in full", "F9", "Film/Record"),
    on=lambda takes: takes.recording,
)
def record(takes):
    takes.start_or_stop()


@action("a film of what was recorded", "CTRL+F9", "Film/Save film...")
def save_film(takes):
    takes.ask()


@action(
    *("clip of the screen", "SHIFT+F9", "Film/-Record screen"),
    on=lambda recorder: recorder.video is not None,
)
def record_screen(recorder):
    recorder.start_or_stop()
