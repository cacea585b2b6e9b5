"""What a terminal shows while cameras are found: a bar for each phase, with the time left."""

from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class Phases(Progress):
    """Bars on standard error, if that is a terminal; a context manager."""

    def __init__(self):
        console = Console(stderr=True)
        super().__init__(
            TextColumn("{task.description:22}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )

    @contextmanager
    def phase(self, title: str, total: int, done: int = 0):
        """Begin a phase; yields a function to call with what is done so far."""
        task = self.add_task(title, total=total, completed=done)
        yield lambda count: self.update(task, completed=min(count, total))
