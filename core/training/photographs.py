"""What photographs have and rendered images have not: exposures of their own, blur, pixels.

Exposure and blur matter where a camera took the images (`are_photographs`); elsewhere nothing here
changes a run.
"""

import numpy as np
import warp as wp

from ..capture import gray_of, sharpness_of, sharpness_weights
from ..field import below_pixel, level_edges, narrowest_pixel
from ..render import in_space
from .data import Dataset, RayBank, are_photographs
from .run import LearnedExposure
from .train_options import TrainOptions

NAMES_SHOWN = 4


def learned_exposure(dataset: Dataset, options: TrainOptions, device) -> LearnedExposure | None:
    """Color maps of the photographs, to be learned; None for images that need none.

    Args:
        device: A Warp device.
    """
    if "exposure" in options.leave_out or not are_photographs(dataset, options):
        return None
    return LearnedExposure(dataset.view_count, wp.device_to_torch(wp.get_device(device)))


def exposure_spread(exposure: LearnedExposure) -> float:
    """Standard deviation of the photographs' gains, over their mean."""
    gains = exposure.gains()
    return float(gains.std() / gains.mean())


def photographed_rays(
    dataset: Dataset, options: TrainOptions, world_to_model, device, box, say
) -> RayBank:
    """The rays of all views; of blurred photographs fewer are drawn.

    Args:
        box: Only rays that meet it are drawn, in model space; None: all.  [2, 3]
        say: Called with a sentence for the user.
    """
    bank = RayBank(dataset, world_to_model, device)
    weights = view_weights(dataset, options)
    if weights is not None:
        say(said_of_blur(dataset, weights))
    bank.draw_from(box, weights)
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


def levels_below_pixel(dataset: Dataset, world_to_model, mesh, level_count: int) -> list[int]:
    """Levels that no training image could tell apart."""
    positions = in_space(dataset.poses, world_to_model)[:, :3, 3]
    focals = np.array([max(lens.focal) for lens in dataset.lenses])
    pixel = narrowest_pixel(positions, focals, mesh.rest_vertices)
    return np.flatnonzero(below_pixel(level_edges(mesh, level_count), pixel)).tolist()
