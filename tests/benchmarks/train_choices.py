"""Quality and time of training over choices that the paper leaves open, one run each.

    python tests/benchmarks/train_choices.py DATA [--device cuda:0] [--preset fast] NAME ...

Names: the rows of CHOICES; all of them if none is given.  Scored on every fifth training
view, which is held aside, never on test views.
"""

import argparse

import numpy as np

from deformrf.core.device import start_warp
from deformrf.core.training import datasets, evaluate, trainer
from deformrf.core.training.options import preset

CHOICES = {
    "default": {},
    "2 density layers": {"density_layers": 2},
    "3 sigmoid layers (paper)": {"density_layers": 3, "density_activation": "sigmoid"},
    "T = 2^17": {"table_size_log2": 17},
    "T = 2^19": {"table_size_log2": 19},
    "march step 0.0013": {"march_step": 0.0013},
    "march step 0.003": {"march_step": 0.003},
    "5 levels": {"level_count": 5},
    "7 levels": {"level_count": 7},
    "no distortion loss": {"distortion": 0.0},
}


def split(dataset):
    """Training views and every fifth one, held aside."""
    aside = np.arange(dataset.view_count) % 5 == 2
    return dataset.subset(np.flatnonzero(~aside)), dataset.subset(np.flatnonzero(aside))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("names", nargs="*")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--image-size", type=int)
    arguments = parser.parse_intermixed_args()
    start_warp()
    train_views, held_aside = split(datasets.load(arguments.data, "train", arguments.image_size))
    print(f"{'choice':<26}{'PSNR':>8}{'SSIM':>8}{'seconds':>9}{'tets':>8}{'occupied':>10}")
    for name in arguments.names or CHOICES:
        options = preset(arguments.preset, **CHOICES[name])
        trained = trainer.train(train_views, options, arguments.device)
        if trained.interrupted:
            break
        mean = evaluate.evaluate(trained.field, held_aside, device=arguments.device)["mean"]
        report = trained.report
        print(
            f"{name:<26}{mean['psnr']:>8.2f}{mean['ssim']:>8.4f}{report['seconds']:>9.1f}"
            f"{report['tet_count']:>8}{report['occupied_share']:>10.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
