"""Interrupted runs: what --resume goes on with, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.commands import train
from deformrf.commands.running import INPUT_ERROR
from deformrf.core.geometry import a15_grid
from deformrf.core.training import preset


def unfinished(path, options=None, view_count=3, image_size=(16, 12)):
    """A checkpoint of a run with those options, over such views."""
    from deformrf.core.training.run.checkpoint import Checkpoint, save_checkpoint

    report = {"view_count": view_count, "image_size": list(image_size), "seconds": 9.0}
    options = options or preset("tiny", seed=5)
    save_checkpoint(Checkpoint(options, 1, a15_grid(0.25), {}, np.eye(4), report), path)
    return options


def test_a_resumed_run_has_the_options_of_its_checkpoint(call, trainer, data, tmp_path):
    options = unfinished(tmp_path / "m.checkpoint")
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu", "--resume")
    assert result.code == 0
    [call_] = trainer.calls
    assert call_[1] == call_[5].options == options
    assert not (tmp_path / "m.checkpoint").exists()


def test_an_interrupted_run_says_how_to_go_on(call, trainer, data, tmp_path):
    trainer.trained.interrupted = trainer.trained.resumable = True
    unfinished(tmp_path / "m.checkpoint")
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert "--resume" in result.out
    assert (tmp_path / "m.checkpoint").exists()


def test_a_fresh_run_says_that_it_replaces_an_interrupted_one(call, trainer, data, tmp_path):
    command = [train.main, data, "-o", tmp_path / "m.npz", "--preset", "tiny", "--device", "cpu"]
    assert "--resume" not in call(*command).out
    for flags, announced in (([], True), (["--resume"], False)):
        unfinished(tmp_path / "m.checkpoint", preset("tiny"))
        [*first, _] = call(*command, *flags).out.splitlines()
        told = len(first) == 1 and "An interrupted run left" in first[0]
        assert (told and "m.checkpoint" in first[0]) == announced


TINY_STEPS = preset("tiny").coarse_steps + preset("tiny").fine_steps
WORDS = {
    "nothing": [],
    "preset": ["--preset", "fast"],
    "steps": ["--steps", 9],
    "both": ["--preset", "tiny", "--steps", 700],
    "one step": ["--preset", "fast", "--steps", 2],
    "seed": ["--seed", 4],
    "box": ["--aabb", -1, -1.1, -1, 1, 1, 1.3],
    "radius": ["--scene-radius", 1.7],
    "spacing": ["--spacing", 0.05],
    "surroundings": ["--surroundings", "white"],
    "one stage": ["--steps", 50, "--leave-out", "subtet-mask", "coarse-stage"],
    "one color": ["--preset", "tiny", "--no-view-dependence"],
    "size": ["--image-size", 15],
}


@pytest.mark.parametrize("flags", WORDS.values(), ids=WORDS)
def test_the_same_command_and_resume_go_on(call, trainer, data, tmp_path, flags):
    command = [train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu", *flags]
    assert call(*command).code == 0
    views, options = trainer.calls[0][:2]
    lens = views.lenses[0]
    unfinished(tmp_path / "m.checkpoint", options, image_size=(lens.width, lens.height))
    result = call(*command, "--resume")
    assert (result.code, result.err) == (0, "")
    assert trainer.calls[1][1] == trainer.calls[1][5].options == options


def test_a_run_of_a_version_without_trials_goes_on(call, trainer, data, tmp_path):
    unfinished(tmp_path / "m.checkpoint", preset("small", depth_cost=0.0, strong_decay=0.0))
    flags = ("--device", "cpu", "--resume", "--preset", "small")
    assert call(train.main, data, "-o", tmp_path / "m.npz", *flags).code == 0
    options = trainer.calls[0][1]
    assert (options.depth_cost, options.strong_decay) == (0.0, 0.0)


def test_the_order_of_what_is_left_out_is_no_difference(call, trainer, data, tmp_path):
    unfinished(tmp_path / "m.checkpoint", preset("tiny", leave_out=("distortion", "subtet-mask")))
    flags = ("--device", "cpu", "--resume", "--leave-out", "subtet-mask", "distortion")
    assert call(train.main, data, "-o", tmp_path / "m.npz", *flags).code == 0


@pytest.mark.parametrize(
    "before, words",
    [
        ((), ("isolation",)),
        (("distortion",), ("isolation",)),
        (("distortion",), ("isolation", "distortion")),
        (("isolation", "distortion"), ("isolation",)),
    ],
)
def test_isolation_can_still_be_left_out(call, trainer, data, tmp_path, before, words):
    """It comes after all that is trained."""
    options = unfinished(tmp_path / "m.checkpoint", preset("tiny", leave_out=before))
    flags = ("--device", "cpu", "--resume", "--leave-out", *words)
    result = call(train.main, data, "-o", tmp_path / "m.npz", *flags)
    assert result.code == 0, result.err
    asked = trainer.calls[0][1]
    assert {*asked.leave_out} == {*before, "isolation"}
    assert replace(asked, leave_out=before) == options


@pytest.mark.parametrize(
    "flags, run, sentence",
    [
        ([], None, "m.checkpoint to resume from"),
        (["--steps", 9], {}, "drop --steps"),
        (["--seed", 4], {}, "drop --seed"),
        (["--preset", "fast"], {}, "drop --preset"),
        (["--preset", "fast", "--steps", TINY_STEPS], {}, "drop --preset"),
        (["--scene-radius", 2], {}, "drop --scene-radius"),
        (["--spacing", 0.07], {}, "drop --spacing"),
        (["--aabb", 0, 0, 0, 1, 1, 1], {}, "drop --aabb"),
        (["--surroundings", "learnt"], {}, "drop --surroundings"),
        (["--no-view-dependence"], {}, "drop --no-view-dependence"),
        (["--leave-out", "distortion"], {}, "drop --leave-out"),
        (["--leave-out", "distortion", "isolation"], {}, "drop --leave-out"),
        ([], {"view_count": 4}, "had 4 views, up to 16x12 pixels, these are 3, up"),
        ([], {"image_size": (8, 6)}, "had 3 views, up to 8x6 pixels, these are 3, up to 16x12"),
    ],
)
def test_what_can_not_be_resumed_is_one_sentence(call, data, tmp_path, flags, run, sentence):
    if run is not None:
        unfinished(tmp_path / "m.checkpoint", **run)
    output = tmp_path / "m.npz"
    result = call(train.main, data, "-o", output, "--device", "cpu", "--resume", *flags)
    assert (result.code, result.out, result.err.count("\n")) == (INPUT_ERROR, "", 1)
    assert sentence in result.err


def test_a_state_that_does_not_fit_is_one_sentence(call, data, tmp_path):
    """The checkpoint is whole, but what it learned is of something else."""
    unfinished(tmp_path / "m.checkpoint")
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu", "--resume")
    assert result.code == INPUT_ERROR and result.err.count("\n") == 1
    assert "does not fit its own options and mesh" in result.err


def test_somebody_elses_file_is_not_taken_for_a_checkpoint(call, trainer, data, tmp_path, refused):
    """Where checkpoints go, a file of another program can be; it is never replaced."""
    theirs = tmp_path / "m.checkpoint"
    theirs.write_text("a diary")
    said = refused(call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu"))
    assert str(theirs) in said and "no checkpoint of this program" in said
    assert theirs.read_text() == "a diary" and not trainer.calls
