"""deformrf doctor: the facts that a report of a problem should begin with."""

from dataclasses import dataclass

from ..core.base.device import Choice
from .options import parsed
from .running import run

PROGRAM = "deformrf doctor"


@dataclass(frozen=True)
class DoctorArguments:
    """Print versions, folders, CUDA, OpenGL, how frames reach it, and the video encoder."""

    headless: bool = False
    """Look for OpenGL without a display."""
    device: Choice = "auto"
    """Accepted as by the other commands; by default, and always, all devices are shown."""


def main(words: list[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    chosen = parsed(PROGRAM, DoctorArguments, words)

    def prepare():
        from ..viewer.doctor import report

        return lambda: report(chosen.headless)

    return run(PROGRAM, prepare)
