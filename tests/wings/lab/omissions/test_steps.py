"""Steps with what is left out: poses differ by what they should."""

import numpy as np
import pytest

from deformrf.wings.lab.omissions import steps
from deformrf.wings.lab.omissions.switch import NONE, measured


@pytest.fixture(scope="module")
def two_halves(make_ball_field):
    return make_ball_field(2, gap=0.15)


def sizes(change):
    return 0.0 if change == NONE else float(change.split()[2])


def rows(field, device, *names, turns=9):
    """Measure the switches whose names begin like this."""
    switches = steps.step_switches(field, device, turns)
    return [measured(s) for name in names for s in switches if s.name.startswith(name)]


def test_every_row_is_measured(two_halves, device):
    found = rows(two_halves, device, "")
    assert len(found) == 5
    for row in found:
        assert np.isfinite([row.with_it.low, row.without.low, row.saving.median]).all()
        assert (row.unit, row.with_it.count) == ("ms", 9) and row.change and row.why


def test_the_handles_swing(ball):
    drag = steps.DraggedSolver(ball, "cpu")
    assert len(drag.handles) and not drag.solver.pinned[drag.handles].any()
    reached = []
    for _ in range(steps.PERIOD // 2):
        drag.turn()
        reached.append(drag.solver.vertices.numpy()[drag.handles[0], 0])
    away = np.array(reached) - ball.mesh.rest_vertices[drag.handles[0], 0]
    assert away.max() == pytest.approx(steps.SWING * drag.solver.object_size, rel=1e-3)
    assert abs(away[-1]) < 1e-6


def test_volumes_do_nothing_at_a_quarter_and_something_above(ball, device):
    quarter, shared = rows(ball, device, "volume constraints")
    assert "of 1/4" in quarter.name and sizes(quarter.change) < 1e-6
    assert "% of the tets" in shared.name and 1e-5 < sizes(shared.change) < 0.5


def test_other_parts_are_left_out_and_stay(two_halves, ball, device):
    """The number of active parts, too: milliseconds are blurred by a busy machine."""
    [row] = rows(two_halves, device, "parts without")
    assert "1 of 2" in row.name and sizes(row.change) < 1e-6
    assert rows(ball, device, "parts without") == []
    with_it, without = (steps.DraggedSolver(two_halves, "cpu") for _ in range(2))
    with_it.solver.set_options(with_it.solver.options)
    active = [drag.solver._active.tolist() for drag in (with_it, without)]
    assert active[0] == [True, True] and sorted(active[1]) == [False, True]


def test_a_sleeping_solver_stays_where_it_is(ball):
    [row] = rows(ball, "cpu", "the solver while")
    assert sizes(row.change) < 1e-6
    for may_sleep in (True, False):
        drag = steps.DraggedSolver(ball, "cpu").let_go(may_sleep)
        drag.turn()
        assert drag.solver.settled == may_sleep


def test_gravity_changes_the_pose(ball, device):
    [row] = rows(ball, device, "gravity")
    assert 1e-5 < sizes(row.change) < 0.5
