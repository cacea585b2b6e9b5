"""Whether training keeps what it has learned, at higher learning rates than its own.

    python tests/benchmarks/stable_training.py DATA [--device cuda:0] [--preset default]
        [--rates 1 2 4] [--seeds 2] [--steps 7000] [--image-size PIXELS]

The learning rate of stage 2 is multiplied by each of the rates, and its first steps are done.  A
run whose loss diverged goes back to its last good weights: at which steps it did is printed, and
the error of the training rays over the last pauses.
"""

import argparse
from dataclasses import replace
from unittest import mock

import numpy as np

from deformrf.core.base.device import start_warp
from deformrf.core.training import load_dataset, preset, trainer
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.stages import field_options

LAST = 10  # pauses, whose median error is printed


class Enough(Exception):
    """The steps are done."""


def run(views, options, rate, step_count, device) -> str:
    """Train with that multiple of stage 2's rate; what became of it, a phrase."""
    stages, errors, returned = [], [], []

    def stage_of(field, bank, options, *others):
        if field.options == field_options(options):
            options = replace(options, learning_rate=rate * options.learning_rate)
        stages.append(Optimization(field, bank, options, *others))
        return stages[-1]

    def look(pause):
        if pause.stage == 1:
            return
        errors.append(float(stages[-1].error))
        if stages[-1].returns > len(returned):
            returned.append(pause.step)
        if pause.step >= step_count:
            raise Enough

    with mock.patch.object(trainer, "Optimization", stage_of):
        try:
            end = trainer.train(views, options, device, on_pause=look).diverged or "all steps"
        except Enough:
            end = f"{step_count} steps"
    decibels = -10.0 * np.log10(np.median(errors[-LAST:]))
    steps = f" at steps {', '.join(map(str, returned))}" if returned else ""
    return f"returned {len(returned)} times{steps}; {decibels:.1f} dB at the end; {end}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--rates", type=float, nargs="+", default=[1.0, 2.0, 4.0])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--steps", type=int, default=7000)
    parser.add_argument("--image-size", type=int)
    arguments = parser.parse_args()
    start_warp()
    views = load_dataset(arguments.data, "train", arguments.image_size)
    for rate in arguments.rates:
        for seed in range(arguments.seeds):
            options = preset(arguments.preset, seed=seed)
            end = run(views, options, rate, arguments.steps, arguments.device)
            print(f"{rate:g} times the rate, seed {seed}: {end}", flush=True)


if __name__ == "__main__":
    main()
