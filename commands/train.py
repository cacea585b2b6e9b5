"""The command deformrf train, which with --view shows the model while it is trained.

Without --view nothing of the viewer is imported.
"""

import json
import logging
import os
import time
from collections.abc import Callable

from ..core.base.device import device_name
from .running import interrupts_waiting, require
from .training import TrainArguments, prepare_training, train_command

SIZE = (1000, 700)  # of the window [points]
TOLD_SECONDS = 0.5  # between two lines of how far a job of the viewer is


def main() -> int:
    return train_command(prepare)


def main_of_job() -> int:
    """The command for the viewer: now and then it prints an event of how far it is."""
    told = [0.0]

    def on_pause(pause):
        if time.monotonic() - told[0] >= TOLD_SECONDS:
            told[0] = time.monotonic()
            where = {
                "event": "step",
                "stage": pause.stage,
                "step": pause.step,
                "steps": pause.step_count,
            }
            print(json.dumps(where), flush=True)

    return train_command(lambda chosen: prepare_training(chosen, on_pause))


def prepare(arguments: TrainArguments) -> Callable[[], int]:
    """Check the arguments, read the images, open the window if one is asked for.

    Returns:
        The work.

    Raises:
        WindowError: There is no display.
        ValueError: The arguments can't be, or several processes are to show one run.
    """
    if not arguments.view:
        return prepare_training(arguments)
    if int(os.environ.get("WORLD_SIZE", 1)) > 1:
        raise ValueError("--view shows the run of one process: leave out --view, or torchrun")
    require("torch", "pyglet", "moderngl", "imgui_bundle")
    from ..viewer.training import LiveRun

    name = arguments.data.resolve().name
    device = device_name(arguments.device, for_training=True)
    live = LiveRun(name, device)
    job = prepare_training(arguments, live.on_pause, live.on_trained)
    window, context = _open_window(name)
    return lambda: show(live, job, window, context)


def _open_window(name):
    from ..viewer.window import WindowError, open_window

    try:
        return open_window(SIZE, headless=False, title=f"deformrf: training {name}")
    except WindowError as error:
        reason = str(error).partition(";")[0]
        raise WindowError(f"{reason}; without --view the run needs none") from error


def show(live, job: Callable[[], int], window, context) -> int:
    """Do the job in a thread and show it in the window; returns its exit code."""
    from ..viewer.app import App  # imports pyglet's window, which is possible from now on
    from ..viewer.events import EventLog
    from ..viewer.training import LiveWindow

    app = App(window, context, EventLog(False))
    live.start(job)
    try:
        try:
            LiveWindow(app, live).run()
            app.end()
        except BaseException:
            with interrupts_waiting():
                if app.autosave is not None:
                    app.autosave.keep()
            raise
        finally:
            live.watched = False
            _close(app, live)
        if not (live.ended or live.stopping):
            print("The window is closed; training goes on. Ctrl-C stops it and keeps the work.")
    except KeyboardInterrupt:
        live.stop()
        print("Stopping after the next few steps; Ctrl-C again stops at once.", flush=True)
    except Exception:
        logging.getLogger(__name__).exception("The view failed; training goes on.")
    return live.result()


def _close(app, live):
    """Close the window while the run pauses: what is freed would get into a graph it records."""
    from ..viewer.training import POLL_SECONDS

    app.window.set_visible(False)
    closed = False
    while not closed:
        with live.gate.entered(POLL_SECONDS) as entered:
            if entered:
                closed = True
                app.close()
