"""What stage 2 is tried with: when, what is compared, and which beginning goes on."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
import torch

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.render import Camera, Renderer, RenderOptions, in_space
from deformrf.core.training import (
    beginnings,
    load_checkpoint,
    preset,
    trainer,
    white_composite,
    world_to_unit_cube,
)
from deformrf.core.training.beginnings import (
    DEPTH_COST,
    STRONG_DECAY,
    choices_due,
    validation_psnr,
    validation_views,
)
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.metrics import psnr
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.distributed import Workers
from deformrf.core.training.run.optimization import PAUSE_INTERVAL, Optimization
from deformrf.core.training.run.training_field import TrainingField

END, STEPS = 32, 96  # of a trial and of stage 2
TRIED = preset(
    "tiny",
    depth_cost=0.05,
    strong_decay=8.0,
    spacing=0.1,
    march_step=0.02,
    table_size_log2=12,
    coarse_steps=40,
    fine_steps=STEPS,
    samples_per_step=2**11,
    level_count=3,
)


@pytest.fixture
def short_trials(monkeypatch):
    """Trials of 32 of 96 steps."""
    monkeypatch.setattr(beginnings, "FEWEST_STEPS", STEPS)
    for module in beginnings, trainer:
        monkeypatch.setattr(module, "TRIAL_STEPS", END)
    monkeypatch.setattr(trainer, "DEPTH_STEPS", 20)


@pytest.fixture
def optimization(ball_data, device):
    """A stage of 15,000 steps, of which some are done."""
    views = ball_data[0]
    bank = RayBank(views, world_to_unit_cube(views, radius=1.5), device)
    options = FieldOptions(2, 2**8, march_step=0.05, deferred=True)
    field = TrainingField(a15_grid(0.25), options, device)
    with on_warp_stream(device):
        stage = Optimization(field, bank, TRIED, views.has_alpha, 15_000, 1.0, 0.05, 20)
        for _ in range(16):
            stage.step(0.02, white=True)
        stage._average_weights()
        for _ in range(16):
            stage.step(0.02, white=True)
        yield stage


def test_trials_end_at_a_pause_behind_the_cost():
    assert beginnings.TRIAL_STEPS % PAUSE_INTERVAL == 0
    assert beginnings.DEPTH_STEPS < beginnings.TRIAL_STEPS < beginnings.FEWEST_STEPS
    presets = {name: preset(name) for name in ("default", "small", "fast", "tiny")}
    for weight in "depth_cost", "strong_decay":
        tried = [name for name, given in presets.items() if getattr(given, weight)]
        assert tried == ["default", "small"]
    assert min(presets[n].fine_steps for n in ("default", "small")) >= beginnings.FEWEST_STEPS


def test_there_is_no_trial_where_it_could_not_tell(optimization, ball_data, monkeypatch):
    data = ball_data[0]
    assert choices_due(optimization, data, {}) == [DEPTH_COST, STRONG_DECAY]
    opaque = data.pixels.copy()
    opaque[:, :3] //= 2  # no white border
    opaque[:, 3] = 255
    for other in (
        replace(data, masked=True),
        replace(data, pixels=opaque),
    ):
        assert not choices_due(optimization, other, {})
    for changes, due in (
        ({"depth_cost": 0.0}, [STRONG_DECAY]),
        ({"strong_decay": 0.0}, [DEPTH_COST]),
        ({"leave_out": ("depth-cost",)}, [STRONG_DECAY]),
        ({"leave_out": ("strong-decay",)}, [DEPTH_COST]),
        ({"leave_out": ("table-decay",)}, [DEPTH_COST]),
    ):
        optimization.options = replace(TRIED, **changes)
        assert choices_due(optimization, data, {}) == due
    optimization.options = TRIED
    assert choices_due(optimization, data, {"depth_gain": -1.0}) == [STRONG_DECAY]
    for name, value in (
        ("step_count", 14_999),
        ("number", beginnings.TRIAL_STEPS + 1),  # of a run that was resumed
        ("workers", Workers(0, 2)),
    ):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(optimization, name, value)
            assert not choices_due(optimization, data, {})
    monkeypatch.setattr(beginnings, "FEWEST_VIEWS", 21)
    assert not choices_due(optimization, data, {})


def test_validation_views_are_scored_as_images_are(optimization, ball_data):
    """On white, by the averaged weights; the raw ones are lent and given back."""
    views, field = list(validation_views(ball_data[0].view_count)), optimization.field
    raw = [p.detach().clone() for p in field.parameters()]
    with optimization.bank.holding_aside(views) as pixels:
        told = validation_psnr(optimization, pixels)
        assert told == validation_psnr(optimization, pixels)
        assert all((a == b).all() for a, b in zip(raw, field.parameters(), strict=True))
        optimization._average = None
        assert abs(validation_psnr(optimization, pixels) - told) > 0.2
    field.set_weights(raw)


def test_the_score_is_that_of_the_renderer(optimization, ball_data):
    optimization._average = None
    views = list(validation_views(ball_data[0].view_count))
    with optimization.bank.holding_aside(views) as pixels:
        told = validation_psnr(optimization, pixels)
    model = optimization.field.export(world_to_unit_cube(ball_data[0], radius=1.5), {})
    renderer, options = Renderer(model), RenderOptions(background=(1.0, 1.0, 1.0))
    poses, drawn, true = in_space(ball_data[0].poses, model.world_to_model), [], []
    for view in views:
        camera = Camera(poses[view], ball_data[0].lenses[view])
        drawn.append(renderer.render(camera, options).color_array()[..., :3] / 255.0)
        true.append(white_composite(ball_data[0].image(view)))
    assert told == pytest.approx(psnr(np.array(drawn), np.array(true)), abs=0.1)


def test_some_of_many_pixels_are_compared(optimization, monkeypatch):
    with optimization.bank.holding_aside(range(16)) as pixels:
        whole = validation_psnr(optimization, pixels)
        monkeypatch.setattr(beginnings, "MOST_PIXELS", len(pixels) // 2)
        half = validation_psnr(optimization, pixels)
    assert half != whole and abs(half - whole) < 1.0


def gains(monkeypatch, depth, decay, resumed=None):
    """Scores such that the choices gain as much.

    Args:
        resumed: Reports of runs that are resumed: these have no cost of depth any more.
    """

    def score(run, _):
        had_cost = any(report.get("depth_gain", 0.0) > 0.0 for report in resumed or ())
        return depth * (run.depth_cost > 0.0 or had_cost) + decay * run.strong_decay

    monkeypatch.setattr(trainer, "validation_psnr", score)


@pytest.mark.parametrize(("depth", "decay"), [(1.5, 0.5), (1.5, -0.5), (-1.5, 0.5), (-1.5, -0.5)])
def test_the_run_goes_on_from_the_best_beginning(
    ball_data, monkeypatch, capsys, short_trials, depth, decay
):
    """Until then validation views teach nothing; what is given up is freed."""
    begun, early, late, freed, shown = [], set(), set(), [], []
    beginning, march, decays = Optimization.__init__, Optimization._march, {}

    def begin(self, *arguments):
        beginning(self, *arguments)
        begun.append((self.depth_cost > 0.0, self.strong_decay))
        number = len(begun)
        weakref.finalize(self, lambda: freed.append((number, len(late) > 0)))

    def drawn(self, batch):
        march(self, batch)
        if self.step_count == STEPS:
            (early if self.number < END else late).update(batch.views.tolist())
            decays[self.number] = self.table_decay

    monkeypatch.setattr(Optimization, "__init__", begin)
    monkeypatch.setattr(Optimization, "_march", drawn)
    gains(monkeypatch, depth, decay)

    def look(pause):
        if pause.stage == 2:
            last = pause.history[-1]
            assert (last["stage"], last["step"]) == (2, pause.step)
            shown.append(pause.step)

    run = trainer.train(ball_data[0], TRIED, "cpu", "ball", on_pause=look)
    assert run.complete
    assert (run.report["depth_gain"], run.report["decay_gain"]) == (depth, decay)
    # Stage 1, and three beginnings; the last is tried on top of the better one of the others.
    assert begun == [(False, False), (False, False), (True, False), (depth > 0.0, True)]
    assert shown == [16, 16, 16, *range(48, STEPS, 16)]
    steps = [row["step"] for row in run.report["history"] if row["stage"] == 2]
    assert steps == sorted(set(steps)) and steps[-1] == STEPS
    weight = TRIED.strong_decay if decay > 0.0 else TRIED.table_decay
    assert decays[STEPS - 1] == pytest.approx(weight / len(ball_data[0].pixels))
    said = " ".join(capsys.readouterr().out.split())
    for name, gain in ("A cost of depth", depth), ("Strong decay", decay):
        choice = "goes on with it" if gain > 0.0 else "goes on without"
        assert f"{name} gives {gain:+.2f} dB on validation views: {choice}." in said
    aside = set(validation_views(ball_data[0].view_count))
    assert early == set(range(20)) - aside and late == set(range(20))
    kept = 4 if decay > 0.0 else 3 if depth > 0.0 else 2
    gone = [number for number, is_late in freed if not is_late]
    assert sorted(gone) == [number for number in (1, 2, 3, 4) if number != kept]


def interrupted_at(monkeypatch, ball_data, path, step_count):
    """The checkpoint of a run that Ctrl-C ends after so many steps of stage 2."""
    step, done = Optimization.step, []

    def interrupted(self, *arguments):
        if self.step_count == STEPS:
            if len(done) == step_count:
                raise KeyboardInterrupt
            done.append(self)
        step(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Optimization, "step", interrupted)
        patch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)  # at each pause, in trials as well
        half = trainer.train(ball_data[0], TRIED, "cpu", "ball", path)
    assert half.interrupted and half.resumable
    return load_checkpoint(path)


@pytest.mark.parametrize(
    ("depth", "decay", "ends"),
    [
        (1.5, -0.5, ((24, 24), (2 * END + 8, END), (3 * END, END))),
        (-1.5, 0.5, ((END + 8, END), (2 * END + 8, END), (3 * END + 20, END + 20))),
    ],
)
def test_a_run_that_is_interrupted_ends_where_another_does(
    ball_data, monkeypatch, tmp_path, short_trials, depth, decay, ends
):
    """In each beginning, right after the trials, and later; steps of what is tried are lost."""
    reports = []
    gains(monkeypatch, depth, decay, reports)
    whole, path = trainer.train(ball_data[0], TRIED, "cpu", "ball"), tmp_path / "ball.checkpoint"
    for steps, number in ends:
        reports.clear()
        resumed = interrupted_at(monkeypatch, ball_data, path, steps)
        reports.append(resumed.report)
        assert resumed.fit["step"]["number"] == number
        assert ("depth_gain" in resumed.report) == (steps >= 2 * END)
        assert ("decay_gain" in resumed.report) == (steps >= 3 * END)
        again = trainer.train(ball_data[0], TRIED, "cpu", "ball", path, resumed)
        assert (again.report["depth_gain"], again.report["decay_gain"]) == (depth, decay)
        np.testing.assert_array_equal(again.field.table, whole.field.table)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (trainer.Diverged("the loss became nan"), "the loss became nan"),
        (torch.OutOfMemoryError("CUDA out of memory"), "the GPU's memory is too small"),
    ],
)
def test_a_beginning_that_is_lost_changes_nothing(
    ball_data, monkeypatch, capsys, short_trials, error, said
):
    with monkeypatch.context() as patch:
        gains(patch, -1.0, -1.0)
        without = trainer.train(ball_data[0], TRIED, "cpu", "ball")
    step = Optimization.step

    def lost(self, *arguments):
        step(self, *arguments)
        if self.depth_cost or self.strong_decay:
            raise error

    monkeypatch.setattr(Optimization, "step", lost)
    capsys.readouterr()
    run = trainer.train(ball_data[0], TRIED, "cpu", "ball")
    assert run.complete and not {"depth_gain", "decay_gain"} & {*run.report}
    np.testing.assert_array_equal(run.field.table, without.field.table)
    told = " ".join(capsys.readouterr().out.split())
    assert f"Going on without a cost of depth: {said}" in told
    assert f"Going on without strong decay: {said}" in told


def test_beginnings_that_memory_made_unequal_are_not_compared(ball_data, monkeypatch, short_trials):
    step, failed = Optimization.step, []

    def tight(self, *arguments):
        if self.depth_cost and not failed:
            failed.append(self.number)
            raise torch.OutOfMemoryError("CUDA out of memory")
        step(self, *arguments)

    monkeypatch.setattr("deformrf.core.training.run.optimization.SMALLEST_SPACE", 2**8)
    monkeypatch.setattr(Optimization, "step", tight)
    gains(monkeypatch, 1.0, -1.0)
    run = trainer.train(ball_data[0], TRIED, "cpu", "ball")
    assert failed and run.complete and "depth_gain" not in run.report
    assert run.report["decay_gain"] == -1.0
