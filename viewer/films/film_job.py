"""A film that a process of its own renders, and an estimate of how long one takes.

The process runs `deformrf render`, with a copy of the model in a temporary folder.  A film that is
told to end is cut short, and can be played.
"""

import time
from pathlib import Path

import numpy as np

from ...core import field as fields
from ...core.base.children import NOT_HERE, PACKAGE
from ..document import spoken
from ..jobs import Job

CODE = f"{NOT_HERE}from {PACKAGE}.commands.render import main; sys.exit(main())"
STILL = 0.5  # s that choices stand still before an estimate begins


class FilmJob(Job):
    """A run of deformrf render."""

    problem_is = "the film can't be rendered"

    def __init__(self, field, name: str, arguments: list[str]):
        """Take a field and its name, and arguments of deformrf render."""

        def whole(folder):
            return [str(_exact_copy(field, folder / f"{name}.npz")), *arguments, "--log-events"]

        super().__init__(CODE, whole)

    @property
    def frame(self) -> int:
        """The number of frames that are made."""
        return self.told["frame"]["frame"] + 1 if "frame" in self.told else 0

    @property
    def count(self) -> int:
        """The number of all frames; 0 before it is known."""
        return self.told["frame"]["count"] if "frame" in self.told else 0

    @property
    def seconds_left(self) -> float | None:
        """As the frames so far say; None before the second one."""
        made = self.frame
        if made < 2:
            return None
        elapsed = time.monotonic() - self.since["frame"]
        return elapsed / (made - 1) * (self.count - made)

    @property
    def written(self) -> Path | None:
        """The film, once it is there."""
        return Path(self.told["written"]["path"]) if "written" in self.told else None

    @property
    def problem(self) -> str:
        return super().problem.removeprefix("deformrf render: ")


class Estimator:
    """Finds out how long a film takes, once the choices for it stand still.

    Attributes:
        job: The last run of deformrf render --estimate.
    """

    def __init__(self, begin):
        """Take a function that begins a FilmJob with arguments."""
        self.job: FilmJob | None = None
        self._begin = begin
        self._wanted, self._since = None, 0.0  # arguments, and since when they stand still

    def follow(self, wanted: list[str] | None) -> None:
        """Called in every frame with the arguments of a film; None: no film is asked for."""
        if wanted != self._wanted:
            self._wanted, self._since = wanted, time.monotonic()
            if self.job is not None:
                self.job.stop()
        is_free = self.job is None or (self.job.stopping and self.job.ended)
        if wanted is not None and is_free and time.monotonic() - self._since >= STILL:
            self.job = self._begin([*wanted, "--estimate"])

    @property
    def line(self) -> str:
        """What is known, for people."""
        if self._wanted is None:
            return ""
        if self.job is None or self.job.stopping or not self.job.ended:
            return "estimating ..."
        told = self.job.told.get("estimate")
        if told is None:
            return self.job.problem
        return f"about {spoken(told['seconds'])}, {told['frames']} frames"


def _exact_copy(field, path: Path) -> Path:
    """A model file of a field, with as many bits an entry as keep its table."""
    for bits in (8, 16):
        fields.save(field, path, entry_bits=bits)
        if bits == 16 or np.array_equal(fields.load(path).table, field.table):
            return path
