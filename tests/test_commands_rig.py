"""deformrf-rig: what a rig holds, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core import field as fields
from deformrf.core.commands import rig as command
from deformrf.core.rig import Clip, Rig, arrays_of, make_skeleton


@pytest.fixture
def model(make_ball_field, tmp_path):
    """A model file with a rig of two bones."""
    field = make_ball_field(0)
    heads, tails = [[0.5, 0.5, 0.2], [0.5, 0.5, 0.5]], [[0.5, 0.5, 0.5], [0.5, 0.5, 0.8]]
    skeleton = make_skeleton(("lower", "upper"), (-1, 0), heads, tails)
    upper = field.mesh.rest_vertices[:, 2] > 0.5
    weights = np.stack([~upper, upper], axis=1).astype(np.float32)
    rig = Rig(skeleton, weights, (Clip("Nod", 1.5, ()),))
    path = tmp_path / "rigged.npz"
    fields.save(replace(field, rig_arrays=arrays_of(rig)), path)
    return path


def test_info_shows_bones_and_clips(call, model):
    result = call(command.main, "info", model)
    assert result.code == 0
    assert "\n  lower: leads" in result.out and "\n    upper: leads" in result.out
    assert "Nod: 1.5 s" in result.out


def test_a_model_without_a_rig_says_what_gives_it_one(call, make_ball_field, tmp_path, refused):
    fields.save(make_ball_field(0), tmp_path / "bare.npz")
    assert "has no rig: deformrf-rig bind" in refused(
        call(command.main, "info", tmp_path / "bare.npz")
    )


def test_a_bad_rig_in_a_model_is_one_sentence(call, model, refused):
    field = fields.load(model)
    arrays = field.rig_arrays | {"rig_parents": np.array([-1, 1], np.int32)}
    fields.save(replace(field, rig_arrays=arrays), model)
    assert "the parent of bone 'upper' is number 1" in refused(call(command.main, "info", model))
