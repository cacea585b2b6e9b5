"""deformrf train: a model is trained on three views, with a checkpoint at every other step."""

import json
import re

import numpy as np
from fuzzing.models import small_models
from PIL import Image

from deformrf.core.field import load
from deformrf.core.training import load_checkpoint

from .kinds import Fault, OneFile, Signals
from .process import Job, command

STEPS = 16


def train(*arguments):
    """deformrf train with short steps, and a checkpoint every other one."""
    from deformrf.core.training import trainer
    from deformrf.core.training.run import optimization

    trainer.CHECKPOINT_SECONDS, optimization.PAUSE_INTERVAL = 0.0, 2
    optimization.RAYS_AT_START = optimization.FEWEST_RAYS = optimization.MOST_RAYS = 16
    command("train", *arguments)


class Training(OneFile):
    """The run is cut off, and then gone on with."""

    def prepare(self):
        self.data = self.inputs / "data"
        write_data(self.data)
        self.model = next(small_models(self.inputs))

    @property
    def checkpoint(self):
        return self.path.with_suffix(".checkpoint")

    def old(self):
        return self.model.read_bytes()

    def job(self, *more, seed=0):
        options = "--preset", "tiny", "--steps", STEPS, "--device", "cpu", "--seed", seed
        options += "--spacing", 0.2, "--leave-out", "coarse-stage", "--scene-radius", 1.3
        return Job((self.data, "-o", self.path, *options, *more), train)

    def look(self, ended):
        ours = {self.name, self.checkpoint.name}
        early = self.path.with_stem("model-interrupted")
        if "Stopped early" in ended.said:  # the weights so far, beside an older model
            if not self.checkpoint.exists() or "--resume" not in ended.said:
                raise Fault(f"it stopped early, and there is no checkpoint: {ended.said}")
            place = self.path if self.before is None else early
            if not load(place).meta["interrupted"]:
                raise Fault(f"{place.name} says that it is complete, but the run stopped early")
            ours |= {place.name}
            if self.before is None:
                self.before = self.path.read_bytes()
        self.check_strays(ended, *ours)
        if self.path.exists() and self.path.read_bytes() != self.before:
            self.is_whole()
            if ended.code and not self.checkpoint.exists():
                return "new"
        elif not ended.code:
            raise Fault(f"it says that it is done, but no new model is there: {ended.said}")
        return self.go_on() if ended.code else "new"

    def go_on(self):
        """Resume the run that was cut off, to its end; what that was."""
        step, more = 0, ()
        if self.checkpoint.exists():
            step, more = load_checkpoint(self.checkpoint).fit["step"]["number"], ("--resume",)
        ended = self.run(None, job=self.job(*more), name="said again")
        begun = re.search(r"from step (\d+) of", ended.said)
        if ended.code or self.path.read_bytes() == self.before:
            raise Fault(f"it can't go on from step {step}: {ended.code}, {ended.said}")
        self.is_whole()
        if self.checkpoint.exists() or (int(begun[1]) if begun else 0) != step:
            raise Fault(f"a checkpoint of step {step}, but: {ended.said}")
        kept = "absent" if self.before is None else "old"
        return f"{kept}, resumed" if step else f"{kept}, anew"

    def is_whole(self):
        meta = load(self.path).meta
        if meta["interrupted"] or meta["history"][-1]["step"] != STEPS:
            raise Fault(f"the model has {meta['history'][-1]['step']} of {STEPS} steps")


class TrainingSignals(Signals, Training):
    pass


def write_data(folder):
    """A gray square in front of three cameras."""
    pixels = np.zeros((16, 16, 4), np.uint8)
    pixels[4:12, 4:12] = 200
    for split in ("train", "test"):
        (folder / split).mkdir(parents=True)
        frames = []
        for number in range(3):
            Image.fromarray(pixels).save(folder / split / f"r_{number}.png")
            matrix = np.eye(4)
            matrix[:3, 3] = [0.0, 0.1 * number, 3.0]
            name = f"{split}/r_{number}"
            frames.append({"file_path": name, "transform_matrix": matrix.tolist()})
        scene = {"camera_angle_x": 0.7, "frames": frames}
        (folder / f"transforms_{split}.json").write_text(json.dumps(scene), encoding="utf-8")
