"""Omissions at the start, measured by interpreters that import the omitted modules first.

Each turn starts fresh interpreters that do what viewing needs: import, load the model, render
one small image.  The first turn does not count: it reads from a cold disk.  Seconds run from
the interpreter's first line; memory is the peak of the process from Linux's
/proc/self/status (getrusage would count the peak of the parent process).  Kernels are in
Warp's cache, except for the row that compiles them.
"""

import json
import subprocess
import sys
import tempfile

from ....core.base.children import start
from ..stopwatch import in_turns
from .measure import NONE, START, Omission, not_measured, omission

VIEW_SIZE = 64  # pixels
WARM_UP = 1  # turns
PACKAGE = __package__.removesuffix(".wings.lab.omissions")
TORCH = ("torch",)
REPORTS = ("matplotlib.figure", "scipy.sparse.linalg")
OF_CUDA, OF_CPU = "core.render.rounds.slots", "core.deform.frame.cpu"  # a large module of each

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
imported = [name for name in {TORCH + REPORTS!r} if name in sys.modules]
print(json.dumps([seconds, peak, imported, hashlib.sha256(image.tobytes()).hexdigest()]))
"""

COMPILING = f"""
import importlib, json, sys, time
module, device, folder = sys.argv[1:]
import warp as wp
wp.config.kernel_cache_dir = folder
from {PACKAGE}.core.base.device import start_warp
start_warp()
import {PACKAGE}.core.render.render
importlib.import_module(module)
wp.load_module("{PACKAGE}.core.render.render", device=device)  # the compiler starts anyway
start = time.perf_counter()
wp.load_module(module, device="cpu")
print(json.dumps(time.perf_counter() - start))
"""


MODULES = {  # name: modules, and why a start omits them
    "torch": (
        TORCH,
        "Networks run in C++ on the CPU and in a Warp kernel on CUDA; torch is for training.",
    ),
    "matplotlib and scipy": (
        REPORTS,
        "Only reports draw curves and solve for references, and import them late.",
    ),
}


def import_rows(path, device, turns: int) -> list[Omission]:
    """Seconds and memory of torch, and of the modules that only reports need."""
    ways = ((), TORCH, REPORTS)
    runs = {way: [] for way in ways}
    for turn in range(-WARM_UP, turns):
        for way in ways if turn % 2 else ways[::-1]:
            run = _run(VIEWING, str(path), device, *way)
            if turn >= 0:
                runs[way].append(run)
    return [row for name in MODULES for row in rows_of(name, runs)]


def rows_of(name, runs) -> list[Omission]:
    """Seconds and memory of starts with and without the modules of a name.

    Args:
        runs: For each tuple of modules imported first, what VIEWING printed in each turn.
    """
    modules, why = MODULES[name]
    asked, plain = runs[modules], runs[()]
    left_out = not set(modules) & set(plain[0][2])
    why = why if left_out else "It is imported anyway: this model needs it on this device."
    images = {run[3] for run in (*asked, *plain)}
    change = NONE if len(images) == 1 else "the image, which differs from start to start"
    rows = []
    for unit, place, what in (("s", 0, "at the start"), ("MB", 1, "in memory")):
        with_it, without = ([run[place] for run in way] for way in (asked, plain))
        title = f"{name}, {what}"
        if None in with_it:
            unknown = "This system doesn't say how much memory a process had at most."
            rows.append(not_measured(title, START, unknown, left_out, unit))
        else:
            turns = in_turns(with_it, without)
            rows.append(omission(title, START, turns, change, why, left_out, unit))
    return rows


def kernel_row(device, turns: int) -> Omission:
    """Kernels that only another device runs, compiled at the first start."""
    module = f"{PACKAGE}.{OF_CUDA if device == 'cpu' else OF_CPU}"
    seconds = []
    for _ in range(turns):
        with tempfile.TemporaryDirectory() as folder:
            seconds.append(_run(COMPILING, module, device, folder))
    other = "CUDA" if device == "cpu" else "the CPU"
    return omission(
        f"kernels of {other} ({module.rpartition('.')[2]}), at the first start",
        START,
        in_turns(seconds, [0.0] * turns),
        "nothing that is shown: no image is made with them",
        f"Only {other} runs them; users of this device do not wait for them to compile.",
    )


def _run(program, *arguments):
    """Run a program in a fresh interpreter; return its output, parsed as JSON."""
    command = [sys.executable, "-c", program, *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with start(command, text=True, **pipes) as process:
        try:
            printed, errors = process.communicate()
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        words = errors.strip() or f"it ended with {process.returncode} and without a word"
        raise RuntimeError(f"a start failed: {words}")
    return json.loads(printed.splitlines()[-1])
