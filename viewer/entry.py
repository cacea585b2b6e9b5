"""Where the console commands begin: Ctrl-C ends them quietly while their modules are imported.

Only what is needed for that is imported here; `core.commands.run` takes over with the work.
"""

import os
import signal
import sys
from importlib import import_module

COMMANDS = {
    "deformrf-view": "deformrf.viewer.command",
    "deformrf-render": "deformrf.viewer.films.render_command",
    "deformrf-train": "deformrf.viewer.training.train_command",
    "deformrf-eval": "deformrf.core.commands.evaluate",
    "deformrf-edit": "deformrf.core.commands.edit",
    "deformrf-report": "deformrf.core.lab.command",
}
INTERRUPTED = 130


def view() -> int:
    return begin("deformrf-view")


def render() -> int:
    return begin("deformrf-render")


def train() -> int:
    return begin("deformrf-train")


def evaluate() -> int:
    return begin("deformrf-eval")


def edit() -> int:
    return begin("deformrf-edit")


def report() -> int:
    return begin("deformrf-report")


def begin(program: str) -> int:
    """Import a command and run it; returns its exit code."""

    def end(*_):
        # No exception: an import that one passes through may turn it into another, or go on.
        try:
            os.write(sys.stderr.fileno(), f"{program}: interrupted\n".encode())
        except (OSError, ValueError, AttributeError):  # it is closed
            pass
        os._exit(INTERRUPTED)

    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:  # ignored in the background
        signal.signal(signal.SIGINT, end)
    return import_module(COMMANDS[program]).main()
