"""What a person has to know, in figures: lines of rooms, words of pages, functions that run.

    python tests/benchmarks/house.py

Lines are those of Python, stubs and native code, with blanks and comments.  Functions are those of
the program that Python calls while the bundled model is dragged for one frame on a CPU, and in
one step of training; comprehensions are lines of theirs.  `.ci/run` prints the table at its end.
"""

import os
import sys
import tempfile
import threading
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

from deformrf.core.base.device import start_warp
from deformrf.core.base.paths import DEFAULT_MODEL, ROOT

ROOMS = "core", "wings", "commands", "viewer"
INNER = "core", "wings"  # whose rooms have rows of their own
WARM_UP = 12  # frames
KINDS = {  # by whether the object moves, and whether the panels are built anew
    (True, False): "the object moves",
    (True, True): "with new panels",
    (False, False): "no time passes",
}
COMPREHENSIONS = "<listcomp>", "<genexpr>", "<dictcomp>", "<setcomp>"  # calls up to Python 3.11
SUFFIXES = ".py", ".pyi", ".cpp", ".cu", ".h"


def lines_of(folder: Path) -> int:
    files = (path for path in folder.rglob("*") if path.suffix in SUFFIXES)
    return sum(path.read_bytes().count(b"\n") for path in files)


def words_of(pages) -> int:
    return sum(len(page.read_text(encoding="utf-8").split()) for page in pages)


@contextmanager
def functions_called():
    """A Counter of (file, qualified name) of this program's functions, filled within the block."""
    calls, tracers = Counter(), (sys.getprofile(), threading.getprofile())
    folders = tuple(f"{ROOT / room}{os.sep}" for room in ROOMS)

    def profile(frame, event, _):
        path, name = frame.f_code.co_filename, frame.f_code.co_name
        if event == "call" and path.startswith(folders) and name not in COMPREHENSIONS:
            calls[path, frame.f_code.co_qualname] += 1

    threading.setprofile(profile)  # tiles of an image are rendered in threads
    sys.setprofile(profile)
    try:
        yield calls
    finally:
        sys.setprofile(tracers[0])
        threading.setprofile(tracers[1])


def of_dragged_frames() -> dict[str, Counter]:
    """Of one in which the object moves, of one that draws new panels as well, and of one in which
    no time passes.
    """
    from deformrf.core.field import load
    from deformrf.viewer.window import open_window

    window, context = open_window((320, 240), headless=True)
    from deformrf.viewer.app import App
    from deformrf.viewer.events import EventLog

    app, found = App(window, context, EventLog(False), gui=True), {}
    app.load(load(DEFAULT_MODEL), "model", "cpu")
    app.controls.grab(int(app.scene.handles.control_ids[0]))
    frame = app.frame

    def profiled(*arguments):
        with functions_called() as calls:
            frame(*arguments)
        names = {name for _, name in calls}
        moves, builds = "XpbdSolver.step" in names, "Panels.draw" in names
        kind = KINDS.get((moves, builds))
        if kind and len(calls) > len(found.get(kind, ())) and app.frame_count > WARM_UP:
            found[kind] = calls

    app.frame = profiled
    for step in range(4 * WARM_UP):
        app.window.dispatch_event("on_mouse_drag", 100 + 4 * step, 100, 4, 0, 1, 0)
        app.run(app.frame_count + 3)
    app.close()
    return found


def of_a_training_step() -> Counter:
    import torch

    from deformrf.core.field import FieldOptions
    from deformrf.core.geometry import a15_grid
    from deformrf.core.training import preset, world_to_unit_cube
    from deformrf.core.training.data.raybank import RayBank
    from deformrf.core.training.run.optimization import Optimization
    from deformrf.core.training.run.training_field import TrainingField

    sys.path.append(str(ROOT / "tests" / "support"))
    from gray_photographs import gray_photographs

    torch.set_num_threads(1)
    dataset = gray_photographs(alpha=128)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), "cpu")
    field = TrainingField(a15_grid(0.25), FieldOptions(2, 2**8, march_step=0.05), "cpu")
    options = preset("tiny", samples_per_step=2**13, coarse_steps=50, fine_steps=50)
    run = Optimization(field, bank, options, dataset.has_alpha, 50, 0.3)
    for _ in range(3):
        with functions_called() as calls:
            run.step(1e-3, white=True)
    return calls


def told(calls: Counter) -> str:
    files = {path for path, _ in calls}
    return f"{len(files)} files, {len(calls)} functions, {sum(calls.values())} calls"


def main():
    start_warp()
    total = {}
    print("lines of Python and native code")
    for room in ROOMS:
        total[room] = lines_of(ROOT / room)
        print(f"  {room:20} {total[room]:6}")
        for folder in sorted(ROOT.joinpath(room).iterdir()) if room in INNER else ():
            if (folder / "__init__.py").exists():
                print(f"    {room}/{folder.name:13} {lines_of(folder):6}")
    print(f"  {'all':20} {sum(total.values()):6}")
    print(f"  {'without wings':20} {sum(total.values()) - total['wings']:6}")
    print(f"  {'tests':20} {lines_of(ROOT / 'tests'):6}")
    pages = [*ROOT.glob("*.md"), *ROOT.joinpath("docs").rglob("*.md")]
    reports = [page for page in pages if ROOT / "docs" / "report" in page.parents]
    print(f"words of the pages: {words_of(pages) - words_of(reports)}; reports {words_of(reports)}")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_STATE_HOME"] = os.environ["XDG_CONFIG_HOME"] = folder
        for kind, calls in of_dragged_frames().items():
            print(f"a dragged frame on a CPU, {kind}: {told(calls)}")
        print(f"a training step: {told(of_a_training_step())}")


if __name__ == "__main__":
    main()
