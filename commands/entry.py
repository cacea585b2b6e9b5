"""Where the console commands begin: Ctrl-C ends them quietly while their modules are imported.

Only what is needed for that is imported here; `commands.run` takes over with the work.
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

COMMANDS = {
    "deformrf-view": "deformrf.commands.view",
    "deformrf-render": "deformrf.commands.render",
    "deformrf-train": "deformrf.commands.train",
    "deformrf-eval": "deformrf.commands.evaluate",
    "deformrf-edit": "deformrf.commands.edit",
    "deformrf-rig": "deformrf.commands.rig",
    "deformrf-report": "deformrf.commands.report",
    "deformrf-data": "deformrf.commands.data",
}
INTERRUPTED = 130
# The end of every --help.
EVERYWHERE = "With --verbose, what the program notes goes to stderr; --version prints the version."


def begin(program: str) -> int:
    """Import a command and run it; returns its exit code.

    A fault of the program leaves a report that a user can attach.  With --verbose, any command
    shows on stderr what its modules note; with --version, it prints the version and ends.
    """
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
    if "--version" in sys.argv[1:]:
        print(f"deformrf {import_module('deformrf.core.base.paths').program_version()}")
        return 0
    # At its end Python would look for garbage among all that the process is about to leave.
    atexit.register(gc.freeze)
    verbose = "--verbose" in sys.argv[1:]
    sys.argv[1:] = [word for word in sys.argv[1:] if word != "--verbose"]
    crash = import_module("deformrf.viewer.crash")
    recent = crash.begin_logging(program, verbose)
    try:
        with no_garbage_collected():
            command = import_module(COMMANDS[program])
        return command.main()
    except SystemExit as ended:
        if not ended.code and {"-h", "--help"} & {*sys.argv[1:]}:
            print(EVERYWHERE)
        raise
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
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, signal.SIGINT)
            if signal.getsignal(number) == signal.default_int_handler:
                signal.signal(number, signal.SIG_DFL)


view = partial(begin, "deformrf-view")
render = partial(begin, "deformrf-render")
train = partial(begin, "deformrf-train")
evaluate = partial(begin, "deformrf-eval")
edit = partial(begin, "deformrf-edit")
rig = partial(begin, "deformrf-rig")
report = partial(begin, "deformrf-report")
