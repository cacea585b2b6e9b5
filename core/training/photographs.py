"""Corrections for exposure and blur, made only if a camera took the images (`are_photographs`)."""

import numpy as np
import warp as wp

from .data.datasets import Dataset
from .data.raybank import RayBank
from .data.scene_box import are_photographs, learns_surroundings
from .data.sharpness import gray_of, sharpness_of, sharpness_weights
from .run.distributed import Workers
from .run.exposure import LearnedExposure
from .run.plates import LearnedPlates, untold_pixels
from .train_options import TrainOptions

NAMES_SHOWN = 4
# Of the rays that surroundings are learned from, at most, those that pass the object by: without
# them whole photographs could not be compared, with all of them mostly walls would be learned.
ASIDE = 0.1
# With less of a spread, exposures are left to colors that depend on the direction, see
# docs/design/004-training.md.
SMALL_SPREAD = 0.07


def learned_exposure(
    dataset: Dataset, options: TrainOptions, device, report: dict
) -> LearnedExposure | None:
    """Color maps of the photographs, to be learned; None for images that need none.

    Args:
        device: A Warp device.
        report: Of the run, which may have been resumed.
    """
    if "exposure" in options.leave_out or not are_photographs(dataset, options):
        return None
    if report.get("exposure_left"):
        return None
    return LearnedExposure(dataset.view_count, wp.device_to_torch(wp.get_device(device)))


def needed_exposure(exposure, report: dict, workers: Workers) -> LearnedExposure | None:
    """The color maps after stage 1, for stage 2; None if the exposures hardly differ.

    Args:
        exposure: A LearnedExposure, or None.
        report: Of the run; it then says so.
    """
    if exposure is None:
        return None
    spread = exposure.spread()
    if workers.any(spread >= SMALL_SPREAD):
        return exposure
    report |= {"exposure_spread": spread, "exposure_left": True}
    return None


def photographed_rays(
    dataset: Dataset,
    options: TrainOptions,
    world_to_model,
    device,
    box,
    plates: LearnedPlates | None,
    say,
) -> RayBank:
    """The rays of all views; of blurred photographs fewer are drawn.

    Args:
        box: Almost all rays that are drawn meet it, in model space; None: any.  [2, 3]
        plates: Behind pixels whose masks don't tell; without plates these are not drawn.
        say: Called with a sentence for the user.
    """
    bank = RayBank(dataset, world_to_model, device)
    weights = view_weights(dataset, options)
    if weights is not None:
        say(said_of_blur(dataset, weights))
    around = learns_surroundings(options.surroundings, dataset)
    untold = untold_pixels(dataset)
    if untold is not None and plates is not None:
        untold[plates.reach()] = False
    bank.draw_from(box, weights, ASIDE if around else 0.0, untold)
    return bank


def view_weights(dataset: Dataset, options: TrainOptions):
    """How much each photograph counts by its sharpness; None if all count the same.  [N]"""
    if "blur-weights" in options.leave_out or not are_photographs(dataset, options):
        return None
    images = (dataset.image(view)[..., :3] for view in range(dataset.view_count))
    weights = sharpness_weights([sharpness_of(gray_of(image)) for image in images])
    return weights if (weights < 1.0).any() else None


def said_of_blur(dataset: Dataset, weights) -> str:
    """A sentence about photographs that count less."""
    order = np.argsort(weights)[: np.count_nonzero(weights < 1.0)]
    shown = ", ".join(f"{dataset.names[i]} {weights[i]:.0%}" for i in order[:NAMES_SHOWN])
    more = f" and {len(order) - NAMES_SHOWN} more" if len(order) > NAMES_SHOWN else ""
    return (
        f"{len(order)} of {dataset.view_count} photographs are blurred and count less than the "
        f"others: {shown}{more}."
    )
