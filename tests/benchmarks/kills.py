"""Kill commands at random moments, and look at what they leave.

    python tests/benchmarks/kills.py --count 100 [--seed 7] [--only model]

SIGKILL, which no program can answer.  In each trial a process writes a file, and is killed; the
file that was there before has to be whole, or the new one.  What begins with a dot and holds .part
may be left beside it.  A run that is trained goes on from its last checkpoint.
`interrupts` sends Ctrl-C in a command's first three seconds instead: one line and exit code 130.
`live` records a window, and is left out where there is no display.
"""

import argparse
import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import av
import numpy as np
from fuzz_models import small_models
from PIL import Image

from deformrf.core.field import load
from deformrf.core.training.run import load_checkpoint

START = "import sys; print('started', flush=True);"
MODEL = (
    START
    + """
from deformrf.core.field import load, save
fields = [load(path) for path in sys.argv[1:3]]
print('ready', flush=True)
while True:
    for field in fields:
        save(field, sys.argv[3])
"""
)
FIGURES = 30
REPORT = (
    START
    + f"count = {FIGURES}"
    + """
from deformrf.core.lab.report.parts import Figure, Report, Section
from deformrf.core.lab.report.writing import write
def report(n):
    figures = [Figure(f"f{k}", f"n {n}", b"\\x89PNG" + bytes([n]) * 20_000) for k in range(count)]
    return Report("Killed", {"n": f"n {n}"}, [Section("a", "A", [f"n {n}"], figures=figures)], True)
print('ready', flush=True)
n = 0
while True:
    n = (n + 1) % 256
    write(report(n), sys.argv[1])
"""
)
STEPS = 96
COMMAND = (
    START
    + """
from deformrf.viewer.entry import begin
program, *sys.argv[1:] = sys.argv[1:]
print('ready', flush=True)
sys.exit(begin(program))
"""
)


def killed(program, arguments, seconds, number=signal.SIGKILL):
    """Run Python, and send a signal some seconds after it is ready; exit code and stderr."""
    command = [sys.executable, "-c", program, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        for line in process.stdout:
            if line == "ready\n":
                break
        time.sleep(seconds)
        process.send_signal(number)
        _, said = process.communicate(timeout=120)
    return process.returncode, said


class Trials:
    """`trial` does one; it returns "old", "new" or a fault in words."""

    def __init__(self, folder, rng):
        self.folder, self.rng = folder, rng


class Model(Trials):
    def trial(self):
        first, second = small_models(self.folder)
        path = self.folder / "model.npz"
        path.write_bytes(first.read_bytes())
        killed(MODEL, [first, second, path], self.rng.uniform(0.0, 0.4))
        count = load(path).mesh.tet_count
        levels = load(path).options.level_count
        return {3: "first", 1: "second"}[levels] if count else "fault: no tets"


class WrittenReport(Trials):
    def trial(self):
        killed(REPORT, [self.folder], self.rng.uniform(0.05, 0.5))
        numbers, count = set(), 0
        for path in self.folder.glob("[!.]*"):
            content, count = path.read_bytes(), count + 1
            if path.suffix == ".png":
                if len(content) != 20_004 or len({*content[4:]}) != 1:
                    return f"fault: {path.name} is not whole"
                numbers.add(content[-1])
            else:
                numbers |= {int(n) for n in re.findall(r"\bn (\d+)", content.decode())}
        if len(numbers) > 1 or (count and not (self.folder / "report.html").exists()):
            return f"fault: files of the reports {numbers}"
        if count == FIGURES + 3:
            json.loads((self.folder / "report.json").read_text(encoding="utf-8"))
            return "whole"
        return "some files of one report" if count else "nothing yet"


class Film(Trials):
    """`deformrf-render` writes a film."""

    latest, frames = 4.0, [9]  # s after the command began; of the film
    program, options = "deformrf-render", ["--turntable", 0.3, "-o"]

    def trial(self):
        model, path = next(small_models(self.folder)), self.folder / "film.mp4"
        path.write_bytes(b"old")
        options = ["--size", "64x48", "--device", "cpu", *self.options, path]
        killed(COMMAND, [self.program, model, *options], self.rng.uniform(0.0, self.latest))
        begun = list(self.folder.glob(".film-*.part.mp4"))
        for part in begun:
            part.unlink()
        if path.read_bytes() == b"old":
            return "old, half of a film beside it" if begun else "old"
        with av.open(str(path)) as film:
            count = sum(1 for _ in film.decode(video=0))
        return "new" if count in self.frames else f"fault: {count} frames"


class Recording(Film):
    """`deformrf-view` records what it shows, without a window."""

    latest, frames = 4.0, [90]
    program, options = "deformrf-view", ["--headless", "--drag", "top:0,0,0.2", "--record"]


class Live(Recording):
    """The same in a window, as time passes."""

    latest, frames = 8.0, range(1, 1000)
    options = ("--frames", 60, "--record")

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME"):  # not the user's log and preferences
            os.environ[name] = str(folder / name)


class Training(Trials):
    """Most are killed between the first checkpoint and the end; an older model is there before."""

    def __init__(self, folder, rng):
        super().__init__(folder, rng)
        self.context = multiprocessing.get_context("forkserver")
        # Imports, which take longer than the training, once for all trials.
        self.context.set_forkserver_preload(["kills", "torch._dynamo", "deformrf.core.lab.command"])
        write_data(folder / "data")

    def trial(self):
        data, path, said = (self.folder / name for name in ("data", "m.npz", "said"))
        old = next(small_models(self.folder)).read_bytes()
        path.write_bytes(old)
        checkpoint = path.with_suffix(".checkpoint")
        options = [data, "-o", path, "--preset", "tiny", "--steps", STEPS, "--device", "cpu"]
        options += ["--spacing", 0.1, "--leave-out", "coarse-stage", "--scene-radius", 1.3]
        process = self.context.Process(target=train, args=(options, said))
        process.start()
        early = self.rng.random() < 0.2
        while not (early or checkpoint.exists()) and process.is_alive():
            time.sleep(0.002)
        process.join(self.rng.uniform(0.0, 1.5 if early else 3.0))
        process.kill()
        process.join()
        step = 0
        if checkpoint.exists():
            step = load_checkpoint(checkpoint).fit["step"]["number"]
            options.append("--resume")
        elif path.read_bytes() != old:
            return "was done" if whole_model(path) else "fault: the model is not whole"
        process = self.context.Process(target=train, args=(options, said))
        process.start()
        process.join()
        text = said.read_text(encoding="utf-8")
        begun = re.search(r"from step (\d+) of", text)
        if process.exitcode or path.read_bytes() == old or not whole_model(path):
            return f"fault: {text}"
        if checkpoint.exists() or (int(begun[1]) if begun else 0) != step:
            return f"fault: a checkpoint of step {step}, but: {text}"
        return "resumed" if step else "anew"


def train(options, said):
    """deformrf-train with short steps, and a checkpoint every other one; output to a file."""
    from deformrf.core.commands.train import main
    from deformrf.core.training import trainer
    from deformrf.core.training.run import optimization

    trainer.CHECKPOINT_SECONDS, optimization.PAUSE_INTERVAL = 0.0, 2
    optimization.RAYS_AT_START = optimization.FEWEST_RAYS = optimization.MOST_RAYS = 16
    sys.argv = ["deformrf-train", *map(str, options)]
    with said.open("w") as sys.stdout:
        sys.stderr = sys.stdout
        main()


def whole_model(path):
    """Whether a file has a model with all steps."""
    meta = load(path).meta
    return not meta["interrupted"] and meta["history"][-1]["step"] == STEPS


class Interrupts(Trials):
    def trial(self):
        model, out = next(small_models(self.folder)), self.folder / "out"
        arguments = {
            "deformrf-view": [model, "--headless", "--frames", 900, "--record", f"{out}.mp4"],
            "deformrf-render": [model, "--turntable", 9, "-o", f"{out}.mp4"],
            "deformrf-train": [self.folder / "data", "-o", f"{out}.npz", "--scene-radius", 1.3],
            "deformrf-eval": [model, self.folder / "data", "--device", "cpu"],
            "deformrf-report": [model, "--device", "cpu", "-o", out],
        }
        if not (self.folder / "data").exists():
            write_data(self.folder / "data")
        program = str(self.rng.choice(list(arguments)))
        moment = self.rng.uniform(0.0, 3.0)
        code, said = killed(COMMAND, [program, *arguments[program]], moment, signal.SIGINT)
        # -2: after the command's end, while Python itself ends; a shell says 130 then, too.
        lines = [line for line in said.splitlines() if "interrupted" in line or "Error" in line]
        if "Traceback" in said or code not in (0, 130, -2) or len(lines) > 1:
            return f"fault: {program} after {moment:.2f} s: {code}, {said}"
        return "quiet"


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


KINDS = {
    "model": Model,
    "report": WrittenReport,
    "film": Film,
    "recording": Recording,
    "live": Live,
    "training": Training,
    "interrupts": Interrupts,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=10, help="trials of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=KINDS)
    arguments = parser.parse_args()
    rng, failed = np.random.default_rng(arguments.seed), False
    kinds = [name for name in KINDS if name != "live" or "DISPLAY" in os.environ]
    for name in [arguments.only] if arguments.only else kinds:
        counts = {}
        with tempfile.TemporaryDirectory(prefix="kills-") as folder:
            trials = KINDS[name](Path(folder), rng)
            for _ in range(arguments.count):
                try:
                    result = trials.trial()
                except Exception as error:  # what is left can't be read
                    result = f"fault: {error!r}"
                if result.startswith("fault"):
                    print(name, result, flush=True)
                key = result.split(":")[0]
                counts[key] = counts.get(key, 0) + 1
        failed |= "fault" in counts
        print(
            name, ", ".join(f"{key} {count}" for key, count in sorted(counts.items())), flush=True
        )
    sys.exit(failed)


if __name__ == "__main__":
    main()
