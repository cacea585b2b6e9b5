"""Photographs to a field, in two stages (DeformRF, section 3.4).

Stage 1 trains few levels on the A15 grid of the whole scene box and learns where density
is; the occupied tets, what they enclose and their neighbours are kept.  Stage 2 trains all
levels on the kept tets.  Both minimise the loss of run/loss.py with Adam.  In the first half
of a stage, images with alpha have a random background per ray, then a white one: so empty
space learns to be empty, and the result is best on the background that it is scored on.

A run that leaves stage 1 out is stage 2 on the whole grid in the scene box; its model holds
all of those tets, the empty ones too.
"""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np
import torch
import warp as wp

from ..field import FieldOptions, TetField, below_pixel, level_edges, narrowest_pixel
from ..geometry import (
    TetMesh,
    a15_grid,
    extract,
    face_components,
    fill_enclosed,
    tet_neighbours,
)
from ..render import in_space
from .data import (
    Dataset,
    DatasetError,
    RayBank,
    learns_surroundings,
    object_box,
    world_to_unit_cube,
)
from .run import (
    ADVICE,
    ALONE,
    Checkpoint,
    Diverged,
    History,
    LearntSurroundings,
    Optimization,
    TrainingField,
    TrainingProgress,
    Workers,
    lacks_memory,
    looks,
    on_warp_stream,
    random_surroundings,
    save_checkpoint,
)
from .train_options import TrainOptions

COARSE_LEVELS = 4
COARSE_STEP_FACTOR = 2.0  # Δ of stage 1 over Δ of stage 2
UNSEEN_WEIGHT = 1e-3  # a sub-tet in which no sample weighs as much is hidden
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

    A KeyboardInterrupt or a diverged loss ends the run early; the field then has the weights
    reached so far.  Several workers stop together, within a few steps.

    Args:
        dataset: The training views.
        device: A Warp device.
        name: Of the data, for the model file.
        checkpoint_path: Where the run is written every minute and when it is interrupted.
        resumed: Go on from there; `options` have to be its own.
        on_pause: Called every few steps with the stage's number, the seconds so far and a
            function that exports the field as it stands, for use within the call.  The run's
            clock stops meanwhile; memory that the call takes is counted.
        workers: Who trains together; all make the same call, each with its own device.  All
            get the field, the first writes checkpoints and calls `on_pause`.

    Raises:
        DatasetError: Stage 1 found nothing in the scene box.
        MemoryError: The GPU's memory is too small, in a sentence.
    """
    wp.init()
    if not workers.is_first:
        checkpoint_path = on_pause = None
    try:
        with (
            on_warp_stream(device),
            workers.stopping_together(),
            TrainingProgress(workers.is_first) as progress,
        ):
            run = _Run(
                dataset,
                options,
                device,
                name,
                checkpoint_path,
                resumed,
                on_pause,
                workers,
                progress,
            )
            return run.train()
    except RuntimeError as error:
        if not lacks_memory(error):
            raise
        raise MemoryError(f"the GPU's memory is too small: {ADVICE} ({error})") from error


class _Run:
    """A run: its stages one after another, its clock, its report, and its checkpoints."""

    def __init__(
        self,
        dataset,
        options,
        device,
        name,
        checkpoint_path,
        resumed,
        on_pause,
        workers,
        progress,
    ):
        self.dataset, self.options, self.device = dataset, options, device
        self.checkpoint_path, self.resumed = checkpoint_path, resumed
        self.on_pause, self.workers, self.progress = on_pause, workers, progress
        self.start = self.saved = time.perf_counter()
        self.stage = 0  # 1 or 2 once there is a field
        self.field = self.optimization = self.surroundings = None
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

    def train(self) -> Trained:
        if learns_surroundings(self.options.surroundings, self.dataset):
            start = random_surroundings(self.box, self.options.seed)
            self.surroundings = LearntSurroundings(start, self.device)
        interrupted, diverged = False, None
        try:
            self.bank = RayBank(self.dataset, self.world_to_model, self.device)
            if self.resumed:  # another version's grid may order corners otherwise
                mesh = self.resumed.mesh
            else:
                mesh = boxed(a15_grid(self.options.spacing), self.box, self.options.spacing)
            if self.resumed is None or self.resumed.stage == 1:
                if "coarse-stage" not in self.options.leave_out:
                    mesh = self._train_coarse(mesh)
                self.report["tet_count"] = mesh.tet_count
            self._train_fine(mesh)
        except KeyboardInterrupt:
            interrupted = True
            if self.field is None:
                raise  # there is nothing yet to keep
            self._save()
        except Diverged as error:
            diverged = str(error)
        return self._result(interrupted, diverged)

    def _train_coarse(self, mesh) -> TetMesh:
        """Stage 1; the tets that it keeps."""
        self._train_stage(1, mesh, coarse_options(self.options), self.options.coarse_steps)
        self.field.update_occupancy()
        self._hide_unseen(COARSE_LOOK, COARSE_UNSEEN_WEIGHT)
        self.report["stage_1_seconds"] = self._seconds()
        self.report["stage_1_tet_count"] = mesh.tet_count
        return kept_mesh(self.field)

    def _train_fine(self, mesh):
        """Stage 2."""
        self._train_stage(2, mesh, field_options(self.options), self.options.fine_steps)
        self._hide_unseen(FINE_LOOK, UNSEEN_WEIGHT)

    def _train_stage(self, stage, mesh, options: FieldOptions, step_count):
        self.optimization = None  # the stage before gives its memory back
        field = TrainingField(
            mesh,
            options,
            self.device,
            self.options.seed,
            self.surroundings,
            "subtet-mask" not in self.options.leave_out,
            self.workers,
        )
        if field.device.is_cuda:
            torch.cuda.reset_peak_memory_stats()
        has_alpha = self.dataset.has_alpha
        optimization = Optimization(field, self.bank, self.options, has_alpha, step_count)
        if self.resumed and self.resumed.stage == stage:
            optimization.load_state(self.resumed.fit)
        # Not before: an interrupt keeps the stage before, or the checkpoint as it was.
        self.stage, self.field, self.optimization = stage, field, optimization
        history = History(self.report["history"], stage, step_count, self._seconds)
        optimization.run(self.progress, f"stage {stage}", self._pause, history.note)
        self._note_memory()

    def _hide_unseen(self, look, smallest_weight):
        most = look * self.options.samples_per_step
        self.field.hide_unseen(partial(looks, self.bank, self.field.device, most), smallest_weight)
        self._note_memory()

    def _seconds(self) -> float:
        """Of the run so far, without those of `on_pause`."""
        return time.perf_counter() - self.start

    def _note_memory(self):
        """torch's highest so far in this stage, and what Warp holds throughout."""
        if self.field.device.is_cuda:
            used = torch.cuda.max_memory_allocated()
            used += wp.get_mempool_used_mem_current(self.field.device)
            self.memory[self.stage - 1] = max(self.memory[self.stage - 1], used)

    def _pause(self):
        self._note_memory()
        due = time.perf_counter() - self.saved > CHECKPOINT_SECONDS
        if self.workers.any(due and self.checkpoint_path is not None):
            self._save()
        if self.on_pause:
            wp.synchronize_device(self.field.device)  # what is under way is training
            begin = time.perf_counter()
            self.on_pause(self.stage, begin - self.start, self._export)
            self.start += time.perf_counter() - begin

    def _export(self) -> TetField:
        with self.optimization.averaged() if self.optimization else nullcontext():
            return self.field.export(self.world_to_model, self.report)

    def _save(self):
        if self.optimization is None:
            return
        state = self.optimization.state()  # every worker has a part of it
        if self.checkpoint_path is None:
            return
        report = {
            **self.report,
            "seconds": self._seconds(),
            "peak_memory_bytes": self.memory,
        }
        checkpoint = Checkpoint(
            self.options, self.stage, self.field.mesh, state, self.world_to_model, report
        )
        try:
            save_checkpoint(checkpoint, self.checkpoint_path)
        except OSError as error:  # a full disk, say
            self.progress.say(f"{error}; training goes on without it.")
        self.saved = time.perf_counter()

    def _result(self, interrupted, diverged) -> Trained:
        field, report = self.field, self.report
        report["seconds"] = self._seconds()
        report["interrupted"] = interrupted
        if diverged:
            report["diverged"] = diverged
        report["occupied_share"] = field.occupied_share()
        if field.device.is_cuda:
            report["peak_memory_bytes"] = self.memory
        report["device"] = field.device.name
        report["levels_below_pixel"] = self._levels_below_pixel()
        return Trained(self._export(), report, interrupted, diverged)

    def _levels_below_pixel(self) -> list[int]:
        """Levels that no training image could tell apart."""
        positions = in_space(self.dataset.poses, self.world_to_model)[:, :3, 3]
        focals = np.array([max(lens.focal) for lens in self.dataset.lenses])
        mesh = self.field.mesh
        pixel = narrowest_pixel(positions, focals, mesh.rest_vertices)
        edges = level_edges(mesh, self.field.options.level_count)
        return np.flatnonzero(below_pixel(edges, pixel)).tolist()


def boxed(mesh: TetMesh, box, spacing) -> TetMesh:
    """The tets of a grid that lie in a box or at its border."""
    centers = mesh.rest_vertices[mesh.tets].mean(axis=1)
    inside = ((centers > box[0] - spacing) & (centers < box[1] + spacing)).all(axis=1)
    return mesh if inside.all() else extract(mesh, inside)[0]


def field_options(options: TrainOptions) -> FieldOptions:
    return FieldOptions(
        level_count=options.level_count,
        table_size=2**options.table_size_log2,
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


def kept_mesh(field: TrainingField) -> TetMesh:
    """The tets that stage 2 is about: occupied, their neighbours, enclosed; no floaters.

    Raises:
        DatasetError: Nothing is occupied.
    """
    mesh, neighbours = field.mesh, tet_neighbours(field.mesh.tets)
    occupied = field.occupied.any(dim=1).cpu().numpy()
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
