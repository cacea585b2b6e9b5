"""What a start leaves out: torch, measured by interpreters that import it first.

Each turn starts fresh interpreters that do what viewing needs: import, load the model, render
one small image.  The first turn does not count: it reads from a cold disk.  Seconds run from
the interpreter's first line; memory is the peak of the process from Linux's
/proc/self/status (getrusage would count the peak of the parent process).
"""

import json
import subprocess
from functools import cache
from pathlib import Path

from ....core.base.children import start
from ..stopwatch import in_turns
from .switch import NONE, START, Switch

VIEW_SIZE = 64  # pixels
WARM_UP = 1  # turns
PACKAGE = __package__.removesuffix(".wings.lab.omissions")
WHY = "Networks run in C++ on the CPU and in a Warp kernel on CUDA; torch is for training."

VIEWING = f"""
import hashlib, importlib, json, sys, time
path, device, *first = sys.argv[1:]
start = time.perf_counter()
for name in first:
    importlib.import_module(name)
from {PACKAGE}.core.base.device import start_warp
start_warp()
from {PACKAGE}.core.field import modelfile
from {PACKAGE}.core.render import Renderer
from {PACKAGE}.wings.lab.rendering.pictures import view
field = modelfile.load(path)
renderer = Renderer(field, device)
renderer.set_vertices(field.mesh.rest_vertices)
image = renderer.render(view(field, 0.5, {VIEW_SIZE})).color_array()
seconds = time.perf_counter() - start
peak = None
if sys.platform == "linux":
    lines = open("/proc/self/status").read().splitlines()
    peak = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024e-6
image = hashlib.sha256(image.tobytes()).hexdigest()
print(json.dumps([seconds, peak, "torch" in sys.modules, image]))
"""


def start_switches(path: Path, device, turns: int) -> list[Switch]:
    """Seconds and memory of torch, from the same starts."""

    @cache
    def runs():
        """What VIEWING printed in each turn, with torch and without."""
        found = {("torch",): [], (): []}
        for turn in range(-WARM_UP, turns):
            for first in list(found) if turn % 2 else list(found)[::-1]:
                run = run_python(VIEWING, str(path), device, *first)
                if turn >= 0:
                    found[first].append(run)
        return tuple(found.values())

    def measure(column):
        with_it, without = runs()
        values = [[run[column] for run in side] for side in (with_it, without)]
        if None in values[0]:
            raise RuntimeError("this system does not say how much memory a process had at most")
        same = len({run[3] for run in (*with_it, *without)}) == 1
        change = NONE if same else "the image, which differs from start to start"
        if without[0][2]:
            change = "it is not left out: this model needs it on this device"
        return in_turns(*values), change

    return [
        Switch("torch, at the start", START, "s", WHY, lambda: measure(0)),
        Switch("torch, in memory", START, "MB", WHY, lambda: measure(1)),
    ]


def run_python(program, *arguments):
    """Run a program in a fresh interpreter; return its output, parsed as JSON."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with start(program, *arguments, text=True, **pipes) as process:
        try:
            printed, errors = process.communicate()
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        words = errors.strip() or f"it ended with {process.returncode} and without a word"
        raise RuntimeError(f"a start failed: {words}")
    return json.loads(printed.splitlines()[-1])
