"""The tets that stage 2 trains on."""

import numpy as np
import pytest

from deformrf.core.field import FieldOptions
from deformrf.core.geometry import a15_grid
from deformrf.core.training import DatasetError, trained_tets
from deformrf.core.training.run import TrainingField


def test_nothing_occupied_is_said_so():
    stage = TrainingField(a15_grid(0.25), FieldOptions(level_count=2, table_size=2**8), "cpu")
    stage.occupied[:] = False
    with pytest.raises(DatasetError, match="scene box"):
        trained_tets.kept_mesh(stage)


@pytest.mark.parametrize("share, stays", [(0.8, False), (1.2, True)])
def test_floaters_are_measured_by_what_is_seen_of_them(share, stays):
    """A speck has many neighbours for its size; a few of its tets, of so many limits."""
    stage = TrainingField(a15_grid(0.05), FieldOptions(level_count=2, table_size=2**8), "cpu")
    middles = stage.mesh.rest_vertices[stage.mesh.tets].mean(axis=1)
    body, corner = middles[:, 0] < 0.5, [0.8, 0.5, 0.5]
    count = round(share * trained_tets.SMALLEST_COMPONENT * body.sum())
    speck = np.argsort(np.linalg.norm(middles - corner, axis=1))[:count]
    stage.occupied[:] = False
    stage.occupied[np.flatnonzero(body)] = True
    whole = trained_tets.kept_mesh(stage)
    stage.occupied[speck] = True
    mesh = trained_tets.kept_mesh(stage)
    more = mesh.tet_count - whole.tet_count
    assert count > 5 and more > 1.3 * count if stays else more == 0
