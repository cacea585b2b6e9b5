"""The command deformrf train, which with --view shows the model while it is trained.

Without --view nothing of the viewer is imported.
"""

import json
import logging
import math
import os
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from ..core import field as fields
from ..core.base.device import device_name
from .running import INTERRUPTED, complain, interrupt, interrupts_waiting, require
from .training import PROGRAM, TrainArguments, check_simple, prepare_training, train_command

SIZE = (1000, 700)  # of the window [points]
TOLD_SECONDS = 0.5  # between two events of how far a job is
SECONDS, MOST_SECONDS = 1.0, 10.0  # from one snapshot to the next
AGE_SHARE = 0.03  # of the run's age, as a run of minutes changes little within a second
COST_SHARE = 0.03  # of the run's time, that writing snapshots may take
POLL_SECONDS = 0.05  # between two looks of a run that waits
log = logging.getLogger(__name__)


def main() -> int:
    return train_command(prepare)


def main_of_job() -> int:
    """The command for the viewer: its first argument is the file of snapshots."""
    told = Telling(Path(sys.argv.pop(1)))
    threading.Thread(target=told.obey, daemon=True).start()
    return train_command(lambda chosen: prepare_training(chosen, told.on_pause, told.on_trained))


class Telling:
    """What a run tells the viewer, by events and snapshots, and what it is told."""

    def __init__(self, snapshot: Path, clock: Callable[[], float] = time.perf_counter):
        self.snapshot, self.paused = snapshot, False
        self._clock = clock
        self._told, self._due = -TOLD_SECONDS, 0.0  # when it did, when a snapshot may be written

    def on_pause(self, pause) -> None:
        """Called every few steps: tell how far the run is, and let it wait."""
        now = self._clock()
        if now - self._told >= TOLD_SECONDS:
            self._told = now
            tell(
                "step",
                stage=pause.stage,
                step=pause.step,
                steps=pause.step_count,
                seconds=pause.seconds,
                rate=pause.samples_per_second,
                history=pause.history,
            )
        if now >= self._due and not self.snapshot.exists():  # the last one was read
            self._write(pause, now)
        while self.paused:
            time.sleep(POLL_SECONDS)

    def on_trained(self, trained) -> None:
        tell("trained")

    def _write(self, pause, begin):
        """Write a snapshot; if that fails the run goes on without a view."""
        try:
            fields.save(pause.export(), self.snapshot)
        except Exception:
            self._due = math.inf
            log.exception("The field can't be shown any more; training goes on.")
            return
        tell("snapshot", path=str(self.snapshot), step=pause.step)
        end = self._clock()
        age = min(AGE_SHARE * pause.seconds, MOST_SECONDS)
        self._due = end + max(SECONDS, age, (end - begin) / COST_SHARE)

    def obey(self) -> None:
        """Do what the viewer writes, a word a line; where that has ended, the run goes on."""
        # Unbuffered: a thread that waits for a buffer would abort the end of Python.
        with open(0, "rb", buffering=0, closefd=False) as orders:
            for line in orders:
                word = line.strip()
                self.paused = word == b"pause"
                if word == b"stop":
                    interrupt()
        self.paused = False


def tell(event: str, **values) -> None:
    print(json.dumps({"event": event, **values}), flush=True)


def prepare(arguments: TrainArguments) -> Callable[[], int]:
    """Check the arguments, and open the window if one is asked for, else read the images.

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
    check_simple(arguments)
    require("pyglet", "moderngl", "imgui_bundle")
    device = device_name(arguments.device, for_training=True)
    window = _open_window(arguments.data.resolve().name)
    return lambda: show(sys.argv[1:], arguments.output, device, *window)


def _open_window(name):
    from ..viewer.window import WindowError, open_window

    try:
        return open_window(SIZE, headless=False, title=f"deformrf: training {name}")
    except WindowError as error:
        reason = str(error).partition(";")[0]
        raise WindowError(f"{reason}; without --view the run needs none") from error


def show(arguments: list[str], output: Path, device: str, window, context) -> int:
    """Train in a process and show it in the window; returns its exit code."""
    from ..viewer.app import App  # imports pyglet's window, which is possible from now on
    from ..viewer.events import EventLog
    from ..viewer.training import TrainJob

    app = App(window, context, EventLog(False))
    job = TrainJob(arguments, output, device, stays=True)
    try:
        try:
            app.watcher.watch(job)
            app.end()
        except BaseException:
            with interrupts_waiting():
                if app.autosave is not None:
                    app.autosave.keep()
            raise
        finally:
            job.pause(False)
            app.train_job = None
            app.close()
        if not (job.ended or job.stopping):
            print("The window is closed; training goes on. Ctrl-C stops it and keeps the work.")
    except KeyboardInterrupt:
        job.stop()
        print("Stopping after the next few steps; Ctrl-C again stops at once.", flush=True)
    except Exception:
        log.exception("The view failed; training goes on.")
    code = job.wait()
    if code is None:
        return INTERRUPTED if job.stopping else complain(PROGRAM, job.line)
    return code
