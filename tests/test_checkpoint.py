"""Checkpoint files: what can't be gone on from is one sentence."""

import numpy as np
import pytest
import torch

from deformrf.core.geometry import a15_grid
from deformrf.core.training import preset
from deformrf.core.training.run.checkpoint import (
    FORMAT,
    Checkpoint,
    CheckpointError,
    load_checkpoint,
    save_checkpoint,
)


def some(**options):
    fit = {"number": 7, "parameters": [torch.arange(3.0)]}
    return Checkpoint(preset("tiny", **options), 2, a15_grid(0.25), fit, np.eye(4), {"seconds": 1})


def test_what_is_saved_is_loaded(tmp_path):
    saved = some(aabb=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
    save_checkpoint(saved, tmp_path / "a.checkpoint")
    loaded = load_checkpoint(tmp_path / "a.checkpoint")
    assert (loaded.options, loaded.stage, loaded.report) == (saved.options, 2, saved.report)
    np.testing.assert_array_equal(loaded.mesh.tets, saved.mesh.tets)
    np.testing.assert_array_equal(loaded.mesh.rest_vertices, saved.mesh.rest_vertices)
    assert torch.equal(loaded.fit["parameters"][0], torch.arange(3.0))
    assert [p.name for p in tmp_path.iterdir()] == ["a.checkpoint"]


def truncate(path):
    path.write_bytes(path.read_bytes()[:1000])


@pytest.mark.parametrize(
    "spoil, sentence",
    [
        (lambda path: path.unlink(), "no .* to resume from"),
        (lambda path: path.write_text("text"), "can't be read as a checkpoint"),
        (truncate, "can't be read as a checkpoint"),
        (lambda path: torch.save({"format": "other"}, path), "another version"),
        (lambda path: torch.save([1], path), "no checkpoint of this version"),
        (lambda path: torch.save({"format": FORMAT}, path), "no checkpoint of this"),
    ],
)
def test_what_can_not_be_used_is_one_sentence(tmp_path, spoil, sentence):
    path = tmp_path / "a.checkpoint"
    save_checkpoint(some(), path)
    spoil(path)
    with pytest.raises(CheckpointError, match=sentence) as caught:
        load_checkpoint(path)
    assert "\n" not in str(caught.value)
