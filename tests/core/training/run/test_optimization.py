"""A stage's steps: the learning rate, the number of rays, and what happens when things go wrong."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from gray_photographs import gray_photographs

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training import preset, world_to_unit_cube
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run import memory, monitoring, optimization
from deformrf.core.training.run.adam import learning_rate
from deformrf.core.training.run.batch import looks
from deformrf.core.training.run.distributed import Workers
from deformrf.core.training.run.monitoring import Diverged, TrainingProgress
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import TrainingField

OPTIONS = preset("tiny", samples_per_step=2**14, coarse_steps=50, fine_steps=50)


@pytest.fixture
def run():
    """A stage on a few photographs of gray, with 50 steps to go."""
    dataset = gray_photographs(alpha=128)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), "cpu")
    field = TrainingField(a15_grid(0.25), FieldOptions(2, 2**8, march_step=0.05), "cpu")
    return Optimization(field, bank, OPTIONS, dataset.has_alpha, 50, 0.3)


def go(run):
    with TrainingProgress() as progress:
        run.run(progress, "stage")


def test_the_distortion_loss_can_be_left_out(run):
    without = replace(OPTIONS, leave_out=("distortion",))
    assert run.distortion == OPTIONS.distortion > 0.0
    assert Optimization(run.field, run.bank, without, run.has_alpha, 1, 1.0).distortion == 0.0


@pytest.mark.soak
def test_features_decay_more_at_finer_levels_and_no_other_weight(run):
    """Gradients are those of the term in loss.py."""
    run.set_ray_count(64)
    table, offsets = run.field.table, run.field.layout.offsets
    with torch.no_grad():
        table.normal_()
    found = []
    for decay in (0.0, 3e-3 * run.bank.drawn_pixel_count):
        run.options = replace(run.options, table_decay=decay)
        run._prepare(run.batch, 0)
        run._march(run.batch)
        run._backpropagate(run.batch)
        found.append([p.grad / optimization.LOSS_SCALE for p in run.field.parameters()])
    without, decayed = found
    values = table.detach().requires_grad_()
    squares = [values[offsets[level] : offsets[level + 1]].square().sum() for level in (0, 1)]
    (expected,) = torch.autograd.grad(3e-3 * 0.5 * (squares[0] / 4.0 + squares[1]), values)
    torch.testing.assert_close(decayed[0] - without[0], expected, rtol=1e-3, atol=1e-6)
    for mine, other in zip(decayed[1:], without[1:], strict=True):
        assert torch.equal(mine, other)


def test_features_decay_by_the_number_of_pixels(run):
    """4 · 8 · 8 of them."""
    assert run.table_decay == pytest.approx(OPTIONS.table_decay / 256)
    run.bank.draw_from(shares=[1.0, 0.0, 0.0, 0.0])
    fewer = Optimization(run.field, run.bank, OPTIONS, run.has_alpha, 1, 1.0)
    assert fewer.table_decay == pytest.approx(OPTIONS.table_decay / 64)
    tried = replace(OPTIONS, strong_decay=8.0)
    strong = Optimization(run.field, run.bank, tried, run.has_alpha, 1, 1.0, strong_decay=True)
    assert strong.table_decay == pytest.approx(8.0 / 64)
    without = replace(OPTIONS, leave_out=("table-decay",))
    assert Optimization(run.field, run.bank, without, run.has_alpha, 1, 1.0).table_decay == 0.0


def test_the_learning_rate_warms_up_and_falls_along_a_cosine(run):
    rates = [
        learning_rate(step, 10_000, 1.0, 0.2) * run._watch.rate_share(step)
        for step in range(10_001)
    ]
    assert rates[0] == pytest.approx(0.01)
    assert max(rates) == pytest.approx(1.0, abs=1e-3)
    assert rates[5000] == pytest.approx(0.6, abs=1e-3)
    assert rates[-1] == pytest.approx(0.2)


def test_the_ray_count_fills_the_room_and_then_stays():
    count = 1024
    for _ in range(20):
        count = optimization.next_ray_count(count, 13 * count, 2**18)
    assert 0.8 * 2**18 <= 13 * count <= 2**18
    assert optimization.next_ray_count(count, 13 * count, 2**18) == count
    assert optimization.next_ray_count(256, 10**9, 2**18) == optimization.FEWEST_RAYS
    assert optimization.next_ray_count(2**16, 0, 2**18) == optimization.MOST_RAYS


def test_all_steps_are_done(run):
    go(run)
    assert run.number == 50


def test_pauses_come_every_few_steps(run):
    numbers = []
    with TrainingProgress() as progress:
        run.run(progress, "stage", lambda: numbers.append(run.number))
    assert numbers == [16, 32, 48]


@pytest.mark.parametrize("network", ["density", "color"])
def test_a_loss_that_is_no_number_ends_the_run_with_good_weights(run, monkeypatch, network):
    """And with an occupancy that such weights did not change."""
    monkeypatch.setattr(monitoring, "MOST_RETURNS", 0)
    step = Optimization.step

    def spoiled(self, rate, white):
        step(self, rate, white)
        if run.number == 40:
            with torch.no_grad():
                getattr(self.field.networks, network)[0].weight[0, 0] = float("nan")

    monkeypatch.setattr(Optimization, "step", spoiled)
    with pytest.raises(Diverged, match=r"the loss became nan at step 48 of 50.* of step 32"):
        go(run)
    assert run.field.thickness.isfinite().all()
    assert run.field.occupied.any()
    assert all(bool(p.isfinite().all()) for p in run.field.parameters())


def test_a_loss_that_is_lost_at_once_leaves_what_the_run_began_with(run, monkeypatch):
    before = [p.detach().clone() for p in run.field.parameters()]
    step = Optimization.step

    def spoiled(self, rate, white):
        step(self, rate, white)
        with torch.no_grad():
            self.field.networks.color[0].weight[0, 0] = float("nan")

    monkeypatch.setattr(Optimization, "step", spoiled)
    with pytest.raises(Diverged, match="of step 0"):
        go(run)
    for mine, first in zip(run.field.parameters(), before, strict=True):
        assert torch.equal(mine, first)


def test_a_run_ends_with_averaged_weights_and_exports_them_before(run, monkeypatch):
    """A parameter that follows the step's number ends at the mean of all pauses so far."""
    monkeypatch.setattr(optimization, "AVERAGED_SHARE", 1.0)
    step, lent, exported = Optimization.step, [], []

    def counting(self, rate, white):
        step(self, rate, white)
        self.field.table.data[0] = self.number
        self.field.networks.color[0].bias.data[0] = self.number

    def look():
        raw = run.field.table[0, 0].item()
        with run.averaged():
            lent.append(run.field.table[0, 0].item())
            exported.append(run.field.export(np.eye(4), {}))
        assert run.field.table[0, 0].item() == raw == run.number

    monkeypatch.setattr(Optimization, "step", counting)
    with TrainingProgress() as progress:
        run.run(progress, "stage", look)
    assert lent == [16, 24, 32]
    assert [field.table[0, 0] for field in exported] == lent
    assert [field.color_layers[0][1][0] for field in exported] == lent
    share_of_last = 16 / 50  # the stage ends 2 steps after a pause
    end = 32 + (50 - 32) * share_of_last
    assert run.field.table[0, 0].item() == pytest.approx(end)


def test_after_a_return_the_average_has_only_what_came_since(run, monkeypatch):
    monkeypatch.setattr(optimization, "AVERAGED_SHARE", 1.0)
    bias = run.field.networks.color[0].bias.data
    run._watch.returned_at = 3200
    means = []
    for pause in 1, 2, 3:
        run.number = 3200 + 16 * pause
        bias[0] = pause
        run._average_weights()
        with run.averaged():
            means.append(run.field.networks.color[0].bias[0].item())
    assert means == pytest.approx([1.0, 1.5, 2.0])


@pytest.mark.parametrize("scale", [0.0, -1024.0, float("nan"), float("inf"), "1024", 1e30])
def test_no_loss_has_such_a_scale(run, scale):
    state = run.state()
    assert state["step"]["loss_scale"] == optimization.LOSS_SCALE
    with pytest.raises(ValueError, match="a loss scaled by"):
        run.load_state({**state, "step": {**state["step"], "loss_scale": scale}})


def test_a_weight_that_no_ray_meets_is_watched_too(run, monkeypatch):
    monkeypatch.setattr(monitoring, "SNAPSHOT_INTERVAL", 16)
    monkeypatch.setattr(monitoring, "MOST_RETURNS", 0)
    step = Optimization.step

    def spoiled(self, rate, white):
        step(self, rate, white)
        if run.number == 20:
            self.field.table.data[-1] = float("inf")
            self.error.fill_(0.01)

    monkeypatch.setattr(Optimization, "step", spoiled)
    with pytest.raises(Diverged):
        go(run)
    assert bool(run.field.table.isfinite().all())


def test_a_loss_that_rises_far_ends_the_run(run, monkeypatch):
    monkeypatch.setattr(monitoring, "MOST_RETURNS", 0)
    step = Optimization.step

    def rising(self, rate, white):
        step(self, rate, white)
        self.error.fill_(1e-3 if run.number < 20 else 1.0)

    monkeypatch.setattr(Optimization, "step", rising)
    with pytest.raises(Diverged, match=r"the loss rose from 0\.001 to 0\.2 at step 32"):
        go(run)


def test_a_run_goes_on_from_its_good_weights_more_slowly(run, monkeypatch, capsys):
    """After a step that throws all weights off, and after three others it gives up."""
    step, rates, thrown = Optimization.step, [], {36}

    def throwing(self, rate, white):
        step(self, rate, white)
        rates.append(rate)
        if self.number in thrown:
            for weights in self.field.parameters():
                weights.data.fill_(float("nan"))

    monkeypatch.setattr(Optimization, "step", throwing)
    monkeypatch.setattr(monitoring, "WARM_UP_STEPS", 1)
    go(run)
    assert run.number == 50
    assert all(bool(weights.isfinite().all()) for weights in run.field.parameters())
    said = "The loss became nan at step 48 of 50; going on with the weights of step 32"
    assert said in " ".join(capsys.readouterr().out.split())
    highest = run.options.learning_rate
    wanted = [learning_rate(n, 50, highest, 0.3) for n in range(50)]
    np.testing.assert_allclose(rates[:48], wanted[:48])
    np.testing.assert_allclose(rates[48:], 0.5 * np.array(wanted[48:]))
    moments = [s for s in run.optimizer.state.values() if s["exp_avg"].abs().sum() > 0.0]
    assert {int(state["step"]) for state in moments} == {2}  # begun anew at step 48
    thrown.update(range(200))
    run.step_count = 200
    with pytest.raises(Diverged, match="the loss became nan at step 96 of 200; the model has"):
        go(run)
    assert all(bool(weights.isfinite().all()) for weights in run.field.parameters())


def test_a_resumed_run_stays_as_slow(run):
    run._watch.returns, run._watch.returned_at, run.number = 2, 32, 40
    state = run.state()
    run._watch.load(0, 0, 0)
    run.load_state(state)
    assert run._watch.rate_share(10**6) == 0.25 and run._watch.returned_at == 32
    for forged in (9, 0), (1, 41), (1, -1):
        state["step"]["returns"] = forged
        with pytest.raises(ValueError, match="it returned"):
            run.load_state(state)


def take_too_much(monkeypatch, error):
    """Let a step fail while it has room for more than 2**13 samples."""
    step = Optimization.step

    def greedy(self, rate, white):
        if self.samples_per_step > 2**13:
            raise error
        step(self, rate, white)

    monkeypatch.setattr(Optimization, "step", greedy)


@pytest.mark.parametrize("error", [torch.OutOfMemoryError(), RuntimeError("Failed to allocate 9")])
def test_too_little_memory_halves_the_batch_aloud(run, monkeypatch, capsys, error):
    take_too_much(monkeypatch, error)
    go(run)
    assert run.number == 50
    assert run.samples_per_step == 2**13
    assert "going on with 8192 samples a step" in capsys.readouterr().out


@pytest.mark.parametrize(
    "error, whose",
    [
        (torch.OutOfMemoryError("CUDA out of memory"), "GPU's memory"),
        (RuntimeError("Failed to allocate 9 bytes on device 'cuda:0'"), "GPU's memory"),
        (RuntimeError("Failed to allocate 9 bytes on device 'cpu'"), "computer's memory"),
        (
            RuntimeError("[enforce fail at alloc_cpu.cpp:1] DefaultCPUAllocator: can't allocate"),
            "computer's memory",
        ),
        (MemoryError("Unable to allocate 9 GiB for an array"), "computer's memory"),
    ],
)
def test_the_memory_that_is_too_small_is_named(run, monkeypatch, capsys, error, whose):
    assert memory.lacks_memory(error)
    said = str(memory.OutOfMemory.of(error))
    assert said.startswith(f"the {whose} is too small") and str(error) in said
    take_too_much(monkeypatch, error)
    go(run)
    said = " ".join(capsys.readouterr().out.split())
    assert f"The {whose} is too small; going on with 8192 samples" in said


def test_no_memory_at_all_is_said(run, monkeypatch):
    def greedy(self, rate, white):
        raise torch.OutOfMemoryError

    monkeypatch.setattr(Optimization, "step", greedy)
    with pytest.raises(MemoryError, match="--image-size"):
        go(run)


def test_several_workers_without_memory_say_whose_it_is(run, monkeypatch):
    """They can't halve the room: the others wait in the middle of a step."""

    def greedy(self, rate, white):
        raise torch.OutOfMemoryError

    monkeypatch.setattr(Optimization, "step", greedy)
    run.workers = Workers(3, 4)
    with pytest.raises(MemoryError, match=r"worker 3 .* more GPUs"):
        go(run)


def test_occupancy_is_updated_in_smaller_chunks_where_memory_is_small(run, monkeypatch):
    field, sizes = run.field, []
    most = field.thickness.numel() // 3
    thickness = TrainingField._thickness_of

    def greedy(self, cells):
        sizes.append(len(cells))
        if len(cells) > most:
            raise torch.OutOfMemoryError
        return thickness(self, cells)

    monkeypatch.setattr(TrainingField, "_thickness_of", greedy)
    field.update_occupancy()
    assert bool((field.thickness > 0.0).all())
    sizes.clear()
    field.update_occupancy()
    assert max(sizes) <= most  # it doesn't try again what was too much


def test_unseen_subtets_are_looked_for_with_fewer_rays_where_memory_is_small(run, monkeypatch):
    """Up to the jitter of the samples, which follows a ray's place in its batch."""
    composite = TrainingField.composite

    def hide(most):
        def greedy(self, batch):
            if batch.ray_count > most:
                raise RuntimeError("Failed to allocate 9 bytes")
            return composite(self, batch)

        monkeypatch.setattr(TrainingField, "composite", greedy)
        run.field.hide_unseen(partial(looks, run.bank, "cpu", 10**9), 1e-4)
        return run.field.hidden

    hidden = hide(256), hide(100)
    assert 0.1 < hidden[0].float().mean() < 0.9
    assert (hidden[0] == hidden[1]).float().mean() > 0.8


def test_no_memory_to_look_is_said(run, monkeypatch):
    def greedy(self, batch):
        raise torch.OutOfMemoryError

    monkeypatch.setattr(TrainingField, "march", greedy)
    with pytest.raises(MemoryError, match=r"rays at once.*--image-size"):
        run.field.hide_unseen(partial(looks, run.bank, "cpu", 10**9), 1e-4)


def test_other_errors_pass(run, monkeypatch):
    def broken(self, rate, white):
        raise RuntimeError("an illegal memory access was encountered")

    monkeypatch.setattr(Optimization, "step", broken)
    with pytest.raises(RuntimeError, match="illegal"):
        go(run)
