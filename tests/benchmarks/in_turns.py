"""Frames of two checkouts in turns, so that a busy machine slows both: medians and their ratio.

    python tests/benchmarks/in_turns.py OTHER [--model M] [--ray-colors 128 128]
        [--device cpu|cuda:0] [--cases orbit drag fill] [--sizes 300] [--frames 60]

OTHER is another checkout of this repository, for example of `git worktree add OTHER COMMIT`; it
runs in this checkout's environment.  Model, cases and errors are this checkout's: OTHER has to
have what its render_speed.py imports.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve()
ROOT = HERE.parents[2]


def serve(arguments):
    """Render the frames that the lines of stdin name, and answer with milliseconds and samples."""
    import time

    import render_speed
    import warp as wp

    from deformrf.core.base.device import start_warp
    from deformrf.core.render import Renderer

    start_warp()
    renderer = Renderer(render_speed.field_of(arguments), arguments.device)
    (case,) = render_speed.cases(arguments.cases[0], renderer, arguments)
    for frame in range(render_speed.WARM_UP_FRAMES):
        case.frame(frame)
    print("ready", flush=True)
    for line in sys.stdin:
        if line == "error\n":
            found = render_speed.error(case)
            print(found["dB"], found["max/255"], flush=True)
            continue
        start = time.perf_counter()
        image = case.frame(int(line))
        wp.synchronize_device(arguments.device)
        print(1e3 * (time.perf_counter() - start), image.sample_count, flush=True)


class Checkout:
    """A process that renders with the code of a checkout."""

    def __init__(self, root: Path, folder: Path, case, size, arguments):
        folder.mkdir()
        (folder / "deformrf").symlink_to(root)
        command = [sys.executable, HERE, root, "--serve", "--cases", case, "--sizes", size]
        command += ["--model", Path(arguments.model).resolve(), "--device", arguments.device]
        if arguments.ray_colors:
            command += ["--ray-colors", *arguments.ray_colors]
        self._process = subprocess.Popen(
            list(map(str, command)),
            env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{HERE.parent}"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        while not (line := self._process.stdout.readline()).startswith("ready"):
            if not line:
                raise SystemExit(f"{root} does not run")

    def ask(self, line):
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        if not (answer := self._process.stdout.readline()):
            raise SystemExit("a checkout's process ended early; its error stands above")
        return tuple(map(float, answer.split()))

    def close(self):
        self._process.stdin.close()
        self._process.wait()


def compare(case, size, arguments):
    with tempfile.TemporaryDirectory() as folder:
        roots = {"other": arguments.other, "this": ROOT}
        checkouts = {
            name: Checkout(root.resolve(), Path(folder) / name, case, size, arguments)
            for name, root in roots.items()
        }
        found = {name: [] for name in roots}
        for frame in range(arguments.frames):
            for name in list(roots)[:: 1 if frame % 2 else -1]:
                found[name].append(checkouts[name].ask(frame))
        errors = {name: checkout.ask("error") for name, checkout in checkouts.items()}
        for checkout in checkouts.values():
            checkout.close()
    ms = {name: np.array(rows)[:, 0] for name, rows in found.items()}
    samples = {name: np.array(rows)[:, 1].sum() for name, rows in found.items()}
    cells = [f"{case:>6} {size:>5}"]
    for name in roots:
        low, middle, high = np.percentile(ms[name], [10, 50, 90])
        decibels, most = errors[name]
        cells.append(
            f"{name} {middle:.1f} ms ({low:.1f} to {high:.1f}), {decibels:.1f} dB, {most:.1f}/255"
        )
    cells.append(f"time {np.median(ms['this'] / ms['other']):.3f}")
    cells.append(f"samples {samples['this'] / samples['other']:.3f}")
    print("; ".join(cells), flush=True)


def main():
    import render_speed

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, help="another checkout")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    render_speed.add_arguments(parser, sizes=[300], frames=60)
    arguments = parser.parse_args()
    if not (arguments.other / "core").is_dir():  # this checkout would be compared with itself
        parser.error(f"{arguments.other} is no checkout of this repository")
    if arguments.serve:
        serve(arguments)
        return
    for case in arguments.cases:
        for size in arguments.sizes:
            compare(case, size, arguments)


if __name__ == "__main__":
    main()
