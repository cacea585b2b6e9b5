"""deformrf train: what it passes to training, what it writes, what it refuses."""

import errno
import json
import re
import shutil
from pathlib import Path
from typing import get_args

import ball_photos
import numpy as np
import pytest
from gray_photographs import gray_photographs
from PIL import Image

from deformrf.commands import train, train_choices
from deformrf.commands.running import FAILED, INPUT_ERROR, INTERRUPTED
from deformrf.core.field import modelfile
from deformrf.core.render import look_at
from deformrf.core.training import LEAVE_OUT, DatasetError, preset
from deformrf.core.training.data import datasets
from deformrf.core.training.train_options import PRESETS


def test_training_gets_data_options_and_device(call, trainer, data, tmp_path):
    flags = ("--preset", "fast", "--seed", 7, "--image-size", 15, "--device", "cpu")
    result = call(train.main, data, "-o", tmp_path / "m.npz", *flags, "--scene-radius", 2)
    assert (result.code, result.err) == (0, "")
    [(views, options, device, name, checkpoint_path, resumed)] = trainer.calls
    assert (views.split, views.view_count) == ("train", 3)
    assert {(lens.width, lens.height) for lens in views.lenses} == {(15, 11)}
    assert options == preset("fast", seed=7, scene_radius=2.0)
    assert (device, name) == ("cpu", "data")
    assert (checkpoint_path, resumed) == (tmp_path / "m.checkpoint", None)


def test_what_is_left_out_reaches_the_trainer(call, trainer, data, tmp_path):
    """All steps are those of the one stage, and the user learns what the model then holds."""
    flags = ("--steps", 50, "--leave-out", "coarse-stage", "subtet-mask", "--device", "cpu")
    result = call(train.main, data, "-o", tmp_path / "m.npz", *flags)
    assert "whole grid" in result.out
    options = trainer.calls[0][1]
    assert options == preset("default", fine_steps=50, leave_out=("coarse-stage", "subtet-mask"))


def test_help_names_all_that_can_be_left_out(call):
    shown = call(train.main, "--help").out
    assert all(word in shown for word in LEAVE_OUT)


def test_training_writes_the_model_with_its_test_scores(call, trainer, data, tmp_path):
    output = tmp_path / "new" / "m.npz"
    result = call(train.main, data, "-o", output, "--device", "cpu")
    meta = modelfile.load(output).meta
    assert meta["test_view_count"] == 2
    assert f"{meta['test_mean']['psnr']:.2f} dB" in result.out
    assert str(output) in result.out and "1.5 minutes" in result.out


def test_a_model_states_the_size_that_was_given(call, trainer, data, tmp_path):
    output = tmp_path / "m.npz"
    call(train.main, data, "-o", output, "--device", "cpu", "--object-size", 0.3)
    assert modelfile.load(output).meta["size"] == 0.3
    call(train.main, data, "-o", output, "--device", "cpu")
    assert "size" not in modelfile.load(output).meta


def test_what_was_cut_off_is_kept_beside_the_model(call, trainer, data, tmp_path, field):
    """Another run of the same model replaces it; what is another's stays."""
    trainer.trained.uncut, trainer.trained.left_out = field, 0.12
    output, whole = tmp_path / "m.npz", tmp_path / "m-whole.npz"
    result = call(train.main, data, "-o", output, "--device", "cpu")
    assert "12% of the matter" in result.out and f"{whole} has all" in result.out
    assert modelfile.load(whole).mesh.tet_count == field.mesh.tet_count
    call(train.main, data, "-o", output, "--device", "cpu")
    assert not (tmp_path / "m-whole-2.npz").exists()
    whole.write_bytes(b"another's")
    result = call(train.main, data, "-o", output, "--device", "cpu")
    assert whole.read_bytes() == b"another's" and "m-whole-2.npz has all" in result.out
    modelfile.load(tmp_path / "m-whole-2.npz")


@pytest.mark.parametrize("edited", [False, True])
def test_what_is_kept_of_an_earlier_model_goes_with_it(
    call, trainer, data, tmp_path, field, edited
):
    """Unless somebody has edited it: then it is the user's."""
    trainer.trained.uncut = field
    output, whole = tmp_path / "m.npz", tmp_path / "m-whole.npz"
    call(train.main, data, "-o", output, "--device", "cpu")
    if edited:
        modelfile.save(modelfile.load(whole), whole)
        content = whole.read_bytes()
        result = call(train.main, data, "-o", output, "--device", "cpu")
        assert whole.read_bytes() == content and "m-whole-2.npz has all" in result.out
    trainer.trained.uncut = None
    result = call(train.main, data, "-o", output, "--device", "cpu")
    assert whole.exists() == edited
    assert (f"Removed {whole}, which was of an earlier model" in result.out) != edited


def test_nothing_is_kept_beside_a_model_that_has_all(call, trainer, data, tmp_path, field):
    trainer.trained.uncut = field
    flags = "--device", "cpu", "--keep-surroundings"
    result = call(train.main, data, "-o", tmp_path / "m.npz", *flags)
    assert "Left out" not in result.out and not (tmp_path / "m-whole.npz").exists()


def test_training_needs_no_test_split(call, trainer, data, tmp_path):
    (data / "transforms_test.json").unlink()
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == 0
    assert "dB" not in result.out
    assert "test_mean" not in modelfile.load(tmp_path / "m.npz").meta


def test_an_empty_test_split_is_no_test_split(call, trainer, data, tmp_path):
    (data / "transforms_test.json").write_text('{"camera_angle_x": 0.7, "frames": []}')
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == 0
    assert "test_mean" not in modelfile.load(tmp_path / "m.npz").meta


def test_a_bad_test_split_is_found_before_training(call, trainer, data, tmp_path, refused):
    scene = json.loads((data / "transforms_test.json").read_text())
    scene["frames"][1]["transform_matrix"] = "garbage"
    (data / "transforms_test.json").write_text(json.dumps(scene))
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert "transform_matrix of ./test/r_1.png" in refused(result)
    assert not trainer.calls


def test_missing_test_images_are_reported_and_skipped(call, trainer, data, tmp_path):
    (data / "test" / "r_0.png").unlink()
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == 0
    assert "1 of 2 test images are missing and were skipped, first ./test/r_0.png" in result.err
    assert modelfile.load(tmp_path / "m.npz").meta["test_view_count"] == 1


def test_an_interrupted_training_writes_the_unfinished_model(call, trainer, data, tmp_path):
    trainer.trained.interrupted = True
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == INTERRUPTED
    assert "Stopped early; wrote the unfinished model: " in result.out
    modelfile.load(tmp_path / "m.npz")


def test_an_interrupted_training_keeps_an_older_model(call, trainer, data, tmp_path):
    trainer.trained.interrupted = True
    output = tmp_path / "m.npz"
    output.write_bytes(b"a model of an earlier run")
    result = call(train.main, data, "-o", output, "--device", "cpu")
    assert result.code == INTERRUPTED
    assert "m-interrupted.npz" in result.out
    assert output.read_bytes() == b"a model of an earlier run"
    modelfile.load(tmp_path / "m-interrupted.npz")


def test_a_diverged_run_says_why_and_writes_its_last_good_weights(call, trainer, data, tmp_path):
    trainer.trained.diverged = "the loss became nan at step 48"
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert (result.code, result.err) == (
        FAILED,
        "deformrf train: the loss became nan at step 48\n",
    )
    modelfile.load(tmp_path / "m.npz")


def test_a_default_run_without_a_gpu_is_announced(call, trainer, data, tmp_path):
    for preset_name, announced in (("default", True), ("tiny", False)):
        output = tmp_path / f"{preset_name}.npz"
        result = call(train.main, data, "-o", output, "--preset", preset_name, "--device", "cpu")
        assert ("takes minutes" in result.out) == announced


def test_a_run_that_finds_nothing_ends_in_one_sentence(call, trainer, data, monkeypatch, refused):
    def fail(*_, workers, on_pause):
        raise DatasetError("stage 1 found nothing")

    monkeypatch.setattr(trainer, "train", fail)
    result = call(train.main, data, "-o", data / "m.npz", "--preset", "tiny", "--device", "cpu")
    assert "found nothing" in refused(result)


@pytest.mark.parametrize("flag", ["--seed", "--steps"])
def test_a_number_that_is_too_large_is_said(call, trainer, data, tmp_path, flag, refused):
    number = "9" * 20
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu", flag, number)
    assert f"{flag} is {number}: it has to be at most" in refused(result)
    assert not trainer.calls


@pytest.mark.parametrize(
    "error, sentence",
    [
        (MemoryError("the GPU's memory is too small: take --preset tiny"), "take --preset tiny"),
        (MemoryError(), "the memory is too small"),
    ],
)
def test_a_lack_of_memory_ends_in_one_sentence(
    call, trainer, data, monkeypatch, error, sentence, refused
):
    def fail(*_, workers, on_pause):
        raise error

    monkeypatch.setattr(trainer, "train", fail)
    result = call(train.main, data, "-o", data / "m.npz", "--preset", "tiny", "--device", "cpu")
    assert sentence in refused(result)


def test_a_last_look_without_memory_writes_the_model_and_says_so(call, trainer, data, tmp_path):
    trainer.trained.out_of_memory = "the GPU's memory is too small; the model keeps sub-tets"
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == INPUT_ERROR
    assert result.err == f"deformrf train: {trainer.trained.out_of_memory}\n"
    modelfile.load(tmp_path / "m.npz")


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("steps", [2, 100, 10**6])
def test_steps_are_shared_out_between_the_stages(name, steps):
    options = train_choices.with_steps(preset(name), steps)
    assert options.coarse_steps + options.fine_steps == steps
    assert min(options.coarse_steps, options.fine_steps) >= 1


def test_surroundings_take_steps_from_the_default_preset_alone():
    """As long as nobody says how many steps there are."""

    def count(views, **given):
        arguments = train.TrainArguments(Path("data"), Path("m.npz"), **given)
        options = train_choices.train_options(arguments)
        options = train_choices.for_views(options, arguments, views)
        return options.coarse_steps + options.fine_steps

    photographs, cut_out = ball_photos.photographs(), gray_photographs(alpha=128)
    assert count(photographs) == 17_100
    assert count(cut_out) == count(photographs, surroundings="white") == 22_500
    assert count(photographs, steps=500) == 500
    assert count(photographs, preset="fast") == 13_000


def test_the_command_line_knows_every_preset():
    assert set(get_args(train.TrainArguments.__annotations__["preset"])) == set(PRESETS)


@pytest.mark.parametrize(
    "flags, sentence",
    [
        (["-o", "model.txt"], "has to end in .npz"),
        (["-o", "m.npz", "--steps", 1], "--steps is 1: it has to be at least 2"),
        (["-o", "m.npz", "--seed", -1], "--seed is -1: it has to be at least 0"),
        (["-o", "m.npz", "--image-size", 0], "image size is 0"),
        (["-o", "m.npz", "--scene-radius", 0], "--scene-radius is 0.0"),
        (["-o", "m.npz", "--spacing", 0.001], "--spacing is 0.001: it has to be from 0.005 to"),
        (
            ["-o", "m.npz", "--object-size", "inf"],
            "--object-size is inf: it has to be from 0.0001 to 10000 m",
        ),
        (
            ["-o", "m.npz", "--leave-out", "distortion", "stage"],
            "no 'stage' to leave out; choose from coarse-stage, subtet-mask, dense-levels, ",
        ),
    ],
)
def test_bad_flags_of_training_end_in_one_sentence(call, trainer, data, flags, sentence, refused):
    assert sentence in refused(call(train.main, data, *flags, "--device", "cpu"))
    assert not trainer.calls


def test_images_outside_the_data_set_are_read_if_that_is_asked_for(
    call, trainer, data, tmp_path, refused
):
    for split in ("train", "test"):  # of the one, training reads; of the other, the scores
        (data / split).rename(tmp_path / f"all of {split}")
        (data / split).symlink_to(tmp_path / f"all of {split}")
        command = train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu"
        assert "r_0.png lies outside the data set's folder" in refused(call(*command))
        assert call(*command, "--outside-images").code == 0


def test_an_empty_data_folder_is_refused(call, tmp_path, refused):
    result = call(train.main, tmp_path, "-o", tmp_path / "m.npz")
    assert "holds no transforms_train.json" in refused(result)


def test_a_folder_as_output_is_refused(call, data, tmp_path, refused):
    (tmp_path / "m.npz").mkdir()
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert "is a folder" in refused(result)


def test_output_below_a_file_is_refused(call, data, tmp_path, refused):
    (tmp_path / "file").write_text("")
    result = call(train.main, data, "-o", tmp_path / "file" / "m.npz", "--device", "cpu")
    assert str(tmp_path / "file") in refused(result)


def test_unknown_flags_exit_with_2(call):
    assert call(train.main, Path(), "-o", "m.npz", "--fast").code == 2


def test_training_goes_on_without_scores_where_test_images_are_missing(
    call, trainer, data, tmp_path
):
    shutil.rmtree(data / "test")
    result = call(train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == 0
    assert "The model will not be scored: none of the 2 test images is there" in result.err
    assert "test_mean" not in modelfile.load(tmp_path / "m.npz").meta


def test_more_pixels_than_can_be_trained_on_are_refused_before_memory_is_taken(
    call, trainer, tmp_path, monkeypatch, refused
):
    """26 photographs of 84 million pixels; the sentence says what fits."""
    (tmp_path / "train").mkdir()
    Image.new("1", (12000, 7000)).save(tmp_path / "train" / "r_0.png")
    frames = [
        {"file_path": "train/r_0", "transform_matrix": look_at((4, 0, i), (0, 0, 0)).tolist()}
        for i in range(26)
    ]
    scene = {"camera_angle_x": 0.7, "frames": frames}
    (tmp_path / "transforms_train.json").write_text(json.dumps(scene))
    monkeypatch.setattr(datasets, "read_images", lambda *_: pytest.fail("memory is taken"))
    sentence = refused(call(train.main, tmp_path, "-o", tmp_path / "m.npz", "--device", "cpu"))
    assert "26 training images have 2.18 billion pixels together" in sentence
    size = int(re.search(r"--image-size (\d+)", sentence)[1])
    for longest, fits in ((size, True), (size + 1, False)):
        width, height = datasets.shrunk_size((12000, 7000), longest)
        assert (26 * width * height < 2**31) == fits


def test_images_that_do_not_fit_into_memory_are_refused_before_it_is_taken(
    call, trainer, data, tmp_path, monkeypatch, refused
):
    """Three images of 16x12 pixels and 4.5 kB that are free; the sentence says what fits."""
    command = train.main, data, "-o", tmp_path / "m.npz", "--device", "cpu"
    monkeypatch.setattr(datasets, "free_bytes", lambda: 4500)
    sentence = refused(call(*command))
    assert "the 3 images take 0.00 GB of memory, and 0.00 GB are free" in sentence
    size = re.search(r"--image-size (\d+)", sentence)[1]
    assert size == "15"  # 15x11: 12 bytes for each of 192 pixels, and 4 for each of 3 * 165
    assert call(*command, "--image-size", size).code == 0
    assert "--image-size 15, or less" in refused(call(*command, "--image-size", 16))
    monkeypatch.setattr(datasets, "free_bytes", lambda: 2000)
    assert "end other programs" in refused(call(*command))


def full_disk(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_leaves_the_checkpoint_and_says_so(call, trainer, data, tmp_path, monkeypatch):
    monkeypatch.setattr(np, "savez_compressed", full_disk)
    output, checkpoint_path = tmp_path / "m.npz", tmp_path / "m.checkpoint"
    checkpoint_path.write_text("PK deformrf-checkpoint-1: the run")
    trainer.trained.resumable = True
    result = call(train.main, data, "-o", output, "--preset", "tiny", "--device", "cpu")
    assert result.code == INPUT_ERROR
    assert result.err == (
        f"deformrf train: can't write {output}: No space left on device; the run is kept in "
        f"{checkpoint_path}: make room, then add --resume\n"
    )
    assert checkpoint_path.read_text().endswith("the run")
    assert not output.exists()


def test_a_full_disk_without_a_checkpoint_promises_none(call, trainer, data, tmp_path, monkeypatch):
    """A file that another run left is not this run's checkpoint."""
    monkeypatch.setattr(np, "savez_compressed", full_disk)
    (tmp_path / "m.checkpoint").write_text("PK deformrf-checkpoint-1: another run")
    trainer.trained.interrupted = True
    output = tmp_path / "m.npz"
    result = call(train.main, data, "-o", output, "--preset", "tiny", "--device", "cpu")
    assert result.err == (
        f"deformrf train: can't write {output}: No space left on device; the run has no "
        f"checkpoint to continue from\n"
    )


def test_a_model_that_can_not_be_written_goes_to_a_second_place(
    call, trainer, data, tmp_path, monkeypatch
):
    """The folder of --output is full; the user's own one has room."""
    savez = np.savez

    def full_there(stream, **arrays):
        return full_disk() if str(tmp_path / "out") in stream.name else savez(stream, **arrays)

    monkeypatch.setattr(np, "savez_compressed", full_there)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    output = tmp_path / "out" / "m.npz"
    result = call(train.main, data, "-o", output, "--preset", "tiny", "--device", "cpu")
    assert result.code == INPUT_ERROR
    place = tmp_path / "state" / "deformrf" / "models" / "m.npz"
    assert result.err == (
        f"deformrf train: can't write {output}: No space left on device; the model is in "
        f"{place}, without scores\n"
    )
    assert modelfile.load(place).mesh.tet_count == trainer.trained.field.mesh.tet_count


def test_a_disk_that_fills_before_the_scores_are_written_leaves_the_model(
    call, trainer, data, tmp_path, monkeypatch
):
    savez, output = np.savez, tmp_path / "m.npz"

    def full_at_second(*arguments, **arrays):
        return full_disk() if output.exists() else savez(*arguments, **arrays)

    monkeypatch.setattr(np, "savez_compressed", full_at_second)
    result = call(train.main, data, "-o", output, "--preset", "tiny", "--device", "cpu")
    assert result.code == INPUT_ERROR
    assert result.err.endswith(f"can't add the scores to {output}: No space left on device\n")
    modelfile.load(output)
