"""Work in a process of its own, so that the viewer stays usable: films, estimates, training.

The process prints an event as a line of JSON, {"event": name, ...}.  What else it prints is for
people; the last such line says how it ended.
"""

import json
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ..core.base.children import start
from ..core.base.paths import working_folder

LOWER_PRIORITY = 10  # the viewer's frames come first
LONGEST_LINE = 400  # characters that are shown


class ProcessJob:
    """A Python process; a thread starts it and reads what it prints."""

    failure = "the work can't be done"  # what a sentence about an error begins with
    patience = 60.0  # s that its end may take
    priority, stderr = LOWER_PRIORITY, subprocess.STDOUT

    def __init__(self, code: str, arguments: Callable[[Path], list[str]]):
        """Begin to run code; a function makes its arguments, in a folder that is deleted then."""
        self.line = "starting"  # that it printed last
        self.code: int | None = None  # its exit code
        self.stopping = self.ended = False
        self.began = time.monotonic()
        self._process: subprocess.Popen | None = None
        self._lock = threading.Lock()  # of `stopping` and `_process`
        work = code, arguments
        self._thread = threading.Thread(target=self._work, args=work, name="job", daemon=True)
        self._thread.start()

    def note(self, event: dict) -> None:
        """Called in the thread with an event that was printed."""

    def hear(self, line: str) -> None:
        """Called in the thread with a line that was printed for people."""

    def end(self, process: subprocess.Popen) -> None:
        process.terminate()

    def tell(self, word: str) -> None:
        """Write a line to the process, if it runs."""
        with suppress(OSError, ValueError, AttributeError):  # it has ended, or not begun
            self._process.stdin.write(word + "\n")
            self._process.stdin.flush()

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
            self.end(process)

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
            self.line = f"{self.failure}: {getattr(error, 'strerror', None) or error}"
        self.ended = True

    def _run(self, code, arguments):
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self.stderr}
        pipes |= {"text": True, "errors": "replace"}
        alone = os.name == "posix"  # Ctrl-C is for the viewer, which ends it
        with self._lock:
            if self.stopping:
                return
            where = {"cwd": working_folder(), "start_new_session": alone}
            process = self._process = start(code, *arguments, **pipes, **where)
        with process:
            try:
                if alone:
                    os.setpriority(os.PRIO_PROCESS, process.pid, self.priority)
                for line in process.stdout:
                    self._hear(line)
            except BaseException:  # nobody reads it any more
                process.kill()
                raise
        self.code = process.returncode

    def _hear(self, line):
        if not line.startswith('{"event"'):
            self.line = line.strip()[:LONGEST_LINE] or self.line
            self.hear(line)
            return
        for text in line.replace("}{", "}\n{").splitlines():  # an interrupt may swallow the end
            self.note(json.loads(text))
