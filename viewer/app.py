"""The command deformrf-view: parse, check, open a window (or none), run, report.

Whatever the user can get wrong ends in one sentence on stderr and exit code 2; Ctrl-C
and SIGTERM finish the clip and end with 130.  torch, Warp and pyglet are imported when the
arguments are known to be good.
"""

import logging
import signal
import sys
import threading
from contextlib import contextmanager

from ..core.arguments import plain_message
from . import options

FAILED, INPUT_ERROR, INTERRUPTED = 1, 2, 130  # exit codes
SLOW_START = 1.5  # s after which the user is told what takes so long


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns its exit code, which the console script passes to sys.exit."""
    chosen = options.parse(arguments)
    logging.basicConfig(level=logging.WARNING, format="deformrf-view: %(message)s")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a session's end asks that way
    try:
        if chosen.version:
            from ..core.paths import program_version

            print(f"deformrf {program_version()}")
            return 0
        if chosen.doctor:
            from .doctor import report

            return report(chosen)
        return view(chosen)
    except KeyboardInterrupt:
        return INTERRUPTED


def view(chosen: options.ViewArguments) -> int:
    """Show a model; returns the exit code."""
    try:
        options.check(chosen)
        field, device, drag = _inputs(chosen)
        app = _open(chosen)
    except (ValueError, OSError, RuntimeError) as error:
        return _complain(error)
    try:
        try:
            with _told_if_slow():
                app.load(field, chosen.model.stem, device, chosen.interop, chosen.fps)
            app.scene.settings.mode = chosen.mode
            app.scene.settings.transparent_screenshots = chosen.run.transparent
            if drag is not None:
                from .script import resolved

                drag = resolved(drag, app.scene)
        except ValueError as error:
            return _complain(error)
        _run(app, chosen, drag)
    finally:
        app.close()
    return FAILED if app.capture.failed else 0


def _inputs(chosen):
    """The field, the device and the drag; errors of the user's making are raised here."""
    from ..core.field import modelfile
    from .script import parse_drag

    drag = parse_drag(chosen.run.drag) if chosen.run.drag is not None else None
    field = modelfile.load(chosen.model)
    from ..core.device import device_name

    return field, device_name(chosen.device), drag


def _open(chosen):
    """The App in its window, still empty.

    Raises:
        WindowError: There is no display, or no OpenGL on it.
    """
    from .window import open_window

    size = options.frame_size(chosen)
    headless = chosen.run.headless
    window, context = open_window(size, headless, f"deformrf: {chosen.model.stem}")
    from .events import EventLog
    from .loop import App

    return App(window, context, EventLog(chosen.log_events), gui=not headless)


def _run(app, chosen, drag):
    run = chosen.run
    if not run.headless:
        if run.record is not None:
            app.frame(0.0)  # the canvas has its size from the first frame
            app.capture.start(chosen.fps, run.record)
        app.run(run.frames)
        if run.screenshot is not None:
            app.capture.screenshot(run.screenshot)
            app.frame(0.0, whole=True)
        return
    count = run.frames or options.HEADLESS_FRAMES
    app.canvas.use(options.frame_size(chosen))
    if run.record is not None:
        app.capture.start(chosen.fps, run.record, live=False)
    frames = app.run_offline(count, chosen.fps, drag, run.screenshot)
    for _ in _with_progress(frames, count):
        pass


def _with_progress(frames, count):
    """The frames, with a bar on the terminal that says how long the rest will take."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(frames, "rendering", total=count, console=console, disable=not console.is_terminal)


@contextmanager
def _told_if_slow():
    """Say what is going on if it takes more than a moment."""
    message = "compiling kernels, on the first start only ..."
    timer = threading.Timer(SLOW_START, lambda: print(message, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _complain(error) -> int:
    """One line on stderr, its beginning in red on a terminal."""
    red, plain = ("\033[1;31m", "\033[0m") if sys.stderr.isatty() else ("", "")
    print(f"{red}deformrf-view:{plain} {plain_message(error)}", file=sys.stderr)
    return INPUT_ERROR
