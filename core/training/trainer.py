"""Train a field on photographs, in two stages (DeformRF, section 3.4).

Stage 1 trains few levels on the A15 grid of the whole scene box, to find where density is.  The
occupied tets, those that they enclose, and their neighbors are kept.  Stage 2 trains all
levels on the kept tets.  Both minimize the loss of run/loss.py with Adam.  Images with alpha are
composited on a random background per ray in the first half of a stage, so that empty space becomes
empty, and on white in the second half, because scores are computed on white.  Stage 2 may begin
several times, because some choices have to be tried (beginnings.py).

A run without stage 1 trains stage 2 on the whole grid in the scene box, and its model contains
all of those tets, the empty ones too.
"""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
import warp as wp

from ..base.device import start_warp
from ..field import FieldOptions, TetField, coarsest
from ..geometry import Plane, TetMesh, a15_grid
from ..render import in_space, rows_of_views
from . import photographs, stages
from .beginnings import (
    DEPTH_COST,
    DEPTH_STEPS,
    STRONG_DECAY,
    TRIAL_STEPS,
    Choice,
    choices_due,
    validation_psnr,
    validation_views,
)
from .data.datasets import Dataset
from .data.scene_box import learns_surroundings, object_box, seeks_object, world_to_unit_cube
from .data.views import focus
from .finding import FoundBox, ground_under, search
from .meant import meant
from .needed_levels import needed_levels
from .run.batch import looks
from .run.checkpoint import Checkpoint, CheckpointError, save_checkpoint
from .run.differentiable import on_warp_stream
from .run.distributed import ALONE, Workers
from .run.memory import ALLOCATION_ERRORS, OutOfMemory, give_memory_back, lacks_memory
from .run.monitoring import Diverged, History, TrainingProgress
from .run.optimization import Optimization
from .run.plates import learned_plates
from .run.surroundings import LearnedSurroundings, random_surroundings
from .run.training_field import TrainingField
from .train_options import TrainOptions
from .trained_tets import boxed, kept_mesh, object_alone, without_spurs

UNSEEN_WEIGHT = 1e-3  # a sub-tet in which no sample weighs as much is hidden
COARSE_UNSEEN_WEIGHT = 2e-2  # after stage 1, whose empty space is still a thin fog
COARSE_LOOK, FINE_LOOK = 4, 16  # rays that look for it, over the samples of a step
CHECKPOINT_SECONDS = 60.0
MOST_POINTS = 200_000  # of surfaces, that tets are kept for


@dataclass(frozen=True)
class Pause:
    """A run between two steps, as `on_pause` of `train` sees it."""

    stage: int  # 1 or 2
    step: int  # the number of the stage's steps that are done
    step_count: int  # of the stage
    seconds: float  # of the run so far
    samples_per_second: float  # of late
    history: list[dict[str, Any]]  # the rows of the run so far, see run/monitoring.py
    export: Callable[[], TetField]  # the field as it stands, for use within the call


@dataclass
class Trained:
    """The result of `train`."""

    field: TetField  # perhaps unfinished
    report: dict[str, Any]  # figures of the run, plain JSON values
    interrupted: bool  # by Ctrl-C
    diverged: str | None = None  # why it ended early, a sentence
    out_of_memory: str | None = None  # a sentence, if what no image shows could not be left out
    resumable: bool = False  # whether `checkpoint_path` holds a checkpoint of this run
    whole: TetField | None = None  # with all that is in the object's box, as photographs show it
    uncut: TetField | None = None  # `field` before what the object touches was cut off, if it was
    left_out: float = 0.0  # of the matter, what was cut off

    @property
    def complete(self) -> bool:
        return not (self.interrupted or self.diverged or self.out_of_memory)


def train(
    dataset: Dataset,
    options: TrainOptions,
    device: str = "cpu",
    name: str = "",
    checkpoint_path: Path | None = None,
    resumed: Checkpoint | None = None,
    on_pause: Callable[[Pause], None] | None = None,
    workers: Workers = ALONE,
) -> Trained:
    """Train a field.

    A KeyboardInterrupt ends the run early, with the weights reached so far, or a loss that diverges
    too often, with the last good ones.  Several workers stop together, within a few steps.

    Args:
        dataset: The training views.
        device: A Warp device.
        name: Name of the data, for the model file.
        checkpoint_path: The checkpoint's file, written every minute and on interruption.
        resumed: Go on from there; `options` have to be its own.
        on_pause: Called every few steps, in the thread of this call.  The run's clock stops
            meanwhile; memory that the call takes is counted.
        workers: Who trains together; all make the same call, each with its own device, and all
            get the field.  The first writes checkpoints and calls `on_pause`.

    Raises:
        DatasetError: Stage 1 found nothing in the scene box.
        MemoryError: Memory is too small, in a sentence that names the checkpoint.  A single
            worker saves one before; several cannot, because each has a share of it and the others
            wait for this worker in the middle of a step: their last checkpoint remains.
    """
    start_warp()
    if not workers.is_first:
        checkpoint_path = on_pause = None
    with (
        on_warp_stream(device),
        workers.stopping_together(),
        TrainingProgress(workers.is_first) as progress,
    ):
        run = _Run(
            dataset, options, device, name, checkpoint_path, resumed, on_pause, workers, progress
        )
        return run.train()


@dataclass
class _Run:
    """A run: its stages one after another, its clock, its report, and its checkpoints."""

    dataset: Dataset  # this and the next seven: see `train`
    options: TrainOptions
    device: str
    name: str
    checkpoint_path: Path | None
    resumed: Checkpoint | None
    on_pause: Callable | None
    workers: Workers
    progress: TrainingProgress

    def __post_init__(self):
        self.start = self.saved = time.perf_counter()
        self.stage = 0  # 1 or 2 once there is a field
        self.field = self.optimization = self.surroundings = self.exposure = self.plates = None
        self.needless_levels = None  # how many of the finest; None until stage 2 is over
        self.memory = [0, 0]  # bytes at most, of each stage
        self.resumable = bool(self.resumed and self.checkpoint_path)
        self.saved_place = None  # stage and step of the last checkpoint that was written
        if self.resumed:
            self.world_to_model = self.resumed.world_to_model
            self.report = dict(self.resumed.report)
            self.report["history"] = list(self.report.get("history", ()))
            self.start -= self.report["seconds"]
            self.memory = list(self.report.pop("peak_memory_bytes", self.memory))
        else:
            self.world_to_model = world_to_unit_cube(
                self.dataset, self.options.aabb, self.options.scene_radius
            )
            lenses = self.dataset.lenses
            self.report = {
                "data": self.name,
                "view_count": self.dataset.view_count,
                "image_size": list(max((lens.width, lens.height) for lens in lenses)),
                "missing_images": len(self.dataset.missing),
                "history": [],
            }
            if self.dataset.sector is not None:
                self.report |= self.dataset.sector.as_report()
        self.report |= {"options": asdict(self.options), "workers": self.workers.count}
        self.found, aabb = FoundBox.of_report(self.report), self.options.aabb
        self.box = self.found.box if self.found else object_box(self.world_to_model, aabb)

    def train(self) -> Trained:
        try:
            return self._train()
        except ALLOCATION_ERRORS as error:
            if not lacks_memory(error):
                raise
            raise self._out_of_memory(error) from error

    def _train(self) -> Trained:
        if not self.resumed and seeks_object(self.dataset, self.options):
            self._find_object()
        if learns_surroundings(self.options.surroundings, self.dataset):
            start = random_surroundings(self.box, self.options.seed)
            self.surroundings = LearnedSurroundings(start, self.device)
        self.exposure = photographs.learned_exposure(
            self.dataset, self.options, self.device, self.report
        )
        torch_device = wp.device_to_torch(wp.get_device(self.device))
        self.plates = learned_plates(self.dataset, torch_device)
        interrupted, diverged, out_of_memory = False, None, None
        try:
            self.bank = photographs.photographed_rays(
                *(self.dataset, self.options, self.world_to_model, self.device),
                self.found and self.found.seen,
                self.plates,
                self.progress.say,
            )
            if self.resumed:  # another version's grid may order corners otherwise
                mesh = self.resumed.mesh
            else:
                mesh = boxed(a15_grid(self.options.spacing), self.box, self.options.spacing)
            if self.resumed is None or self.resumed.stage == 1:
                if "coarse-stage" not in self.options.leave_out:
                    mesh = self._train_coarse(mesh)
                self.report["tet_count"] = mesh.tet_count
            out_of_memory = self._train_fine(mesh)
        except KeyboardInterrupt:
            interrupted = True
            if self.field is None:
                raise  # there is nothing yet to keep
            self._save(ends=True)
        except Diverged as error:
            diverged = str(error)
        return self._result(interrupted, diverged, out_of_memory)

    def _find_object(self):
        """Look where the object is; if that is clear, its upright box is what is trained."""
        seed = self.options.seed
        self.found, place = search(self.dataset, seed, self.device, self.workers, self.progress)
        if self.found:
            self.world_to_model, self.box = place, self.found.box
            self.report |= self.found.as_report()

    def _ground(self) -> Plane | None:
        """What the object that was found stands on, where the field has it now."""
        return self.found and ground_under(self.found, self.field, self.bank, self.workers)

    def _points(self):
        """Points in the box that was found, in model space; None without any."""
        if not self.found or self.dataset.points is None:
            return None
        turn, shift = self.world_to_model[:3, :3], self.world_to_model[:3, 3]
        points = self.dataset.points @ turn.T + shift
        inside = ((points > self.found.box[0]) & (points < self.found.box[1])).all(axis=1)
        return points[inside][:MOST_POINTS]

    def _train_coarse(self, mesh) -> TetMesh:
        """Stage 1; the tets that it keeps."""
        self._train_stage(1, mesh, stages.coarse_options(self.options), self.options.coarse_steps)
        # Stage 2 begins without the optimizer of stage 1, so it could not save one.
        if self.workers.any(self.checkpoint_path is not None):
            self._save()
        self.field.update_occupancy()
        self._hide_unseen(COARSE_LOOK, COARSE_UNSEEN_WEIGHT)
        self.exposure = photographs.needed_exposure(self.exposure, self.report, self.workers)
        self.report["stage_1_seconds"] = self._seconds()
        self.report["stage_1_tet_count"] = mesh.tet_count
        return kept_mesh(self.field, self._ground(), self._points())

    def _train_fine(self, mesh) -> str | None:
        """Stage 2; a sentence if a single worker lacks the memory to find what no image shows."""
        self._train_stage(2, mesh, stages.field_options(self.options), self.options.fine_steps)
        try:
            # With surroundings, or masks that leave pixels open, an alpha of 0 refutes nothing.
            alpha_tells = self.dataset.has_alpha and not self.surroundings and self.plates is None
            self._hide_unseen(FINE_LOOK, UNSEEN_WEIGHT, alpha_tells)
            levels = self.field.options.level_count
            self.needless_levels = levels - needed_levels(self.field, self.bank)
        except ALLOCATION_ERRORS as error:
            if self.workers.count > 1 or not lacks_memory(error):
                raise
            return str(self._out_of_memory(error, "the model keeps what no image shows"))
        return None

    def _begin(self, stage, mesh, options: FieldOptions, step_count, tried=None):
        """The optimization of a stage, with no step done.

        Args:
            tried: A Choice that stage 2 begins with, beside those that the run has taken.
        """
        field = TrainingField(
            mesh,
            options,
            self.device,
            self.options.seed,
            self.surroundings,
            "subtet-mask" not in self.options.leave_out,
            self.workers,
            self.found and self.found.space,
            self.exposure,
            self.plates,
        )
        inputs = self.bank, self.options, self.dataset.has_alpha, step_count
        begun_with = {tried, *(c for c in (DEPTH_COST, STRONG_DECAY) if c.is_taken(self.report))}
        strong = stage == 2 and STRONG_DECAY in begun_with
        # Where nothing is tried, a cost of depth is over: the run is resumed behind its trial.
        cost = self.options.depth_cost if tried and DEPTH_COST in begun_with else 0.0
        rate = stages.FINAL_RATES[stage]
        return Optimization(field, *inputs, rate, cost, DEPTH_STEPS, strong)

    def _train_stage(self, stage, *arguments):
        """Do all steps of a stage; the arguments are those of `_begin`."""
        self.optimization = None  # the stage before gives its memory back
        if wp.get_device(self.device).is_cuda:
            torch.cuda.reset_peak_memory_stats()
        optimization = self._begin(stage, *arguments)
        if self.resumed and self.resumed.stage == stage:
            try:
                optimization.load_state(self.resumed.fit)
            except CheckpointError:
                raise
            except (LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
                if lacks_memory(error):
                    raise
                raise CheckpointError(
                    f"{self.checkpoint_path} does not fit its own options and mesh; train without "
                    f"--resume"
                ) from error
        # Not before: an interrupt keeps the stage before, or the checkpoint as it was.
        self.stage, self.field, self.optimization = stage, optimization.field, optimization
        del optimization  # which the trial may give up
        choices = choices_due(self.optimization, self.dataset, self.report) if stage == 2 else ()
        if choices:
            self._choose_beginning(choices, partial(self._begin, stage, *arguments))
        self._optimize(self.optimization, self.report["history"])
        self.report["returns"] = self.report.get("returns", 0) + self.optimization.returns
        self._note_memory()

    def _optimize(self, optimization, history, until=None, how=""):
        """Do steps of a stage; what is paused for is `optimization`, with its history."""
        note = History(history, self.stage, optimization.step_count, self._seconds).note
        pause = partial(self._pause, optimization, history)
        optimization.run(self.progress, f"stage {self.stage}{how}", pause, note, until)

    def _choose_beginning(self, choices: list[Choice], begin):
        """Begin stage 2 anew with each choice, and keep the best beginning, see beginnings.py.

        Until it is chosen, the best so far is what is saved, and kept after Ctrl-C.

        Args:
            begin: Begins stage 2 with a choice.
        """
        with self.bank.holding_aside(validation_views(self.dataset.view_count)) as pixels:
            if self.optimization.number < TRIAL_STEPS:
                history = self.report["history"]
                self._optimize(self.optimization, history, TRIAL_STEPS, ", first beginning")
            self.optimization.free_batches()
            best = None  # the PSNR of the beginning that is kept, once it is known
            for choice in choices:
                best = self._try(choice, begin, pixels, best)
                give_memory_back(self.field.device)
        # Outside, because CUDA graphs hold the decay, which depends on how many pixels are drawn.
        self.optimization.go_on()

    def _try(self, choice: Choice, begin, pixels, best: float | None) -> float | None:
        """Begin stage 2 with a choice; keep that if it shows the validation views better.

        Args:
            best: PSNR of the beginning so far; None: it is computed.

        Returns:
            PSNR of the beginning that is kept; None if it is unknown.
        """
        first, history = self.optimization, self.report["history"]
        rows = [row for row in history if row["stage"] != self.stage]
        try:
            if best is None:
                best = validation_psnr(first, pixels)
            second = begin(choice)
            self._optimize(second, rows, TRIAL_STEPS, f", with {choice.name}")
            second.free_batches()
            tried = validation_psnr(second, pixels)
        except (Diverged, *ALLOCATION_ERRORS) as error:
            wp.synchronize_device(self.field.device)  # marches ahead write to what is freed next
            if not isinstance(error, Diverged) and not lacks_memory(error):
                raise
            reason = str(error) or "no memory"
            self.progress.say(f"Going on without {choice.name}: {reason}.")
            return best
        if second.samples_per_step < first.samples_per_step:
            return best  # both fields at once were too much memory, so they are not comparable
        gain = tried - best
        if gain > 0.0:
            self.field, self.optimization = second.field, second
            history[:] = rows
        self.report[choice.key] = gain
        self.saved_place = None  # as many steps, but other weights, or another report
        kept = "goes on with it" if gain > 0.0 else "goes on without"
        name = choice.name.capitalize()
        self.progress.say(f"{name} gives {gain:+.2f} dB on validation views: {kept}.")
        return max(best, tried)

    def _hide_unseen(self, look, smallest_weight, with_refuted=False):
        most = look * self.options.samples_per_step
        look = partial(looks, self.bank, self.field.device, most)
        self.field.hide_unseen(look, smallest_weight, with_refuted)
        self._note_memory()

    def _seconds(self) -> float:
        """Seconds of the run so far, without those spent in `on_pause`."""
        return time.perf_counter() - self.start

    def _note_memory(self):
        """torch's highest so far in this stage, and what Warp holds throughout."""
        if self.field.device.is_cuda:
            used = torch.cuda.max_memory_allocated()
            used += wp.get_mempool_used_mem_current(self.field.device)
            self.memory[self.stage - 1] = max(self.memory[self.stage - 1], used)

    def _pause(self, optimization, history):
        self._note_memory()
        due = time.perf_counter() - self.saved > CHECKPOINT_SECONDS
        if self.workers.any(due and self.checkpoint_path is not None):
            self._save()
        if self.on_pause:
            wp.synchronize_device(self.field.device)  # what is under way is training
            begin = time.perf_counter()
            pause = Pause(
                self.stage,
                optimization.number,
                optimization.step_count,
                begin - self.start,
                self.progress.rate,
                list(history),
                partial(self._export, optimization),
            )
            try:
                self.on_pause(pause)
            finally:
                self.start += time.perf_counter() - begin

    def _export(self, optimization) -> TetField:
        field = optimization.field if optimization else self.field
        with optimization.averaged() if optimization else nullcontext():
            poses = in_space(self.dataset.poses, self.world_to_model)
            meta = {**self.report, "views": rows_of_views(poses, self.dataset.lenses)}
            return field.export(self.world_to_model, meta)

    def _out_of_memory(self, error, consequence="") -> OutOfMemory:
        """Save a checkpoint, if one worker trains and has done a step; return the sentence."""
        if self.workers.count == 1 and self.optimization and self.optimization.number:
            give_memory_back(self.field.device)
            try:
                self._save(ends=True)
            except ALLOCATION_ERRORS as second:
                if not lacks_memory(second):
                    raise
        resume = f"with more memory, --resume continues from {self.checkpoint_path}"
        sentences = (str(OutOfMemory.of(error)), consequence, self.resumable and resume)
        return OutOfMemory("; ".join(filter(None, sentences)))

    def _save(self, ends=False):
        """Write a checkpoint; say so if that fails.  `ends`: whether the run ends here."""
        if self.optimization is None:
            return
        state = self.optimization.state()  # every worker has a share of it
        place = self.stage, self.optimization.number
        if self.checkpoint_path is None or self.saved_place == place:
            return
        report = {**self.report, "seconds": self._seconds(), "peak_memory_bytes": self.memory}
        checkpoint = Checkpoint(
            self.options, self.stage, self.field.mesh, state, self.world_to_model, report
        )
        try:
            save_checkpoint(checkpoint, self.checkpoint_path)
            self.resumable, self.saved_place = True, place
        except OSError as error:  # a full disk, say
            rest = "training goes on without it"
            if ends and self.resumable:
                rest = "the checkpoint before it is kept"
            elif ends:
                rest = "the run cannot be continued"
            self.progress.say(f"{error}; {rest}.")
        self.saved = time.perf_counter()

    def _result(self, interrupted, diverged, out_of_memory) -> Trained:
        field, report = self.field, self.report
        report |= {"seconds": self._seconds(), "interrupted": interrupted}
        if diverged:
            report["diverged"] = diverged
        report["occupied_share"] = float(field.occupied.float().mean())
        if field.device.is_cuda:
            report["peak_memory_bytes"] = self.memory
        report["device"] = field.device.name
        if self.needless_levels is not None:
            report["levels_left_out"] = self.needless_levels
        if self.exposure is not None:
            report["exposure_spread"] = self.exposure.spread()
        whole = self._export(self.optimization)
        alone = whole = coarsest(whole, whole.options.level_count - (self.needless_levels or 0))
        if self.found:  # without what it stands on
            ground = None if self.dataset.has_alpha else self._ground()
            alone = object_alone(whole, field.densities().cpu().numpy(), self.found.box, ground)
        elif self.stage == 2 and "coarse-stage" not in self.options.leave_out:
            alone = without_spurs(whole)
        trained = Trained(
            alone, report, interrupted, diverged, out_of_memory, self.resumable, whole
        )
        if trained.complete and self.surroundings and self.workers.is_first:
            try:
                with self.workers.working_alone():
                    self._isolate(trained)
            except (KeyboardInterrupt, ValueError, *ALLOCATION_ERRORS) as error:
                reason = str(error) or type(error).__name__
                self.progress.say(f"The model keeps all that the object touches: {reason}.")
        return trained

    def _isolate(self, trained: Trained):
        """Cut off what the object stands and leans on, where that is sure."""
        skipped = {"isolation", "coarse-stage"} & {*self.options.leave_out}
        if skipped or self.dataset.has_alpha:  # alpha has told what the object is
            return
        self.progress.say("Looking at what the photographs mean.")
        poses = in_space(self.dataset.poses, self.world_to_model)
        place = self.box.mean(axis=0) if self.found else focus(poses)
        if found := meant(trained.field, poses, place):
            trained.uncut, trained.field = trained.field, found.field
            trained.left_out = found.share
