"""A film that a process of its own renders, so that the viewer stays usable.

The process runs `deformrf render`. It gets the session, a copy of the model in a temporary folder,
and the choices of the user.  It prints a JSON line for each frame; whatever else it prints last
says why it failed.  It ends a film that it is told to end (SIGTERM), which can then be played.
"""

import json
import os
import subprocess
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from ...core import field as fields
from ...core.base.children import NOT_HERE, PACKAGE, start
from ...core.base.paths import free_name, working_folder

SIZES = "as the window", "1280x720", "1920x1080", "3840x2160"
RATES = 15, 24, 25, 30, 60  # frames a second
SAMPLE_COUNTS = 1, 4, 16, 64
BLUR = 0.5  # of a frame's time, as film cameras have it
FORMATS = {  # what a user may choose: the ending of the file's name
    "MP4 (H.264)": ".mp4",
    "WebM (VP9)": ".webm",
    "WebP": ".webp",
    "PNG files": "",
}
PATIENCE = 60.0  # s that a process has to end a film
LOWER_PRIORITY = 10  # the viewer's frames come first
CODE = f"{NOT_HERE}from {PACKAGE}.commands.render import main; sys.exit(main())"


@dataclass
class FilmChoices:
    """What the window "Save film" asks for."""

    name: str = ""  # of the file, without its ending
    size: str = SIZES[2]
    fps: int = 30
    samples: int = 4
    blur: bool = False
    format: str = "MP4 (H.264)"
    transparent: bool = False
    handles: bool = False

    @property
    def path(self) -> Path:
        """The file, or the folder of pictures."""
        ending = FORMATS[self.format]
        return working_folder() / (self.name.removesuffix(ending) + ending)

    @property
    def session(self) -> Path:
        """The file for the session, beside the film: a free name."""
        stem = self.name.removesuffix(FORMATS[self.format])
        return free_name(working_folder() / stem, ".jsonl")

    @property
    def can_be_transparent(self) -> bool:
        return self.format != "MP4 (H.264)"

    def arguments(self, window_size) -> list[str]:
        """Those of deformrf render, without the model, the session and the take."""
        size = "x".join(map(str, window_size)) if self.size == SIZES[0] else self.size
        chosen = ["--size", size, "--fps", str(self.fps), "--samples", str(self.samples)]
        if self.blur and self.samples > 1:
            chosen += ["--shutter", str(BLUR)]
        if self.transparent and self.can_be_transparent:
            chosen += ["--transparent"]
        return [*chosen, *([] if self.handles else ["--hide-handles"]), "-o", str(self.path)]


class FilmJob:
    """The making of one film; a thread starts the process and reads what it prints."""

    def __init__(self, field, name: str, session: Path, arguments: list[str]):
        """Take a field and its name, a session's file, and arguments of deformrf render."""
        self.frame = self.count = 0  # frames that are made, and all
        self.ended = False
        self.written: Path | None = None
        self.problem = ""  # why there is no film, in a sentence
        self._cancelled = False
        self._process: subprocess.Popen | None = None
        self._first_at = 0.0  # when the first frame was made
        work = field, name, [*arguments, "--session", str(session), "--log-events"]
        self._thread = threading.Thread(target=self._work, args=work, name="film", daemon=True)
        self._thread.start()

    @property
    def seconds_left(self) -> float | None:
        """As the frames so far say; None before the second one."""
        if self.frame < 2:
            return None
        elapsed = time.monotonic() - self._first_at
        return elapsed / (self.frame - 1) * (self.count - self.frame)

    def cancel(self) -> None:
        """End the film where it is."""
        self._cancelled = True
        if self._process is not None:
            self._process.terminate()

    def close(self) -> None:
        """End the film, and wait for that."""
        self.cancel()
        self._thread.join(PATIENCE)
        if self._thread.is_alive() and self._process is not None:
            self._process.kill()
            self._thread.join()

    def _work(self, field, name, arguments):
        try:
            with tempfile.TemporaryDirectory(prefix="deformrf-", ignore_cleanup_errors=True) as at:
                model = fields.save_exactly(field, Path(at) / f"{name}.npz")
                self._run(str(model), *arguments)
        except Exception as error:  # the viewer goes on
            self.problem = f"the film can't be rendered: {error}"
        self.ended = True

    def _run(self, *arguments):
        if self._cancelled:
            return
        process = self._process = start(
            CODE,
            *arguments,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=working_folder(),
            start_new_session=os.name == "posix",  # Ctrl-C is for the viewer, which ends it
        )
        if os.name == "posix":
            os.setpriority(os.PRIO_PROCESS, process.pid, LOWER_PRIORITY)
        if self._cancelled:  # meanwhile
            process.terminate()
        said = ""
        try:
            for line in process.stdout:
                if line.startswith("{"):
                    self._note(line)
                elif line.strip():
                    said = line.strip()
            if process.wait() and not self._cancelled:
                self.problem = said.removeprefix("deformrf render: ")
        finally:
            process.stdout.close()
            if process.poll() is None:  # nobody reads it any more
                process.kill()
                process.wait()

    def _note(self, line):
        for text in line.replace("}{", "}\n{").splitlines():  # an interrupt may swallow the end
            event = json.loads(text)
            if event["event"] == "frame":
                if not self.frame:
                    self._first_at = time.monotonic()
                self.frame, self.count = event["frame"] + 1, event["count"]
            elif event["event"] == "written":
                self.written = Path(event["path"])
