"""Photographs to a field, in two stages (DeformRF, section 3.4).

Stage 1 trains few levels on the A15 grid of the whole scene box and learns where density
is; the occupied tets, what they enclose and their neighbours are kept.  Stage 2 trains all
levels on the kept tets.  Both minimise

    mean squared error of the composited color + distortion weight · distortion

with Adam.  Images with alpha are composited on a random background per ray until the last
fifth of a stage, then on white: so that empty space learns to be empty, and the result is
at its best on the background it is scored on.
"""

import time
from dataclasses import asdict, dataclass, replace
from math import cos, pi

import numpy as np
import torch
import warp as wp

from ..field.field import FieldOptions, TetField
from ..field.occupancy import fill_enclosed
from ..geometry.lattice import a15_grid
from ..geometry.mesh import TetMesh, extract, face_components, tet_neighbours
from .batch import Batch
from .capture import DatasetError
from .datasets import Dataset
from .differentiable import on_warp_stream
from .options import TrainOptions
from .progress import TrainingProgress
from .raybank import RayBank
from .scene_box import world_to_unit_cube
from .stage import Stage
from .step import Step

WARM_UP_STEPS = 100
FINAL_RATE = 0.01  # of the first learning rate, at the cosine's end
WHITE_SHARE = 0.2  # of the steps, at the end
OCCUPANCY_INTERVAL = 16  # steps
OCCUPANCY_WARM_UP = 256  # steps in which every update looks at all sub-tets
COARSE_LEVELS = 4
COARSE_STEP_FACTOR = 2.0  # Δ of stage 1 over Δ of stage 2
UNSEEN_WEIGHT = 1e-3  # a sub-tet that never contributes as much is hidden
COARSE_UNSEEN_WEIGHT = 2e-2  # after stage 1, whose empty space is still a thin fog
COARSE_LOOK, FINE_LOOK = 4, 16  # rays that look for it, over the samples of a step
SMALLEST_COMPONENT = 0.005  # of the tets; smaller ones are floaters
RAYS_AT_START, FEWEST_RAYS, MOST_RAYS = 1 << 10, 1 << 8, 1 << 16
FILLED = 0.9  # share of a step's room for samples that the number of rays aims at


@dataclass
class Trained:
    """What `train` returns: the field, what happened, and whether it was cut short."""

    field: TetField
    report: dict
    interrupted: bool


def train(dataset: Dataset, options: TrainOptions, device="cpu", name="") -> Trained:
    """Train a field.

    Args:
        dataset: The training views.
        device: A Warp device.
        name: Of the data, for the model file.

    A KeyboardInterrupt ends the run early; the field is then what there is.
    """
    torch.manual_seed(options.seed)
    wp.init()
    world_to_model = world_to_unit_cube(dataset, options.aabb, options.scene_radius)
    start = time.perf_counter()
    report = {
        "data": name,
        "view_count": dataset.view_count,
        "image_size": list(max((lens.width, lens.height) for lens in dataset.lenses)),
        "missing_images": len(dataset.missing),
        "options": asdict(options),
    }
    interrupted = False
    with on_warp_stream(device), TrainingProgress() as progress:
        bank = RayBank(dataset, world_to_model, device)
        stage = Stage(a15_grid(options.spacing), coarse_options(options), device, options.seed)
        try:
            _fit(stage, bank, dataset.has_alpha, options, options.coarse_steps, "stage 1", progress)
            stage.update_occupancy()
            looks = _looking_batches(bank, device, COARSE_LOOK * options.samples_per_step)
            stage.hide_unseen(looks, COARSE_UNSEEN_WEIGHT)
            report["stage_1_seconds"] = time.perf_counter() - start

            mesh = kept_mesh(stage)
            report["stage_1_tet_count"], report["tet_count"] = stage.mesh.tet_count, mesh.tet_count
            stage = Stage(mesh, field_options(options), device, options.seed)
            _fit(stage, bank, dataset.has_alpha, options, options.fine_steps, "stage 2", progress)
            looks = _looking_batches(bank, device, FINE_LOOK * options.samples_per_step)
            stage.hide_unseen(looks, UNSEEN_WEIGHT)
        except KeyboardInterrupt:
            interrupted = True
        report["seconds"] = time.perf_counter() - start
        report["interrupted"] = interrupted
        report["occupied_share"] = stage.occupied_share()
        if stage.device.is_cuda:
            report["peak_memory_bytes"] = torch.cuda.max_memory_allocated() + (
                wp.get_mempool_used_mem_high(stage.device)
            )
        report["device"] = stage.device.name
        field = stage.export(world_to_model, report)
    return Trained(field, report, interrupted)


def field_options(options: TrainOptions) -> FieldOptions:
    return FieldOptions(
        level_count=options.level_count,
        table_size=2**options.table_size_log2,
        density_hidden=(64,) * options.density_layers,
        density_activation=options.density_activation,
        march_step=options.march_step,
    )


def coarse_options(options: TrainOptions) -> FieldOptions:
    """The field of stage 1."""
    fine = field_options(options)
    return replace(
        fine,
        level_count=min(COARSE_LEVELS, options.level_count),
        march_step=COARSE_STEP_FACTOR * fine.march_step,
    )


def kept_mesh(stage: Stage) -> TetMesh:
    """The tets that stage 2 is about: occupied, their neighbours, enclosed; no floaters.

    Raises:
        DatasetError: Nothing is occupied.
    """
    mesh, neighbours = stage.mesh, tet_neighbours(stage.mesh.tets)
    occupied = stage.occupied.any(dim=1).cpu().numpy()
    if not occupied.any():
        raise DatasetError(
            "stage 1 found nothing: it had too few --steps, or the object doesn't lie in the "
            "scene box (--scene-radius is half the box's edge)"
        )
    beside = neighbours[occupied]
    occupied[beside[beside >= 0]] = True
    keep = fill_enclosed(occupied, neighbours)
    labels = face_components(neighbours, keep)
    sizes = np.bincount(labels[keep])
    keep[keep] = sizes[labels[keep]] >= SMALLEST_COMPONENT * keep.sum()
    return extract(mesh, keep)[0]


def learning_rate(step: int, step_count: int, highest: float) -> float:
    """Linear warm-up, then a cosine down to FINAL_RATE."""
    warm_up = min(1.0, (step + 1) / WARM_UP_STEPS)
    fall = 0.5 * (1.0 + cos(pi * step / step_count))
    return highest * warm_up * (FINAL_RATE + (1.0 - FINAL_RATE) * fall)


def _fit(stage, bank, has_alpha, options, step_count, title, progress):
    """Optimise for that many steps."""
    step = Step(stage, bank, options.distortion, options.samples_per_step, options.seed)
    step.set_ray_count(RAYS_AT_START)
    task = progress.begin(title, step_count)
    shown = 0
    for number in range(step_count):
        if number % OCCUPANCY_INTERVAL == 0 and number > 0:
            stage.update_occupancy(1.0 if number < OCCUPANCY_WARM_UP else 0.25)
            sample_count = step.sample_count()
            progress.advance(task, number - shown, float(step.error), sample_count)
            shown = number
            ray_count = next_ray_count(step.batch.ray_count, sample_count, options.samples_per_step)
            if ray_count != step.batch.ray_count:
                step.set_ray_count(ray_count)
        white = not has_alpha or number >= (1.0 - WHITE_SHARE) * step_count
        step.run(learning_rate(number, step_count, options.learning_rate), white)
    progress.advance(task, step_count - shown, float(step.error), step.sample_count())


def next_ray_count(ray_count, sample_count, room):
    """As many rays as fill the room for samples without overflowing it.

    It stays as it is while that is nearly so: a new number costs a new CUDA graph.
    """
    filled = sample_count / room
    if 0.8 <= filled <= 1.0:
        return ray_count
    wanted = ray_count * np.clip(FILLED / max(filled, 1e-6), 0.25, 4.0)
    return int(np.clip(wanted, FEWEST_RAYS, MOST_RAYS))


def _looking_batches(bank: RayBank, device, most: int, size=1 << 14):
    """Batches of rays through all training pixels, or through `most` random ones."""
    if bank.pixel_count > most:
        seed = wp.zeros(1, dtype=int, device=device)
        for number in range(-(-most // size)):
            batch = Batch(size, None, device)
            seed.fill_(number)
            bank.draw(seed, batch.drawn)
            yield batch
    else:
        everything = np.arange(bank.pixel_count, dtype=np.int32)
        for first in range(0, bank.pixel_count, size):
            chosen = wp.array(everything[first : first + size], dtype=int, device=device)
            batch = Batch(len(chosen), None, device)
            bank.look_up(chosen, batch.drawn)
            yield batch
