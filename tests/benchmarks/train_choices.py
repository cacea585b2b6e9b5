"""Quality and time of training over choices that the paper leaves open, one run each.

    python tests/benchmarks/train_choices.py DATA [--device cuda:0] [--preset fast] NAME ...

Names: rows of CHOICES, or several joined by " + "; all of them if none is given.  Scored on
every fifth training view, which is held aside, never on test views.
"""

import argparse
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pkgutil import resolve_name
from unittest import mock

import numpy as np
import torch
from views import subset

from deformrf.core.base.device import start_warp
from deformrf.core.training import evaluation as evaluate
from deformrf.core.training import load_dataset, preset, trainer
from deformrf.core.training.run.training_field import TrainingField

encode = TrainingField.encode


def two_features(field, sample_tet, sample_bary):
    """What F = 2 would learn: the other two features of each entry count for nothing."""
    features = encode(field, sample_tet, sample_bary)
    used = torch.tensor([1.0, 1.0, 0.0, 0.0], device=features.device, dtype=features.dtype)
    return features * used.repeat(field.layout.level_count)


# Options, or what a module of core.training has ("stages.FINAL_RATES").
CHOICES = {
    "default": {},
    "2 features an entry": {"run.training_field.TrainingField.encode": two_features},
    "T = 2^17": {"table_size_log2": 17},
    "T = 2^18": {"table_size_log2": 18},
    "T = 2^19": {"table_size_log2": 19},
    "T = 2^20": {"table_size_log2": 20},
    "T = 2^21": {"table_size_log2": 21},
    "step 0.001": {"march_step": 0.001},
    "step 0.0013": {"march_step": 0.0013},
    "step 0.0016": {"march_step": 0.0016},
    "step 0.003": {"march_step": 0.003},
    "5 levels": {"level_count": 5},
    "7 levels": {"level_count": 7},
    "8 levels": {"level_count": 8},
    "2^20 samples": {"samples_per_step": 2**20},
    "2^19 samples": {"samples_per_step": 2**19},
    "2^17 samples": {"samples_per_step": 2**17},
    "no distortion loss": {"distortion": 0.0},
    "distortion 1e-3": {"distortion": 1e-3},
    "rate 2e-2": {"learning_rate": 2e-2},
    "rate 5e-3": {"learning_rate": 5e-3},
    "final rate 0.01": {"stages.FINAL_RATES": {1: 0.1, 2: 0.01}},
    "final rate 0.03": {"stages.FINAL_RATES": {1: 0.1, 2: 0.03}},
    "final rate 0.1": {"stages.FINAL_RATES": {1: 0.1, 2: 0.1}},
    "final rate 0.3": {"stages.FINAL_RATES": {1: 0.1, 2: 0.3}},
    "last weights": {"run.optimization.AVERAGED_SHARE": 0.0},
    "average 0.02": {"run.optimization.AVERAGED_SHARE": 0.02},
    "average 0.1": {"run.optimization.AVERAGED_SHARE": 0.1},
    "white for a fifth": {"run.optimization.WHITE_SHARE": 0.2},
    "always white": {"run.optimization.WHITE_SHARE": 1.0},
    "beta2 0.999": {"run.optimization.BETAS": (0.9, 0.999)},
    "thinner occupied": {"run.training_field.OCCUPIED_THICKNESS": 1e-3},
    "hide less": {"trainer.UNSEEN_WEIGHT": 1e-4, "trainer.COARSE_UNSEEN_WEIGHT": 5e-3},
}


@contextmanager
def chosen(names, preset_name):
    """Options of a row "a + b", with the constants that it changes changed."""
    changes = {}
    for name in names.split(" + "):
        changes |= CHOICES[name]
    constants = {key: value for key, value in changes.items() if "." in key}
    with ExitStack() as stack:
        for key, value in constants.items():
            path, _, name = key.rpartition(".")
            owner = resolve_name(f"deformrf.core.training.{path}")
            stack.enter_context(mock.patch.object(owner, name, value))
        yield preset(preset_name, **{k: v for k, v in changes.items() if k not in constants})


def split(dataset):
    """Training views and every fifth one, held aside."""
    aside = np.arange(dataset.view_count) % 5 == 2
    return subset(dataset, np.flatnonzero(~aside)), subset(dataset, np.flatnonzero(aside))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("names", nargs="*")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--image-size", type=int)
    parser.add_argument("--fine-steps", type=int)
    arguments = parser.parse_intermixed_args()
    start_warp()
    train_views, held_aside = split(load_dataset(arguments.data, "train", arguments.image_size))
    print(f"{'choice':<40}{'PSNR':>8}{'SSIM':>8}{'seconds':>9}{'tets':>8}{'occupied':>10}")
    for name in arguments.names or CHOICES:
        with chosen(name, arguments.preset) as options:
            if arguments.fine_steps:
                options = replace(options, fine_steps=arguments.fine_steps)
            trained = trainer.train(train_views, options, arguments.device)
        if trained.interrupted:
            break
        scores = evaluate.evaluate(trained.field, held_aside, device=arguments.device, samples=1)
        mean = scores["mean"]
        report = trained.report
        print(
            f"{name:<40}{mean['psnr']:>8.2f}{mean['ssim']:>8.4f}{report['seconds']:>9.1f}"
            f"{report['tet_count']:>8}{report['occupied_share']:>10.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
