"""What mouse and bones hold at the same time."""

from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.viewer.document import Hold


class Solver:
    """Notes what it is given."""

    def __init__(self):
        self.calls = []
        self.places = np.arange(30.0).reshape(10, 3)
        self.vertices = self

    def numpy(self):
        return self.places

    def grab(self, ids, *springs):
        self.calls.append(("grab", np.asarray(ids).tolist(), *springs))

    def move(self, targets):
        self.calls.append(("move", np.asarray(targets)[:, 0].tolist()))


@pytest.fixture
def solver():
    return Solver()


@pytest.fixture
def hold(solver):
    return Hold(SimpleNamespace(solver=solver))


def at(*values):
    return np.repeat(np.array(values, float)[:, None], 3, axis=1)


def test_without_bones_the_solver_gets_what_the_mouse_does(hold, solver):
    hold.grab([1, 2], "stiffness", "limit")
    hold.move(at(5, 6))
    hold.release()
    assert solver.calls == [
        ("grab", [1, 2], "stiffness", "limit"),
        ("move", [5, 6]),
        ("grab", []),
    ]


def test_the_mouse_takes_what_bones_leave_and_bones_go_on(hold, solver):
    hold.hold_bones([2, 3], at(7, 8))
    hold.grab([1, 2])
    assert solver.calls[-2:] == [("grab", [1, 2, 3]), ("move", [3, 7, 8])]  # 1 is where it was
    hold.move(at(5, 6))
    hold.hold_bones([2, 3], at(9, 10))
    assert solver.calls[-2:] == [("move", [5, 7, 8]), ("move", [5, 9, 10])]
    hold.release()
    assert solver.calls[-2:] == [("grab", [2, 3]), ("move", [9, 10])]


def test_bones_let_go_of_what_the_mouse_still_holds(hold, solver):
    hold.grab([4])
    hold.move(at(1))
    hold.hold_bones([5], at(2))
    hold.release_bones()
    assert solver.calls[-2:] == [("grab", [4]), ("move", [1])]
    count = len(solver.calls)
    hold.release_bones()
    assert len(solver.calls) == count
