"""Work in a process of its own, so that the viewer stays usable: films, estimates, training.

The process prints an event as a line of JSON, {"event": name, ...}.  What else it prints is for
people; the last such line says how it ended.
"""

import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from ..core.base.children import start
from ..core.base.paths import working_folder

LOWER_PRIORITY = 10  # the viewer's frames come first
LONGEST_LINE = 400  # characters that are shown


class Job:
    """A Python process; a thread starts it and reads what it prints.

    Attributes:
        line: What it printed last for people.
        told: The last event of each name.
        since: When the first event of each name came, by time.monotonic().
        code: Its exit code; None before its end, or if it never began.
        stopping: Whether it was told to end.
        ended: Whether it is over.
    """

    problem_is = "the work can't be done"  # what a sentence about an error begins with
    end_by, patience = signal.SIGTERM, 60.0  # how it is told to end, and how long that may take [s]

    def __init__(self, code: str, arguments: Callable[[Path], list[str]]):
        """Begin.

        Args:
            code: What the process runs.
            arguments: Makes its arguments, in the thread; it gets a folder that is deleted at the
                end.
        """
        self.line, self.code = "starting", None
        self.told: dict[str, dict] = {}
        self.since: dict[str, float] = {}
        self.stopping = self.ended = False
        self.began = time.monotonic()
        self._process: subprocess.Popen | None = None
        self._lock = threading.Lock()  # of `stopping` and `_process`
        work = code, arguments
        self._thread = threading.Thread(target=self._work, args=work, name="job", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str:
        """Why it failed, in a sentence; empty if it didn't, or was told to end."""
        return self.line if self.ended and self.code != 0 and not self.stopping else ""

    def stop(self) -> None:
        """Tell it to end, once; it writes what is done."""
        with self._lock:
            process = None if self.stopping else self._process
            self.stopping = True
        if process is not None and process.poll() is None:
            process.send_signal(self.end_by)

    def close(self) -> None:
        """Tell it to end, wait for that, and kill it if it takes too long."""
        self.stop()
        self._thread.join(self.patience)
        if self._thread.is_alive() and self._process is not None:
            self._process.kill()
            self._thread.join()

    def _work(self, code, arguments):
        try:
            with tempfile.TemporaryDirectory(prefix="deformrf-", ignore_cleanup_errors=True) as at:
                self._run(code, arguments(Path(at)))
        except Exception as error:  # the viewer goes on
            self.line = f"{self.problem_is}: {getattr(error, 'strerror', None) or error}"
        self.ended = True

    def _run(self, code, arguments):
        with self._lock:
            if self.stopping:
                return
            process = self._process = start(
                code,
                *arguments,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                cwd=working_folder(),
                start_new_session=os.name == "posix",  # Ctrl-C is for the viewer, which ends it
            )
        try:
            if os.name == "posix":
                os.setpriority(os.PRIO_PROCESS, process.pid, LOWER_PRIORITY)
            for line in process.stdout:
                self._hear(line)
            self.code = process.wait()
        finally:
            process.stdout.close()
            if process.poll() is None:  # nobody reads it any more
                process.kill()
                process.wait()

    def _hear(self, line):
        if not line.startswith('{"event"'):
            self.line = line.strip()[:LONGEST_LINE] or self.line
            return
        for text in line.replace("}{", "}\n{").splitlines():  # an interrupt may swallow the end
            event = json.loads(text)
            self.told[event["event"]] = event
            self.since.setdefault(event["event"], time.monotonic())
