"""The trial of a cost of depth: when it is made, what it compares, and what goes on after it."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.render import Camera, Renderer, RenderOptions, in_space
from deformrf.core.training import (
    load_checkpoint,
    preset,
    trainer,
    white_composite,
    world_to_unit_cube,
)
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.depth_trial import held_psnr, trial_end, views_aside
from deformrf.core.training.metrics import psnr
from deformrf.core.training.run.differentiable import on_warp_stream
from deformrf.core.training.run.distributed import Workers
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import TrainingField

TRIED = preset(
    "tiny",
    depth_cost=0.05,
    spacing=0.1,
    march_step=0.02,
    table_size_log2=12,
    coarse_steps=40,
    fine_steps=160,
    samples_per_step=2**11,
    level_count=3,
)
END = 32  # of a trial of 160 steps


@pytest.fixture
def optimization(ball_data, device):
    """A stage of 160 steps, of which 16 are done."""
    views = ball_data[0]
    bank = RayBank(views, world_to_unit_cube(views, radius=1.5), device)
    options = FieldOptions(2, 2**8, march_step=0.05, deferred=True)
    field = TrainingField(a15_grid(0.25), options, device)
    with on_warp_stream(device):
        stage = Optimization(field, bank, TRIED, views.has_alpha, 160, 1.0, 0.05, 20)
        for number in range(16):
            stage.number = number
            stage.step(0.02, white=True)
        stage._average_weights()
        yield stage


def test_a_trial_ends_at_a_pause_after_at_most_3000_steps(optimization):
    assert trial_end(optimization, 16) == END
    optimization.number = END + 1  # of a run that was resumed
    assert trial_end(optimization, 16) == 0
    optimization.step_count = 10**6
    assert trial_end(optimization, 16) == 3000 - 3000 % 16


def test_there_is_no_trial_where_it_could_not_tell(optimization):
    assert trial_end(optimization, 15) == 0
    for changes in ({"depth_cost": 0.0}, {"leave_out": ("depth-cost",)}):
        optimization.options = replace(TRIED, **changes)
        assert trial_end(optimization, 16) == 0
    optimization.options = TRIED
    optimization.field.workers = Workers(0, 2)
    assert trial_end(optimization, 16) == 0
    optimization.field.workers = Workers()
    for part in "surroundings", "exposure", "plates":
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(optimization.field, part, object())
            assert trial_end(optimization, 16) == 0
    assert trial_end(optimization, 16) == END
    for name in "tiny", "fast":
        assert preset(name).depth_cost == 0.0


def test_what_is_held_aside_is_scored_as_an_image_is(optimization, ball_data):
    """On white, by the averaged weights; the raw ones are lent and given back."""
    views, field = list(views_aside(ball_data[0].view_count)), optimization.field
    raw = [p.detach().clone() for p in field.parameters()]
    with optimization.bank.holding_aside(views) as pixels:
        told = held_psnr(optimization, pixels)
        assert told == held_psnr(optimization, pixels)
    assert all((a == b).all() for a, b in zip(raw, field.parameters(), strict=True))
    with optimization.averaged():
        model = field.export(world_to_unit_cube(ball_data[0], radius=1.5), {})
    renderer, options = Renderer(model), RenderOptions(background=(1.0, 1.0, 1.0))
    poses, drawn, true = in_space(ball_data[0].poses, model.world_to_model), [], []
    for view in views:
        camera = Camera(poses[view], ball_data[0].lenses[view])
        drawn.append(renderer.render(camera, options).color_array()[..., :3] / 255.0)
        true.append(white_composite(ball_data[0].image(view)))
    assert told == pytest.approx(psnr(np.array(drawn), np.array(true)), abs=0.1)
    assert 8.0 < told < 40.0


@pytest.mark.parametrize("gain", [1.5, -1.5])
def test_the_run_goes_on_from_the_better_beginning(ball_data, monkeypatch, capsys, gain):
    """Until then the views that tell teach nothing, afterwards they do."""
    begun, early, late = [], set(), set()
    beginning, draw = Optimization.__init__, RayBank.draw

    def begin(self, *arguments):
        beginning(self, *arguments)
        begun.append(self)

    def drawn(self, seed, batch, *others, **named):
        draw(self, seed, batch, *others, **named)
        done = sum(stage.number for stage in begun[1:])
        if "limits" in named and len(begun) > 1:  # a step of stage 2
            (early if done < 2 * END else late).update(batch.views.numpy())

    scores = [20.0, 20.0 + gain]
    monkeypatch.setattr(Optimization, "__init__", begin)
    monkeypatch.setattr(RayBank, "draw", drawn)
    monkeypatch.setattr(trainer, "held_psnr", lambda *_: scores.pop(0))
    run = trainer.train(ball_data[0], TRIED, "cpu", "ball")
    _, without, with_cost = begun
    assert (without.depth_cost, with_cost.depth_cost) == (0.0, 0.05)
    kept, other = (with_cost, without) if gain > 0.0 else (without, with_cost)
    assert (kept.number, other.number) == (160, END)
    assert run.complete and run.report["depth_gain"] == pytest.approx(gain)
    steps = [row["step"] for row in run.report["history"] if row["stage"] == 2]
    assert steps == sorted(set(steps)) and steps[-1] == 160
    said = " ".join(capsys.readouterr().out.split())
    assert f"A cost of depth gives {gain:+.2f} dB on views held aside: goes on with" in said
    aside = set(views_aside(ball_data[0].view_count))
    assert early == set(range(20)) - aside and late == set(range(20))


def test_a_run_that_is_interrupted_in_its_trial_ends_where_another_does(
    ball_data, monkeypatch, tmp_path
):
    """In the first beginning and in the second one, whose steps are lost."""
    whole, path = trainer.train(ball_data[0], TRIED, "cpu", "ball"), tmp_path / "ball.checkpoint"
    for steps in (24, END + 8):
        step, done = Optimization.step, []

        def interrupted(self, *arguments, step=step, done=done, steps=steps):
            if self.step_count == 160:
                done.append(self)
                if len(done) == steps:
                    raise KeyboardInterrupt
            step(self, *arguments)

        with monkeypatch.context() as patch:
            patch.setattr(Optimization, "step", interrupted)
            half = trainer.train(ball_data[0], TRIED, "cpu", "ball", path)
        assert half.interrupted and half.resumable
        resumed = load_checkpoint(path)
        assert resumed.fit["step"]["number"] == min(steps - 1, END)
        again = trainer.train(ball_data[0], TRIED, "cpu", "ball", path, resumed)
        assert again.report["depth_gain"] == whole.report["depth_gain"]
        np.testing.assert_array_equal(again.field.table, whole.field.table)


def test_a_second_beginning_that_is_lost_changes_nothing(ball_data, monkeypatch):
    step = Optimization.step

    def lost(self, *arguments):
        step(self, *arguments)
        if self.depth_cost:
            raise trainer.Diverged("the loss became nan")

    monkeypatch.setattr(Optimization, "step", lost)
    run = trainer.train(ball_data[0], TRIED, "cpu", "ball")
    assert run.complete and run.report["depth_gain"] == 0.0
