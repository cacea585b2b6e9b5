"""The lattice's tets are those that training begins with."""

import numpy as np

from deformrf.core.definition import lattice
from deformrf.core.geometry import A15, cell_tets


def test_the_tets_of_a_period_are_those_of_the_program():
    """As sets of corners; their order is the program's choice."""
    ours, theirs = (
        {tuple(sorted(map(tuple, tet))) for tet in tets.tolist()}
        for tets in (lattice.period_tets(), cell_tets(A15))
    )
    assert ours == theirs and len(ours) == 46


def test_tets_fill_the_period_and_are_positive():
    corners = lattice.period_tets()
    six_volumes = np.linalg.det(corners[:, 1:] - corners[:, :1])
    assert (six_volumes > 0).all()
    assert np.isclose(six_volumes.sum() / 6.0, lattice.PERIOD**3)
