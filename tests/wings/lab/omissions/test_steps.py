"""Steps with what is left out: all is measured, and poses differ by what they should."""

import numpy as np
import pytest

from deformrf.wings.lab.omissions import steps
from deformrf.wings.lab.omissions.measure import DYNAMICS, NONE, NOT_MEASURED, SAVES, Bench


@pytest.fixture(scope="module")
def two_halves(make_ball_field):
    return make_ball_field(2, gap=0.15)


def sizes(change):
    return 0.0 if change == NONE else float(change.split()[2])


ROWS = (
    "volume constraints at a Poisson's ratio of 1/4",
    "volume constraints of ",
    "volume constraints at a Poisson's ratio of 0.35",
    "components without a handle",
    "the solver while nothing moves",
    "gravity and a ground",
    "springs that pull the handles",
)


def measured(field, device, repeats, name):
    """The row whose name begins like this."""
    [switch] = [s for s in steps.step_switches(field, device) if s.name.startswith(name)]
    return switch.measured(Bench(DYNAMICS, device, repeats, 1.0, steps.change))


def test_these_are_all_rows(ball):
    switches = steps.step_switches(ball, "cpu")
    assert all(s.name.startswith(name) for s, name in zip(switches, ROWS, strict=True))


@pytest.mark.parametrize("name", ROWS)
def test_every_row_is_measured(two_halves, device, name):
    found = measured(two_halves, device, 9, name)
    for timing in (found.with_it, found.without):
        assert np.isfinite([timing.low, timing.high]).all() and timing.count == 9
    least, most = (
        found.with_it.low - found.without.high,
        found.with_it.high - found.without.low,
    )
    assert least <= found.saving.median <= most
    assert found.unit == "ms" and found.change and found.why


def test_the_handles_swing(ball):
    drag = steps.Drag(ball, "cpu")
    assert len(drag.handles) and not drag.solver.pinned[drag.handles].any()
    reached = []
    for _ in range(steps.PERIOD // 2):
        drag.turn()
        reached.append(drag.vertices[drag.handles[0], 0])
    away = np.array(reached) - ball.mesh.rest_vertices[drag.handles[0], 0]
    assert away.max() == pytest.approx(steps.SWING * drag.solver.object_size, rel=1e-3)
    assert abs(away[-1]) < 1e-6


def test_volumes_do_nothing_at_a_quarter_and_something_above(ball, device):
    idle, real = (measured(ball, device, 9, name) for name in ROWS[:3:2])
    assert idle.left_out and sizes(idle.change) < 1e-6
    assert not real.left_out and sizes(real.change) > 10.0 * sizes(idle.change)


def test_other_components_are_left_out_and_stay(two_halves, ball, device):
    row = measured(two_halves, device, 25, "components")
    assert "1 of 2" in row.name and sizes(row.change) < 1e-6
    alone = measured(ball, device, 3, "components")
    assert alone.verdict == NOT_MEASURED and "one component" in alone.why and not alone.left_out


def test_half_of_the_constraints_are_left_out(two_halves):
    """The counts behind the milliseconds, which a busy machine blurs."""
    with_it, without = (steps.Drag(two_halves, "cpu") for _ in range(2))
    with_it.solver.set_options(with_it.solver.options)
    active = [drag.solver._active for drag in (with_it, without)]
    assert active[0].tolist() == [True, True] and sorted(active[1].tolist()) == [False, True]


def test_a_sleeping_solver_stays_where_it_is(ball):
    row = measured(ball, "cpu", 25, "the solver while")
    assert row.verdict == SAVES and sizes(row.change) < 1e-6


def test_gravity_and_springs_change_the_pose(ball, device):
    for name in ROWS[-2:]:
        found = measured(ball, device, 9, name)
        assert found.left_out and 1e-5 < sizes(found.change) < 0.5
