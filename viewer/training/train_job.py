"""Training of photographs by a process of its own, which the viewer begins when it is asked to.

That process runs `main_of_job` in commands/train.py, which prints an event of how far it is now and
then.  It is ended as by Ctrl-C, which keeps its work.
"""

import os
import shlex
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

from ...core.base.children import NOT_HERE, PACKAGE
from ...core.base.paths import free_name, working_folder
from ...core.training import photo_folder
from ...wings import capture
from ..files import readable
from ..jobs import ProcessJob

CODE = f"{NOT_HERE}from {PACKAGE}.commands.train import main_of_job; sys.exit(main_of_job())"
PHOTO_MINUTES, RUN_MINUTES = 0.025, {"cpu": 7.0, "cuda": 1.5}  # per photograph, and of training


@dataclass(frozen=True)
class TrainOffer:
    """What the viewer would do with photographs: a dialog asks whether it shall.

    Attributes:
        data: Folder of photographs, or a video.
        count: Of the photographs; None of a video.
        output: The model to be written.
        device: "cpu" or "cuda".
    """

    data: Path
    count: int | None
    output: Path
    device: str

    @property
    def title(self) -> str:
        return "Train a model of these photographs?"

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
            f"Their cameras are found and a model is trained, in about {self.minutes} minutes on "
            f"{where}. It is opened here when it is done. This command does the same:",
            readable(self.command),
        ]


def offer_of(data: Path, device: str) -> TrainOffer:
    """The offer to train a video or a folder of photographs, on a Warp device.

    Raises:
        DatasetError: Several folders in it hold photographs.
    """
    folder = None if capture.is_video(data) else photo_folder(data)
    count = None if folder is None else len(capture.find_photos(folder)[0])
    output = free_name(working_folder() / data.resolve().stem, ".npz")
    return TrainOffer(data, count, output, "cpu" if device == "cpu" else "cuda")


class TrainJob(ProcessJob):
    """A run of deformrf train."""

    failure = "training can't begin"
    end_by = signal.SIGINT if os.name == "posix" else signal.SIGTERM
    patience = 120.0  # s, to write its work
    progress: dict | None = None  # stage, step, steps

    def __init__(self, offer: TrainOffer):
        self.offer = offer
        super().__init__(CODE, lambda _: offer.arguments)

    @property
    def share(self) -> float:
        """Of the steps that are done."""
        told = self.progress
        return 0.0 if told is None else (told["stage"] - 1 + told["step"] / told["steps"]) / 2.0

    def note(self, event):
        self.progress = event

    def close(self) -> None:
        if not self.ended:
            print("Training stops; what is done is written.", file=sys.stderr, flush=True)
        super().close()


def begin_job(app) -> None:
    """Do what the App's dialog offers."""
    offer, app.questions.dialog = app.questions.dialog, None
    if app.train_job is None:
        app.train_job = TrainJob(offer)
        app.log("training", path=offer.data)
    else:
        app.recorder.say("one model is being trained: wait for it, or stop it")


def follow_job(app) -> None:
    """Called in every frame: open the model when it is trained, or say why there is none."""
    job = app.train_job
    if job is None or not job.ended:
        return
    app.train_job = None
    if job.code == 0:
        app.opening.asked = job.offer.output
    app.recorder.say(readable(job.line))
