"""What a terminal shows while cameras are found: a bar for each phase, with the time left."""

from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class Phases:
    """Bars on standard error, if that is a terminal; a context manager."""

    def __init__(self):
        console = Console(stderr=True)
        self._bars = Progress(
            TextColumn("{task.description:22}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )

    def __enter__(self):
        self._bars.start()
        return self

    def __exit__(self, *_):
        self._bars.stop()

    @contextmanager
    def phase(self, title: str, total: int, done: int = 0):
        """Begin a phase; yields a function to call with what is done so far."""
        task = self._bars.add_task(title, total=total, completed=done)
        yield lambda count: self._bars.update(task, completed=min(count, total))
