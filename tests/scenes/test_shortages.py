"""A run without memory or with a full disk: what it keeps, and what it says of that."""

import numpy as np
import pytest
import torch

from deformrf.core.training import load_checkpoint, preset, trainer
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run.monitoring import LossWatch
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import TrainingField

SMALL = {"spacing": 0.1, "level_count": 3, "table_size_log2": 12, "march_step": 0.02}
OPTIONS = preset("tiny", coarse_steps=60, fine_steps=40, samples_per_step=2**11, **SMALL)
NO_MEMORY = torch.OutOfMemoryError("CUDA out of memory")


@pytest.fixture(scope="module")
def trained(ball_data):
    return trainer.train(ball_data[0], OPTIONS, "cpu", "ball")


def parameters(trained):
    field = trained.field
    layers = [a for pair in (*field.density_layers, *field.color_layers) for a in pair]
    return [field.table, *layers, field.occupancy]


def fail_at(monkeypatch, owner, name, call, error):
    """Raise an error at the n-th call of a method."""
    method, calls = getattr(owner, name), 0

    def failing(self, *arguments, **named):
        nonlocal calls
        calls += 1
        if calls == call:
            raise error
        return method(self, *arguments, **named)

    monkeypatch.setattr(owner, name, failing)


@pytest.mark.parametrize(
    "owner, name, call, error, stage, step",
    [
        (TrainingField, "hide_unseen", 1, NO_MEMORY, 1, 60),
        (TrainingField, "__init__", 2, MemoryError("Unable to allocate 9 GiB"), 1, 60),
        (Optimization, "_average_weights", 2, NO_MEMORY, 1, 32),
        (LossWatch, "keep_good", 5, NO_MEMORY, 2, 16),
    ],
)
def test_a_run_without_memory_leaves_a_checkpoint_and_names_it(
    ball_data, trained, monkeypatch, tmp_path, owner, name, call, error, stage, step
):
    path = tmp_path / "ball.checkpoint"
    with monkeypatch.context() as patch:
        fail_at(patch, owner, name, call, error)
        with pytest.raises(MemoryError, match=rf"memory is too small.*--resume .* {path}"):
            trainer.train(ball_data[0], OPTIONS, "cpu", "ball", path)
    resumed = load_checkpoint(path)
    assert (resumed.stage, resumed.fit["step"]["number"]) == (stage, step)
    if name == "hide_unseen":
        whole = trainer.train(ball_data[0], OPTIONS, "cpu", "ball", path, resumed)
        for a, b in zip(parameters(trained), parameters(whole), strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_last_look_without_memory_leaves_the_trained_field(
    ball_data, trained, monkeypatch, tmp_path
):
    """The model keeps its hidden sub-tets; the checkpoint leads to the whole model."""
    path = tmp_path / "ball.checkpoint"
    with monkeypatch.context() as patch:
        fail_at(patch, TrainingField, "hide_unseen", 2, NO_MEMORY)
        short = trainer.train(ball_data[0], OPTIONS, "cpu", "ball", path)
    assert not short.complete and short.resumable
    assert "keeps what no image shows" in short.out_of_memory
    assert str(path) in short.out_of_memory
    for a, b in zip(parameters(trained)[:-1], parameters(short)[:-1], strict=True):
        np.testing.assert_array_equal(a, b)
    resumed = load_checkpoint(path)
    assert (resumed.stage, resumed.fit["step"]["number"]) == (2, OPTIONS.fine_steps)
    whole = trainer.train(ball_data[0], OPTIONS, "cpu", "ball", path, resumed)
    assert whole.complete
    for a, b in zip(parameters(trained), parameters(whole), strict=True):
        np.testing.assert_array_equal(a, b)


def test_without_memory_no_older_checkpoint_is_taken_for_the_run_s(
    ball_data, monkeypatch, tmp_path
):
    path = tmp_path / "ball.checkpoint"
    path.write_text("of another run")
    fail_at(monkeypatch, LossWatch, "keep_good", 1, NO_MEMORY)
    with pytest.raises(MemoryError) as caught:
        trainer.train(ball_data[0], OPTIONS, "cpu", "ball", path)
    assert "--resume" not in str(caught.value)
    assert path.read_text() == "of another run"


def full_disk(checkpoint, path):
    raise OSError(f"{path} can't be written (No space left on device)")


@pytest.mark.parametrize("saved_before", [False, True])
def test_an_interrupt_with_a_full_disk_says_what_is_kept(
    ball_data, monkeypatch, capsys, tmp_path, saved_before
):
    path = tmp_path / "ball.checkpoint"
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0 if saved_before else 1e9)
    save, saves = trainer.save_checkpoint, []

    def fills(checkpoint, path):
        saves.append(checkpoint)
        return save(checkpoint, path) if saved_before and len(saves) == 1 else full_disk(0, path)

    monkeypatch.setattr(trainer, "save_checkpoint", fills)
    fail_at(monkeypatch, RayBank, "draw", 21, KeyboardInterrupt())
    trained = trainer.train(ball_data[0], OPTIONS, "cpu", "ball", path)
    assert trained.interrupted and trained.resumable == path.exists() == saved_before
    said = " ".join(capsys.readouterr().out.split())
    kept = "the checkpoint before it is kept" if saved_before else "the run cannot be continued"
    assert kept in said and "training goes on" not in said


def test_a_full_disk_in_the_middle_of_a_run_is_said(ball_data, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(trainer, "save_checkpoint", full_disk)
    trained = trainer.train(ball_data[0], OPTIONS, "cpu", "ball", tmp_path / "ball.checkpoint")
    assert trained.complete and not trained.resumable
    assert "training goes on without it" in " ".join(capsys.readouterr().out.split())
