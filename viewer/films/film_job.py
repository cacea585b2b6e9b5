"""A film, or an estimate of how long one takes, by a process that runs `deformrf render`.

It gets a copy of the model.  A film that is told to end is cut short, and can be played.
"""

import time
from pathlib import Path

from ...core import field as fields
from ...core.base.children import NOT_HERE, PACKAGE
from ..jobs import ProcessJob

CODE = f"{NOT_HERE}from {PACKAGE}.commands.render import main; sys.exit(main())"


class FilmJob(ProcessJob):
    """A run of deformrf render."""

    failure = "the film can't be rendered"
    frame = count = 0  # frames that are made, and all
    written: Path | None = None
    estimate: tuple[float, int] | None = None  # seconds and frames
    _first_at = 0.0  # when the first frame was made

    def __init__(self, field, name: str, arguments: list[str]):
        """Take a field and its name, and arguments of deformrf render."""

        def whole(folder):
            model = fields.save_exactly(field, folder / f"{name}.npz")
            return [str(model), *arguments, "--log-events"]

        super().__init__(CODE, whole)

    @property
    def problem(self) -> str:
        return super().problem.removeprefix("deformrf render: ")

    @property
    def seconds_left(self) -> float | None:
        """As the frames so far say; None before the second one."""
        if self.frame < 2:
            return None
        elapsed = time.monotonic() - self._first_at
        return elapsed / (self.frame - 1) * (self.count - self.frame)

    def note(self, event):
        if event["event"] == "frame":
            self._first_at = self._first_at or time.monotonic()
            self.frame, self.count = event["frame"] + 1, event["count"]
        elif event["event"] == "written":
            self.written = Path(event["path"])
        elif event["event"] == "estimate":
            self.estimate = event["seconds"], event["frames"]
