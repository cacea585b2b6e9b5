"""Training of photographs by a process of its own.

That process runs `main_of_job` in commands/train.py.  Now and then it prints an event of how far it
is and writes a snapshot, a model file, unless the last one still lies there.  It obeys what is
written to it: pause, go on, stop.
"""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

from ...core.base.children import NOT_HERE, PACKAGE
from ...core.base.paths import free_name, working_folder
from ...core.training import about_raw_files, photo_folder
from ...wings import capture
from ..files import readable
from ..jobs import ProcessJob

CODE = f"{NOT_HERE}from {PACKAGE}.commands.train import main_of_job; sys.exit(main_of_job())"
PHOTO_MINUTES, RUN_MINUTES = 0.025, {"cpu": 7.0, "cuda": 1.5}  # per photograph, and of training
WAIT_SECONDS = 0.05  # between two looks for Ctrl-C


@dataclass(frozen=True)
class TrainOffer:
    """What the viewer would do with photographs: a dialog asks whether it shall.

    Attributes:
        data: Folder of photographs, or a video.
        count: Of the photographs; None of a video.
        output: The model to be written.
        device: "cpu" or "cuda".
        said: A sentence about files that are not read; empty without any.
    """

    data: Path
    count: int | None
    output: Path
    device: str
    said: str = ""

    title = "Train a model of these photographs?"

    @property
    def arguments(self) -> list[str]:
        """Those of deformrf train."""
        preset = ["--preset", "tiny"] if self.device == "cpu" else []
        return [str(self.data), "-o", str(self.output), *preset, "--device", self.device]

    @property
    def command(self) -> str:
        """The same, as one types it."""
        return "deformrf train " + " ".join(map(shlex.quote, self.arguments))

    @property
    def minutes(self) -> int:
        """How long it may take."""
        return round((self.count or 100) * PHOTO_MINUTES + RUN_MINUTES[self.device]) + 1

    def lines(self) -> list[str]:
        """What would happen, in sentences."""
        count = "The video" if self.count is None else f"The folder has {self.count} photographs"
        where = "a GPU" if self.device == "cuda" else "this CPU"
        return [
            f"{count}: {readable(self.data)}",
            *([readable(self.said)] if self.said else []),
            f"Their cameras are found and a model is trained, in about {self.minutes} minutes on "
            f"{where}. It is opened here when it is done. This command does the same:",
            readable(self.command),
        ]


def offer_of(data: Path, device: str) -> TrainOffer:
    """The offer to train a video or a folder of photographs, on a Warp device.

    Raises:
        DatasetError: Several folders in it hold photographs, or there are none but raw files.
    """
    folder = None if capture.is_video(data) else photo_folder(data)
    count = None if folder is None else len(capture.find_photos(folder)[0])
    output = free_name(working_folder() / data.resolve().stem, ".npz")
    said = "" if folder is None else about_raw_files(folder)
    return TrainOffer(data, count, output, "cpu" if device == "cpu" else "cuda", said)


class TrainJob(ProcessJob):
    """A run of deformrf train.

    Attributes:
        output: The model that it writes.
        device: The Warp device that it uses.
        stays: Whether it goes on without its window, from which a command has begun it.
        progress: Its last event "step"; None before.
        snapshot: The last event "snapshot" whose file nobody has read.
        trained: Whether all that is left is to write and score the model.
        steps_per_second: Of late; 0 before it is known.
    """

    failure = "training can't begin"
    patience = 120.0  # s, to write its work
    progress: dict | None = None
    snapshot: dict | None = None
    paused = trained = False
    steps_per_second = 0.0

    def __init__(self, arguments: list[str], output: Path, device: str, stays: bool = False):
        """Begin a run with the arguments of deformrf train."""
        self.output, self.device, self.stays = output, device, stays
        if stays:  # the terminal's; and frames do not come first
            self.stderr, self.priority = None, 0
        super().__init__(CODE, lambda folder: [str(folder / "snapshot.npz"), *arguments])

    def note(self, event):
        if event["event"] == "snapshot":
            self.snapshot = event
        elif event["event"] == "trained":
            self.trained, self.paused = True, False
        else:
            before, self.progress = self.progress, event
            is_on = before is not None and before["stage"] == event["stage"]
            if is_on and event["step"] > before["step"]:  # stage 2 may begin anew
                seconds = max(event["seconds"] - before["seconds"], 1e-9)
                self.steps_per_second = (event["step"] - before["step"]) / seconds

    def hear(self, line):
        if self.stays:
            print(line, end="", flush=True)

    def pause(self, paused: bool) -> None:
        """Let it wait after its next few steps, or go on."""
        self.paused = paused
        self.tell("pause" if paused else "go on")

    def end(self, process):
        self.tell("stop")

    def stop(self) -> None:
        """Tell it to end as by Ctrl-C, and keep its work; a second time, at once."""
        if self.stopping:
            self.tell("stop")
        super().stop()

    def wait(self) -> int | None:
        """Wait for its end; returns its exit code, None if it could not begin."""
        while self._thread.is_alive():
            try:
                self._thread.join(WAIT_SECONDS)
            except KeyboardInterrupt:
                self.stop()
        return self.code

    def close(self) -> None:
        if not self.ended:
            print("Training stops; what is done is written.", file=sys.stderr, flush=True)
        super().close()
