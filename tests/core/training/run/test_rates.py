"""Learning rates: a cosine to a stage's final rate, and wide color networks that learn slower."""

import pytest
from gray_photographs import gray_photographs

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training import preset, stages, world_to_unit_cube
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.rates import learning_rate
from deformrf.core.training.run.training_field import TrainingField


@pytest.mark.parametrize("final_rate", [*stages.FINAL_RATES.values(), 1.0])
def test_a_rate_falls_to_its_final_share(final_rate):
    rates = [learning_rate(step, 1000, 0.02, final_rate) for step in range(1001)]
    assert rates[0] == pytest.approx(0.02)
    assert rates[500] == pytest.approx(0.01 * (1.0 + final_rate))
    assert rates[-1] == pytest.approx(0.02 * final_rate)
    assert rates == sorted(rates, reverse=True)


@pytest.mark.parametrize("hidden, share", [((64, 64), 1.0), ((32,), 1.0), ((256, 256, 64), 0.25)])
def test_the_rate_of_colors_falls_with_their_widest_layer(hidden, share):
    """Other rates stay, and so does the order, which a checkpoint counts parameters by."""
    dataset = gray_photographs(alpha=128)
    bank = RayBank(dataset, world_to_unit_cube(dataset, radius=1.5), "cpu")
    options = FieldOptions(2, 2**8, march_step=0.05, color_hidden=hidden, deferred=True)
    field = TrainingField(a15_grid(0.25), options, "cpu")
    stage = Optimization(field, bank, preset("tiny"), dataset.has_alpha, 50, 1.0)
    stage.step(0.1, False)
    groups = stage.optimizer.param_groups
    ids = [[id(weights) for weights in group["params"]] for group in groups]
    assert [*ids[0], *ids[1]] == [id(weights) for weights in field.parameters()]
    assert ids[1] == [id(weights) for weights in field.networks.color.parameters()]
    assert [group["lr"] for group in groups] == pytest.approx([0.1, 0.1 * share])
