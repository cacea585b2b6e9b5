"""A loss that rises far: which weights are good, and when a stage is given up."""

from types import SimpleNamespace

import pytest
import torch

from deformrf.core.training.run import monitoring
from deformrf.core.training.run.monitoring import Diverged, LossWatch

LOOK = 16  # steps from one error to the next


@pytest.fixture
def field():
    """Weights that count the steps, and an occupancy."""
    weights = torch.zeros(1)

    def set_weights(good):
        weights.copy_(good[0])

    field = SimpleNamespace(
        thickness=torch.zeros(2),
        occupied=torch.ones(2, dtype=torch.bool),
        parameters=lambda: [weights],
        set_weights=set_weights,
    )
    field.set_occupancy = lambda *values: field.__dict__.update(
        thickness=values[0].clone(), occupied=values[1].clone()
    )
    return field


def watched(field, errors, step_count=10**6):
    """Let a LossWatch see errors; what it said, and at which step."""
    watch = LossWatch(field, lambda: None)
    watch.keep_good(0)
    said = []
    for look, error in enumerate(errors, start=1):
        number = look * LOOK
        field.parameters()[0].fill_(number)
        field.thickness.fill_(error)
        sentence = watch.examine(error, number, step_count)
        if sentence:
            said.append((number, sentence))
    return watch, said


@pytest.mark.parametrize("phase", range(0, 32, 3))
@pytest.mark.parametrize("growth, looks", [(1.5, 12), (30.0, 1), (5.0, 3)])
def test_weights_of_a_rising_loss_are_not_good(field, phase, growth, looks):
    """Wherever between two snapshots it rises: from what is kept, the loss is low again."""
    watch, levels, level = LossWatch(field, lambda: None), {0: 1e-3}, 1e-3
    watch.keep_good(0)
    begin = 100 + phase
    for look in range(1, 300):
        if watch.returns == 0 and begin <= look < begin + looks:
            level *= growth
        levels[look * LOOK] = level
        field.parameters()[0].fill_(look * LOOK)
        if watch.examine(level, look * LOOK, 10**6):
            level = levels[int(field.parameters()[0])]
    assert watch.returns == 1 and level < 0.02


def test_the_occupancy_of_good_weights_comes_back(field):
    _, said = watched(field, [1e-3] * 40 + [float("inf")])
    assert len(said) == 1
    assert float(field.thickness[0]) == pytest.approx(1e-3)


def test_a_loss_that_is_lost_at_the_last_step_ends_the_run(field):
    """There is nothing to go on with."""
    with pytest.raises(Diverged, match="at step 640 of 640; the model has the weights of step"):
        watched(field, [1e-3] * 39 + [float("nan")], step_count=640)


def test_after_some_returns_it_is_given_up(field):
    errors = [1e-3] * 40 + [float("nan")] * monitoring.MOST_RETURNS
    assert watched(field, errors)[0].returns == monitoring.MOST_RETURNS
    with pytest.raises(Diverged):
        watched(field, [*errors, float("nan")])


def test_without_a_terminal_lines_say_how_far_a_run_is(capsys, monkeypatch):
    """As in a file or a batch system, where the bar appears only at the end."""
    monkeypatch.setattr(monitoring, "TOLD_SECONDS", 0.0)
    with monitoring.TrainingProgress() as progress:
        task = progress.begin("stage 1", 40)
        for _ in range(2):
            progress.advance(task, 10, 0.01, 1000)
        told = capsys.readouterr().out
    assert "stage 1: 10/40, 20.00 dB" in told and "stage 1: 20/40, 20.00 dB" in told
