"""Where the command `deformrf` begins, and the older names of its subcommands.

Ctrl-C ends it quietly while modules are imported: only what is needed for that is imported here;
`commands.run` takes over with the work.
"""

import atexit
import gc
import os
import signal
import sys
from functools import partial
from importlib import import_module

from ..core.base.children import forget_current_folder
from ..core.base.memory import no_garbage_collected
from ..core.base.streams import keep_going
from .dispatch import VERBOSE, VERSION, chosen

COMMANDS = {  # name: its module in this folder, and what it does
    "view": ("view", "show a model in a window, and drag it"),
    "train": ("train", "make a model of photographs, a video or images with cameras"),
    "render": ("render", "film a session, a clip or a turn around the object"),
    "eval": ("evaluate", "compare a model with photographs that it has not seen"),
    "edit": ("edit", "take parts of a model away"),
    "rig": ("rig", "give a model bones and clips; exchange them with Blender"),
    "report": ("report", "measure a model on this machine"),
    "data": ("data", "get photographs to train on"),
    "doctor": ("doctor", "print versions, devices and folders, for a report of a problem"),
    "completion": ("completion", "print a script with which bash or zsh complete words"),
}
ABOUT = """\
usage: deformrf COMMAND ...

Grab a photographed object and bend it."""
EXAMPLES = """\
Examples:
  deformrf view                             the bundled model: drag a red point
  deformrf train PHOTOS/ -o toy.npz         a model of your photographs
  deformrf render toy.npz --turntable 6 -o turn.mp4

deformrf COMMAND --help lists a command's options; deformrf MODEL.npz shows a model.  --device,
--verbose and --version may stand before COMMAND or behind it."""
INTERRUPTED = 130


def main() -> int:
    """Run the command that the first word names."""
    forget_current_folder()
    keep_going()
    return begin(*chosen("deformrf", sys.argv[1:], COMMANDS, (ABOUT, EXAMPLES), opener="view"))


def begin(name: str, words: list[str] | None = None) -> int:
    """Import a command and run it; returns its exit code.

    A fault of the program leaves a report that a user can attach.  With --verbose, any command
    shows on stderr what its modules note; with --version, it prints the version and ends.

    Args:
        words: Those behind the command's name; None takes the words of the process.
    """
    program = f"deformrf {name}"
    forget_current_folder()

    def end(*_):
        # No exception: an import that one passes through may turn it into another, or go on.
        try:
            os.write(sys.stderr.fileno(), f"{program}: interrupted\n".encode())
        except (OSError, ValueError, AttributeError):  # it is closed
            pass
        os._exit(INTERRUPTED)

    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:  # ignored in the background
        signal.signal(signal.SIGINT, end)
    keep_going()
    words = sys.argv[1:] if words is None else words
    if VERSION in words:
        print(f"deformrf {import_module('deformrf.core.base.paths').program_version()}")
        return 0
    # At its end Python would look for garbage among all that the process is about to leave.
    atexit.register(gc.freeze)
    sys.argv[1:] = [word for word in words if word != VERBOSE]
    crash = import_module("deformrf.viewer.crash")
    recent = crash.begin_logging(program, VERBOSE in words)
    try:
        with no_garbage_collected():
            command = import_module(f"deformrf.commands.{COMMANDS[name][0]}")
        return command.main()
    except Exception as error:
        path = crash.write_report(program, error, recent)
        if path is not None:
            print(
                f"{program}: this is a fault of the program; {path} has what is known of it, "
                f"without contents of your files: please attach it to a report",
                file=sys.stderr,
            )
        raise
    except KeyboardInterrupt:  # between the command's end and its exit code
        return INTERRUPTED
    finally:
        # What is left is Python's own end: a signal ends that, without a traceback.
        for stopping in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, stopping, signal.SIGINT)
            if signal.getsignal(number) == signal.default_int_handler:
                signal.signal(number, signal.SIG_DFL)


# The names that these commands had alone: deformrf-view, deformrf-train, ...
view, train, render = (partial(begin, name) for name in ("view", "train", "render"))
evaluate, edit = partial(begin, "eval"), partial(begin, "edit")
rig, report = partial(begin, "rig"), partial(begin, "report")
