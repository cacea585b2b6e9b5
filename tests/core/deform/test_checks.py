"""Arguments that the solver refuses, each with what is wrong and where."""

import numpy as np
import pytest

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver
from deformrf.core.geometry import a15_grid

MESH = a15_grid(0.25)


def test_nan_is_refused_with_its_place(device):
    free = np.zeros(MESH.vertex_count, bool)
    x = XpbdSolver(MESH.rest_vertices, MESH.tets, Material(), free, device=device)
    wrong = MESH.rest_vertices.copy()
    wrong[5, 1] = np.nan
    with pytest.raises(ValueError, match="position of vertex 5"):
        x.set_state(wrong)
    with pytest.raises(ValueError, match="velocity of vertex 5"):
        x.set_state(MESH.rest_vertices, wrong)
    x.grab([3, 4])
    with pytest.raises(ValueError, match="target of handle 1"):
        x.move([[0, 0, 0], [0, np.inf, 0]])
    for stiffness, limit in ((0.0, 1.0), (np.nan, 1.0), (np.inf, 1.0), (1.0, -1.0), (1.0, np.nan)):
        with pytest.raises(ValueError, match="springs of"):
            x.grab([3], stiffness, limit)
    with pytest.raises(ValueError, match="compliance of the edges is -1"):
        x.set_compliances(-1.0, None)
    with pytest.raises(ValueError, match=r"shape \(2,\)"):
        x.set_compliances([1.0, 2.0], None)
    with pytest.raises(ValueError, match="vertex 0 has a mass of nan"):
        x.set_masses(np.full(MESH.vertex_count, np.nan))
    for option in ({"gravity": (0, 0, np.nan)}, {"ground": np.inf}, {"friction": -1.0}):
        with pytest.raises(ValueError, match=next(iter(option))):
            XpbdOptions(**option)
    for _ in range(6):
        x.step(TIME_STEP)
    assert np.isfinite(x.vertices.numpy()).all()
