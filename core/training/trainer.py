"""Photographs to a field, in two stages (DeformRF, section 3.4).

Stage 1 trains few levels on the A15 grid of the whole scene box and learns where density
is; the occupied tets, what they enclose and their neighbours are kept.  Stage 2 trains all
levels on the kept tets.  Both minimise

    mean squared error of the composited color + distortion weight · distortion

with Adam.  Images with alpha are composited on a random background per ray in the first half
of a stage, then on white: so that empty space learns to be empty, and the result is at its
best on the background it is scored on.  Where the surroundings are learnt too, rays cost
something else besides their error; see surroundings.surrounded_cost.

A run that leaves stage 1 out is stage 2 on the whole grid in the scene box; its model holds
all of those tets, the empty ones too.
"""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace

import numpy as np
import torch
import warp as wp

from ..field import FieldOptions, TetField, below_pixel, fill_enclosed, level_edges, narrowest_pixel
from ..geometry import TetMesh, a15_grid, extract, face_components, tet_neighbours
from ..render import in_space
from .data import Dataset, DatasetError, RayBank, has_white_border, object_box, world_to_unit_cube
from .options import TrainOptions
from .run import (
    ALONE,
    Batch,
    Checkpoint,
    Diverged,
    Fit,
    History,
    LearntSurroundings,
    Stage,
    TrainingProgress,
    Workers,
    on_warp_stream,
    random_surroundings,
    save_checkpoint,
)

COARSE_LEVELS = 4
COARSE_STEP_FACTOR = 2.0  # Δ of stage 1 over Δ of stage 2
UNSEEN_WEIGHT = 1e-3  # a sub-tet that never contributes as much is hidden
COARSE_UNSEEN_WEIGHT = 2e-2  # after stage 1, whose empty space is still a thin fog
COARSE_LOOK, FINE_LOOK = 4, 16  # rays that look for it, over the samples of a step
SMALLEST_COMPONENT = 0.005  # of the occupied tets; smaller ones are floaters
CHECKPOINT_SECONDS = 60.0


@dataclass
class Trained:
    """What `train` returns.

    Attributes:
        field: As far as it came.
        report: What happened, plain JSON values.
        interrupted: Ctrl-C ended it early.
        diverged: Why it ended early, a sentence, or None.
    """

    field: TetField
    report: dict
    interrupted: bool
    diverged: str | None = None

    @property
    def complete(self) -> bool:
        return not self.interrupted and self.diverged is None


def train(
    dataset: Dataset,
    options: TrainOptions,
    device="cpu",
    name="",
    checkpoint_path=None,
    resumed: Checkpoint | None = None,
    on_pause: Callable[[int, float, Callable[[], TetField]], None] | None = None,
    workers: Workers = ALONE,
) -> Trained:
    """Train a field.

    Args:
        dataset: The training views.
        device: A Warp device.
        name: Of the data, for the model file.
        checkpoint_path: Where the run is written every minute and when it is interrupted.
        resumed: Go on from there; `options` have to be its own.
        on_pause: Called every few steps with the stage's number, the seconds so far and a
            function that exports the field as it stands, for use within the call.  Its own
            time isn't counted; the memory it takes is.
        workers: Who trains together; all make the same call, each with its own device.  All
            get the field, the first writes checkpoints and calls `on_pause`.

    A KeyboardInterrupt or a loss that is lost ends the run early; the field is then what
    there is.  Several workers stop together, within a few steps.
    """
    wp.init()
    if not workers.is_first:
        checkpoint_path = on_pause = None
    run = _Run(dataset, options, device, name, checkpoint_path, resumed, on_pause, workers)
    with (
        on_warp_stream(device),
        workers.stopping_together(),
        TrainingProgress(workers.is_first) as progress,
    ):
        return run.train(progress)


class _Run:
    """The two stages, and where between them a run is."""

    def __init__(self, dataset, options, device, name, checkpoint_path, resumed, on_pause, workers):
        self.dataset, self.options, self.device = dataset, options, device
        self.checkpoint_path, self.resumed = checkpoint_path, resumed
        self.on_pause, self.workers = on_pause, workers
        self.start = self.saved = time.perf_counter()
        self.stage = self.fit = None
        self.surroundings = None
        self.memory = [0, 0]  # bytes at most, of each stage
        if resumed:
            self.world_to_model, self.report = resumed.world_to_model, dict(resumed.report)
            self.report["history"] = list(self.report.get("history", ()))
            self.start -= self.report["seconds"]
            self.memory = list(self.report.pop("peak_memory_bytes", self.memory))
        else:
            self.world_to_model = world_to_unit_cube(dataset, options.aabb, options.scene_radius)
            self.report = {
                "data": name,
                "view_count": dataset.view_count,
                "image_size": list(max((lens.width, lens.height) for lens in dataset.lenses)),
                "missing_images": len(dataset.missing),
                "options": asdict(options),
                "history": [],
            }
        self.report["workers"] = workers.count
        self.box = object_box(self.world_to_model, options.aabb)

    def train(self, progress) -> Trained:
        if learns_surroundings(self.dataset, self.options):
            start = random_surroundings(self.box, self.options.seed)
            self.surroundings = LearntSurroundings(start, self.device)
        interrupted, diverged = False, None
        try:
            bank = RayBank(self.dataset, self.world_to_model, self.device)
            if self.resumed:  # another version's grid may order corners otherwise
                mesh = self.resumed.mesh
            else:
                mesh = boxed(a15_grid(self.options.spacing), self.box, self.options.spacing)
            if self.resumed is None or self.resumed.stage == 1:
                if "coarse-stage" not in self.options.leave_out:
                    self._coarse(mesh, bank, progress)
                    mesh = kept_mesh(self.stage)
                    self.report["stage_1_tet_count"] = self.stage.mesh.tet_count
                self.report["tet_count"] = mesh.tet_count
            self._fine(mesh, bank, progress)
        except KeyboardInterrupt:
            interrupted = True
            if self.stage is None:
                raise  # there is nothing yet to keep
            self._save()
        except Diverged as error:
            diverged = str(error)
        return self._result(interrupted, diverged)

    def _coarse(self, mesh, bank, progress):
        self._fit(1, mesh, coarse_options(self.options), self.options.coarse_steps, bank, progress)
        self.stage.update_occupancy()
        looks = _looking_batches(bank, self.device, COARSE_LOOK * self.options.samples_per_step)
        self.stage.hide_unseen(looks, COARSE_UNSEEN_WEIGHT)
        self._note_memory()
        self.report["stage_1_seconds"] = self._seconds()

    def _fine(self, mesh, bank, progress):
        self._fit(2, mesh, field_options(self.options), self.options.fine_steps, bank, progress)
        looks = _looking_batches(bank, self.device, FINE_LOOK * self.options.samples_per_step)
        self.stage.hide_unseen(looks, UNSEEN_WEIGHT)
        self._note_memory()

    def _fit(self, number, mesh, field_options_, step_count, bank, progress):
        self.fit = None  # the stage before gives its memory back
        seed = self.options.seed
        subtet_mask = "subtet-mask" not in self.options.leave_out
        stage = Stage(
            *(mesh, field_options_, self.device, seed, self.surroundings, subtet_mask),
            workers=self.workers,
        )
        if stage.device.is_cuda:
            torch.cuda.reset_peak_memory_stats()
        fit = Fit(stage, bank, self.options, self.dataset.has_alpha, step_count)
        if self.resumed and self.resumed.stage == number:
            fit.load_state(self.resumed.fit)
        # Not before: who interrupts has the stage before it, or the checkpoint as it was.
        self.stage, self.stage_number, self.fit = stage, number, fit
        history = History(self.report["history"], number, step_count, self._seconds)
        fit.run(progress, f"stage {number}", self._pause, history.note)
        self._note_memory()

    def _seconds(self) -> float:
        """Of the run so far, without those of `on_pause`."""
        return time.perf_counter() - self.start

    def _note_memory(self):
        """torch's highest so far in this stage, and what Warp holds: it holds it throughout."""
        if self.stage.device.is_cuda:
            used = torch.cuda.max_memory_allocated()
            used += wp.get_mempool_used_mem_current(self.stage.device)
            number = self.stage_number - 1
            self.memory[number] = max(self.memory[number], used)

    def _pause(self):
        self._note_memory()
        if time.perf_counter() - self.saved > CHECKPOINT_SECONDS:
            self._save()
        if self.on_pause:
            wp.synchronize_device(self.stage.device)  # what is under way is training
            begin = time.perf_counter()
            self.on_pause(self.stage_number, begin - self.start, self._export)
            self.start += time.perf_counter() - begin

    def _export(self) -> TetField:
        with self.fit.averaged() if self.fit else nullcontext():
            return self.stage.export(self.world_to_model, self.report)

    def _save(self):
        if self.checkpoint_path is None or self.fit is None:
            return
        report = {
            **self.report,
            "seconds": self._seconds(),
            "peak_memory_bytes": self.memory,
        }
        save_checkpoint(
            Checkpoint(
                *(self.options, self.stage_number, self.stage.mesh, self.fit.state()),
                *(self.world_to_model, report),
            ),
            self.checkpoint_path,
        )
        self.saved = time.perf_counter()

    def _levels_below_pixel(self) -> list[int]:
        """Levels that are finer than a pixel of every training image."""
        positions = in_space(self.dataset.poses, self.world_to_model)[:, :3, 3]
        focals = np.array([max(lens.focal) for lens in self.dataset.lenses])
        mesh = self.stage.mesh
        pixel = narrowest_pixel(positions, focals, mesh.rest_vertices)
        edges = level_edges(mesh, self.stage.options.level_count)
        return np.flatnonzero(below_pixel(edges, pixel)).tolist()

    def _result(self, interrupted, diverged) -> Trained:
        stage, report = self.stage, self.report
        report["seconds"] = self._seconds()
        report["interrupted"] = interrupted
        if diverged:
            report["diverged"] = diverged
        report["occupied_share"] = stage.occupied_share()
        if stage.device.is_cuda:
            report["peak_memory_bytes"] = self.memory
        report["device"] = stage.device.name
        report["levels_below_pixel"] = self._levels_below_pixel()
        return Trained(self._export(), report, interrupted, diverged)


def learns_surroundings(dataset: Dataset, options: TrainOptions) -> bool:
    """Whether what is around the object is learnt; see TrainOptions.surroundings."""
    if options.surroundings == "auto":
        return not dataset.has_alpha and not has_white_border(dataset)
    return options.surroundings == "learnt"


def boxed(mesh: TetMesh, box, spacing) -> TetMesh:
    """The tets of a grid that lie in a box or at its border."""
    centers = mesh.rest_vertices[mesh.tets].mean(axis=1)
    inside = ((centers > box[0] - spacing) & (centers < box[1] + spacing)).all(axis=1)
    return mesh if inside.all() else extract(mesh, inside)[0]


def field_options(options: TrainOptions) -> FieldOptions:
    return FieldOptions(
        level_count=options.level_count,
        table_size=2**options.table_size_log2,
        density_hidden=(64,) * options.density_layers,
        march_step=options.march_step,
        view_dependence=options.view_dependence,
        dense_levels="dense-levels" not in options.leave_out,
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
    keep, beside = occupied.copy(), neighbours[occupied]
    keep[beside[beside >= 0]] = True
    keep = fill_enclosed(keep, neighbours)
    labels = face_components(neighbours, keep)
    sizes = np.bincount(labels[occupied])  # neighbours would make six times as much of a speck
    keep[keep] = sizes[labels[keep]] >= SMALLEST_COMPONENT * occupied.sum()
    return extract(mesh, keep)[0]


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
