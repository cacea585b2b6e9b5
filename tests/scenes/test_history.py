"""A run's history: what its rows say, that they are few, and that it goes on after a pause."""

import json
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from image_datasets import from_images

from deformrf.core.field import modelfile
from deformrf.core.render import look_at, pinhole
from deformrf.core.training import load_checkpoint, photographs, preset, trainer
from deformrf.core.training.data.raybank import RayBank
from deformrf.core.training.run import monitoring, optimization
from deformrf.core.training.run.monitoring import History
from deformrf.core.training.run.optimization import Optimization
from deformrf.core.training.run.training_field import TrainingField

SIZE = 24
OPTIONS = preset(
    "tiny",
    spacing=0.15,
    coarse_steps=40,
    fine_steps=60,
    level_count=3,
    samples_per_step=2**12,
    march_step=0.06,
)
LOOKS = [(1, 16), (1, 32), (1, 40), (2, 16), (2, 32), (2, 48), (2, 60)]


@pytest.fixture(scope="module", autouse=True)
def few_rays():
    """So that the first steps take no longer than the others."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optimization, "RAYS_AT_START", optimization.FEWEST_RAYS)
        yield


@pytest.fixture(scope="module")
def views():
    """An orange ball from 8 sides."""
    x, y = np.meshgrid(*[np.arange(SIZE) - 0.5 * (SIZE - 1)] * 2)
    image = np.zeros((SIZE, SIZE, 4), np.uint8)
    image[np.hypot(x, y) < 0.27 * SIZE] = (230, 120, 20, 255)
    eyes = np.random.default_rng(3).normal(size=(8, 3))
    poses = [look_at(4.0 * eye / np.linalg.norm(eye), (0, 0, 0)) for eye in eyes]
    lens = pinhole(0.5 * SIZE / np.tan(0.35), SIZE, SIZE)
    return from_images([image] * 8, poses, [lens] * 8, "abcdefgh", "train")


@pytest.fixture(scope="module")
def trained(views):
    return trainer.train(views, OPTIONS, "cpu", "ball")


def column(rows, name):
    return [row[name] for row in rows]


def places(rows):
    return [(row["stage"], row["step"]) for row in rows]


def filled(step_count, errors, rows=None):
    """The rows of a stage whose error is `errors`, seen every 16 steps and at the end."""
    rows = [] if rows is None else rows
    stage = History(rows, 2, step_count, lambda: 1.5)
    for step, mse in zip([*range(16, step_count, 16), step_count], errors, strict=True):
        stage.note(step, mse)
    return rows


def test_a_model_file_tells_how_its_error_fell(trained, tmp_path):
    modelfile.save(trained.field, tmp_path / "ball.npz")
    rows = modelfile.load(tmp_path / "ball.npz").meta["history"]
    assert rows == trained.report["history"]
    assert places(rows) == LOOKS
    seconds = [0.0, *column(rows, "seconds"), trained.report["seconds"]]
    assert all(a < b for a, b in pairwise(seconds))
    assert rows[2]["seconds"] <= trained.report["stage_1_seconds"] < rows[3]["seconds"]
    assert rows[-1]["psnr"] > rows[3]["psnr"] + 3.0


def test_rows_are_as_many_as_there_may_be_and_no_more(views, monkeypatch):
    monkeypatch.setattr(monitoring, "MOST_ROWS", 2)
    rows = trainer.train(views, OPTIONS, "cpu", "ball").report["history"]
    assert places(rows) == [(1, 32), (1, 40), (2, 32), (2, 60)]


@pytest.mark.parametrize("step_count", [1, 50, 1600, 1601, 30_000])
def test_rows_span_the_same_number_of_steps_to_the_end(step_count):
    looks = -(-step_count // 16)
    steps = column(filled(step_count, np.full(looks, 0.1)), "step")
    assert min(looks, monitoring.MOST_ROWS // 2) <= len(steps) <= monitoring.MOST_ROWS
    assert steps[-1] == step_count and len(set(np.diff(steps[:-1]))) <= 1


def test_a_row_has_the_mean_error_since_the_row_before():
    """What is seen counts for the steps since it was seen before: 8 at the end, here."""
    mse = np.random.default_rng().uniform(1e-4, 1e-1, 188)
    rows = filled(3000, mse)  # 30 steps a row, so every second look
    expected = [mse[i : i + 2].mean() for i in range(0, 186, 2)]
    expected.append((16 * mse[186] + 8 * mse[187]) / 24)
    np.testing.assert_allclose(column(rows, "psnr"), -10.0 * np.log10(expected), rtol=1e-12)


def test_what_is_lost_is_left_out_and_equal_images_are_finite():
    rows = filled(64, [0.1, float("nan"), float("inf"), 0.0])
    assert column(rows, "step") == [16, 64]
    assert rows[0]["psnr"] == pytest.approx(10.0) and rows[1]["psnr"] == pytest.approx(120.0)


def test_a_stage_neither_changes_rows_of_another_nor_repeats_its_own():
    first = {"seconds": 1.0, "stage": 1, "step": 7, "psnr": 9.0}
    rows = filled(32, [0.1, 0.01], [first])
    assert rows[0] == first and places(rows) == [(1, 7), (2, 16), (2, 32)]
    History(rows, 2, 32, lambda: 9.0).note(32, 0.0)  # no step was made since
    assert places(rows) == [(1, 7), (2, 16), (2, 32)] and rows[-1]["seconds"] == 1.5


class Interrupting:
    """Ctrl-C at the n-th call of a method."""

    def __init__(self, monkeypatch, owner, name, after):
        self.calls, self.after, self.method = 0, after, getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda mine, *args, **named: self(mine, *args, **named))

    def __call__(self, mine, *arguments, **named):
        self.calls += 1
        if self.calls > self.after:
            raise KeyboardInterrupt
        return self.method(mine, *arguments, **named)


@pytest.mark.parametrize(
    "owner, name, after, known",
    [
        (RayBank, "draw", 32, 2),  # just after the error was seen
        (TrainingField, "hide_unseen", 0, 3),  # all steps of stage 1 are done
        (RayBank, "draw", OPTIONS.coarse_steps + 21, 4),
    ],
)
def test_a_resumed_run_goes_on_with_it(
    views, trained, monkeypatch, tmp_path, owner, name, after, known
):
    """Without a gap or a repetition: the rows are those of a run that was never interrupted."""
    path = tmp_path / "ball.checkpoint"
    with monkeypatch.context() as patch:
        Interrupting(patch, owner, name, after)
        first = trainer.train(views, OPTIONS, "cpu", "ball", path)
    assert first.interrupted
    resumed = load_checkpoint(path)
    begun = first.report["history"]
    assert resumed.report["history"] == begun
    assert places(begun)[-1] == LOOKS[known - 1]
    whole = trainer.train(views, OPTIONS, "cpu", "ball", path, resumed).report["history"]
    assert resumed.report["history"] == begun
    assert whole[:known] == begun and places(whole) == LOOKS
    if owner is RayBank:  # what else is cut short isn't made up for, and changes what is learnt
        assert column(whole, "psnr") == column(trained.report["history"], "psnr")
    assert all(a < b for a, b in pairwise(column(whole, "seconds")))
    assert whole[-1]["seconds"] > 0.5 * first.report["seconds"]  # it ends after the last row


def test_a_row_that_was_begun_is_gone_on_with():
    errors = np.random.default_rng().uniform(1e-4, 1e-1, 188)
    rows, pause = [], 95  # in the middle of a row
    for part in (slice(0, pause), slice(pause, None)):
        rows = json.loads(json.dumps(rows))
        stage = History(rows, 1, 3000, lambda: 1.0)
        for i, mse in list(enumerate(errors))[part]:
            stage.note(min(16 * (i + 1), 3000), mse)
    assert column(rows, "psnr") == column(filled(3000, errors), "psnr")
    assert column(rows, "step") == column(filled(3000, errors), "step")


def test_a_lost_run_keeps_what_it_knew(views, monkeypatch):
    step = Optimization.step

    def spoiled(run, *arguments):
        step(run, *arguments)
        if run.number == 35:
            with torch.no_grad():
                run.field.networks.color[0].weight[0, 0] = float("nan")

    monkeypatch.setattr(Optimization, "step", spoiled)
    monkeypatch.setattr(monitoring, "MOST_RETURNS", 0)
    lost = trainer.train(views, OPTIONS, "cpu", "ball")
    assert lost.diverged
    assert places(lost.report["history"]) == LOOKS[:2]
    json.dumps(lost.report, allow_nan=False)


def test_a_checkpoint_that_can_not_be_written_is_a_warning(views, monkeypatch, tmp_path, capsys):
    """A full disk: the run goes on, and its model is there."""

    def full(*_):
        raise OSError("a.checkpoint can't be written: No space left on device")

    monkeypatch.setattr(trainer, "save_checkpoint", full)
    monkeypatch.setattr(trainer, "CHECKPOINT_SECONDS", 0.0)
    options = replace(OPTIONS, fine_steps=20, leave_out=("coarse-stage",))
    trained = trainer.train(views, options, "cpu", "ball", tmp_path / "a.checkpoint")
    assert trained.complete
    said = " ".join(capsys.readouterr().out.split())
    assert "training goes on" in said and "No space left on device" in said


def test_no_memory_outside_a_step_is_a_sentence(views, monkeypatch):
    def greedy(*_):
        raise torch.OutOfMemoryError("9 GiB")

    monkeypatch.setattr(photographs, "RayBank", greedy)
    with pytest.raises(MemoryError, match="--image-size"):
        trainer.train(views, OPTIONS, "cpu", "ball")


def test_the_time_of_who_watches_is_not_counted(views):
    options = replace(OPTIONS, leave_out=("coarse-stage",))
    pauses = []

    def look(_):
        pauses.append(time.perf_counter())
        time.sleep(0.5)

    begin = time.perf_counter()
    rows = trainer.train(views, options, "cpu", "ball", on_pause=look).report["history"]
    elapsed = time.perf_counter() - begin
    assert places(rows) == LOOKS[3:]
    assert len(pauses) == 3 and rows[-1]["seconds"] < elapsed - 1.5
