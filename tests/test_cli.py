"""The commands: what they pass on, and how they refuse what a user gets wrong."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from PIL import Image

from deformrf.core import cli
from deformrf.core.field import modelfile
from deformrf.core.training import DatasetError, preset
from deformrf.core.training.options import LEAVE_OUT, PRESETS


@pytest.fixture
def model(field, tmp_path):
    modelfile.save(field, tmp_path / "model.npz")
    return tmp_path / "model.npz"


def refused(result):
    """One sentence on stderr and exit code 2; the sentence."""
    assert result.code == cli.INPUT_ERROR
    assert result.err.count("\n") == 1 and result.err.endswith("\n"), result.err
    assert result.out == ""
    return result.err


def test_training_gets_data_options_and_device(call, trainer, data, tmp_path):
    flags = ("--preset", "fast", "--seed", 7, "--image-size", 15, "--device", "cpu")
    result = call(cli.train, data, "-o", tmp_path / "m.npz", *flags, "--scene-radius", 2)
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
    result = call(cli.train, data, "-o", tmp_path / "m.npz", *flags)
    assert "whole grid" in result.out
    options = trainer.calls[0][1]
    assert options == preset("default", fine_steps=50, leave_out=("coarse-stage", "subtet-mask"))


def test_help_names_all_that_can_be_left_out(call):
    shown = call(cli.train, "--help").out
    assert all(word in shown for word in LEAVE_OUT)


def test_training_writes_the_model_with_its_test_scores(call, trainer, data, tmp_path):
    output = tmp_path / "new" / "m.npz"
    result = call(cli.train, data, "-o", output, "--device", "cpu")
    meta = modelfile.load(output).meta
    assert meta["test_view_count"] == 2
    assert f"{meta['test_mean']['psnr']:.2f} dB" in result.out
    assert str(output) in result.out and "1.5 minutes" in result.out


def test_training_needs_no_test_split(call, trainer, data, tmp_path):
    (data / "transforms_test.json").unlink()
    result = call(cli.train, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == 0
    assert "dB" not in result.out
    assert "test_mean" not in modelfile.load(tmp_path / "m.npz").meta


def test_a_bad_test_split_is_found_before_training(call, trainer, data, tmp_path):
    scene = json.loads((data / "transforms_test.json").read_text())
    scene["frames"][1]["transform_matrix"] = "garbage"
    (data / "transforms_test.json").write_text(json.dumps(scene))
    result = call(cli.train, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert "transform_matrix of ./test/r_1.png" in refused(result)
    assert not trainer.calls


def test_missing_test_images_are_said_and_skipped(call, trainer, data, tmp_path):
    (data / "test" / "r_0.png").unlink()
    result = call(cli.train, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == 0
    assert "1 of 2 test images are missing and were skipped, first ./test/r_0.png" in result.err
    assert modelfile.load(tmp_path / "m.npz").meta["test_view_count"] == 1


def test_an_interrupted_training_writes_what_there_is(call, trainer, data, tmp_path):
    trainer.trained.interrupted = True
    result = call(cli.train, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert result.code == cli.INTERRUPTED
    assert "Stopped early; wrote what there is" in result.out
    modelfile.load(tmp_path / "m.npz")


def test_an_interrupted_training_keeps_an_older_model(call, trainer, data, tmp_path):
    trainer.trained.interrupted = True
    output = tmp_path / "m.npz"
    output.write_bytes(b"a model of an earlier run")
    result = call(cli.train, data, "-o", output, "--device", "cpu")
    assert result.code == cli.INTERRUPTED
    assert "m-interrupted.npz" in result.out
    assert output.read_bytes() == b"a model of an earlier run"
    modelfile.load(tmp_path / "m-interrupted.npz")


def test_a_lost_run_says_why_and_writes_its_last_good_weights(call, trainer, data, tmp_path):
    trainer.trained.diverged = "the loss became nan at step 48"
    result = call(cli.train, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert (result.code, result.err) == (
        cli.DIVERGED,
        "deformrf-train: the loss became nan at step 48\n",
    )
    modelfile.load(tmp_path / "m.npz")


def test_a_default_run_without_a_gpu_is_announced(call, trainer, data, tmp_path):
    for preset_name, announced in (("default", True), ("tiny", False)):
        output = tmp_path / f"{preset_name}.npz"
        result = call(cli.train, data, "-o", output, "--preset", preset_name, "--device", "cpu")
        assert ("takes minutes" in result.out) == announced


def test_images_in_which_nothing_is_found_are_one_sentence(call, trainer, data, monkeypatch):
    def train(*_, workers):
        raise DatasetError("stage 1 found nothing")

    monkeypatch.setattr(trainer, "train", train)
    result = call(cli.train, data, "-o", data / "m.npz", "--preset", "tiny", "--device", "cpu")
    assert "found nothing" in refused(result)


@pytest.mark.parametrize(
    "error, sentence",
    [
        (MemoryError("the GPU's memory is too small: take --preset tiny"), "take --preset tiny"),
        (MemoryError(), "the memory is too small"),
    ],
)
def test_a_lack_of_memory_is_one_sentence(call, trainer, data, monkeypatch, error, sentence):
    def train(*_, workers):
        raise error

    monkeypatch.setattr(trainer, "train", train)
    result = call(cli.train, data, "-o", data / "m.npz", "--preset", "tiny", "--device", "cpu")
    assert sentence in refused(result)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("steps", [2, 100, 10**6])
def test_steps_are_shared_out_between_the_stages(name, steps):
    options = cli.with_steps(preset(name), steps)
    assert options.coarse_steps + options.fine_steps == steps
    assert min(options.coarse_steps, options.fine_steps) >= 1


def test_the_command_line_knows_every_preset():
    assert set(get_args(cli.TrainArguments.__annotations__["preset"])) == set(PRESETS)


def test_evaluation_reports_each_view_and_the_mean(call, data, model, tmp_path):
    scores, images = tmp_path / "new" / "scores.json", tmp_path / "images"
    result = call(cli.evaluate, model, data, "--json", scores, "--images", images)
    assert result.code == 0
    report = json.loads(scores.read_text())
    assert [view["name"] for view in report["views"]] == ["r_0", "r_1"]
    for figure in ("psnr", "ssim"):
        values = [view[figure] for view in report["views"]]
        assert report["mean"][figure] == pytest.approx(np.mean(values))
    assert report["model"]["bytes"] == model.stat().st_size
    assert sorted(p.name for p in images.glob("*.png")) == ["000_r_0.png", "001_r_1.png"]
    assert "r_1" in result.out and "mean" in result.out


def test_evaluation_of_a_few_small_views(call, data, model, tmp_path):
    flags = ("--split", "train", "--views", 2, "--image-size", 15, "--json", tmp_path / "s.json")
    assert call(cli.evaluate, model, data, *flags).code == 0
    report = json.loads((tmp_path / "s.json").read_text())
    assert [view["name"] for view in report["views"]] == ["r_0", "r_2"]
    assert (report["sizes"], report["split"]) == (["15x11"], "train")


@pytest.mark.parametrize(
    "asked, kept, color, said",
    [
        ("auto", False, (100, 100, 100, 255), True),
        ("learnt", False, (255, 255, 255, 255), True),
        ("auto", True, (100, 100, 100, 255), False),
        ("auto", False, (100, 100, 100, 0), False),
        ("auto", False, (255, 255, 255, 255), False),
        ("white", False, (100, 100, 100, 255), False),
        (None, False, (100, 100, 100, 255), True),
    ],
    ids=["photograph", "asked for", "kept", "alpha", "white border", "white", "older file"],
)
def test_surroundings_that_a_model_has_not_kept_are_said(
    call, field, write_dataset, tmp_path, asked, kept, color, said
):
    from deformrf.core.training.run.surroundings import random_surroundings

    write_dataset(tmp_path / "data", [Image.new("RGBA", (16, 12), color)])
    around = random_surroundings(np.array([[0.0] * 3, [1.0] * 3])) if kept else None
    meta = {"options": {"surroundings": asked}} if asked else {}
    modelfile.save(replace(field, surroundings=around, meta=meta), tmp_path / "m.npz")
    result = call(cli.evaluate, tmp_path / "m.npz", tmp_path / "data", "--device", "cpu")
    assert result.code == 0
    assert ("--keep-surroundings" in result.err) == said


def change_meta(path, **changes):
    with np.load(path) as archive:
        arrays = dict(archive)
    meta = json.dumps({**json.loads(arrays["meta"].tobytes()), **changes})
    meta = meta.replace('"NESTED"', "[" * 20_000 + "]" * 20_000)
    np.savez(path, **{**arrays, "meta": np.frombuffer(meta.encode(), np.uint8)})


@pytest.mark.parametrize(
    "training",
    [
        None,
        ["a list"],
        {"seconds": None, "history": 7, "peak_memory_bytes": [None], "options": [1]},
        {"seconds": "long", "test_mean": "good", "levels_below_pixel": {}, "device": [1]},
        {"seconds": 10**400, "peak_memory_bytes": "much", "options": None},
        {"seconds": float("nan"), "stage_1_seconds": float("inf"), "levels_below_pixel": [0.5]},
    ],
    ids=["null", "list", "wrong types", "more wrong types", "huge", "no numbers"],
)
def test_a_model_with_a_malformed_training_entry_is_evaluated(call, data, model, training):
    change_meta(model, training=training)
    result = call(cli.evaluate, model, data, "--device", "cpu", "--json", data / "scores.json")
    assert result.code == 0
    assert not [key for key in facts(data / "scores.json") if key.startswith("training_")]


def facts(path):
    return json.loads(path.read_text())["model"]


@pytest.mark.parametrize(
    "spoil, sentence",
    [
        (lambda data, model: model.unlink(), "no model file at"),
        (lambda data, model: model.write_text("not a zip"), "not a model file"),
        (lambda data, model: change_meta(model, format_version=99), "format version 99"),
        (lambda data, model: change_meta(model, training="NESTED"), "nests too deeply"),
        (lambda data, model: (data / "transforms_test.json").unlink(), "transforms_test.json"),
        (lambda data, model: shutil.rmtree(data / "test"), "none of the 2 images"),
    ],
    ids=["missing", "no model", "version", "nested", "no transforms", "images missing"],
)
def test_bad_input_to_evaluation_is_one_sentence(call, data, model, spoil, sentence):
    spoil(data, model)
    assert sentence in refused(call(cli.evaluate, model, data, "--device", "cpu"))


def test_missing_images_are_said_and_skipped(call, data, model):
    (data / "test" / "r_1.png").unlink()
    result = call(cli.evaluate, model, data, "--device", "cpu")
    assert result.code == 0
    assert "1 of 2 test images are missing and were skipped, first ./test/r_1.png" in result.err


@pytest.mark.parametrize(
    "flags, sentence",
    [
        (["--image-size", 8], "at least 11x11 pixels"),
        (["--views", 0], "number of views is 0"),
        (["--split", "tset"], "--split is 'tset'; give train, val, test"),
        (["--split", "val"], "holds no transforms_val.json"),
        (["--json", "scores.txt"], "has to end in .json"),
        (["--step-factor", 0], "--step-factor is 0"),
    ],
)
def test_bad_flags_of_evaluation_are_one_sentence(call, data, model, flags, sentence):
    assert sentence in refused(call(cli.evaluate, model, data, *flags))


@pytest.mark.parametrize(
    "flags, sentence",
    [
        (["-o", "model.txt"], "has to end in .npz"),
        (["-o", "m.npz", "--steps", 1], "--steps is 1: it has to be at least 2"),
        (["-o", "m.npz", "--seed", -1], "--seed is -1: it has to be at least 0"),
        (["-o", "m.npz", "--image-size", 0], "image size is 0"),
        (["-o", "m.npz", "--scene-radius", 0], "--scene-radius is 0.0"),
        (
            ["-o", "m.npz", "--leave-out", "distortion", "stage"],
            "no 'stage' to leave out; choose from coarse-stage, subtet-mask, dense-levels, ",
        ),
    ],
)
def test_bad_flags_of_training_are_one_sentence(call, trainer, data, flags, sentence):
    assert sentence in refused(call(cli.train, data, *flags, "--device", "cpu"))
    assert not trainer.calls


def test_an_empty_data_folder_is_one_sentence(call, tmp_path):
    result = call(cli.train, tmp_path, "-o", tmp_path / "m.npz")
    assert "holds no transforms_train.json" in refused(result)


def test_a_folder_as_output_is_one_sentence(call, data, tmp_path):
    (tmp_path / "m.npz").mkdir()
    result = call(cli.train, data, "-o", tmp_path / "m.npz", "--device", "cpu")
    assert "is a folder" in refused(result)


def test_output_below_a_file_is_one_sentence(call, data, tmp_path):
    (tmp_path / "file").write_text("")
    result = call(cli.train, data, "-o", tmp_path / "file" / "m.npz", "--device", "cpu")
    assert str(tmp_path / "file") in refused(result)


def test_a_device_that_is_not_there_is_one_sentence(call, data, model, monkeypatch):
    monkeypatch.setattr("warp.is_cuda_available", lambda: False)
    assert "no CUDA device" in refused(call(cli.evaluate, model, data, "--device", "cuda"))


def test_a_command_says_one_sentence_and_nothing_else(data, tmp_path):
    """In a process of its own, where C++ libraries could speak up too."""
    program = "from deformrf.core.cli import evaluate; evaluate()"
    command = [sys.executable, "-c", program, tmp_path / "no.npz", data]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == f"deformrf-eval: there is no model file at {tmp_path / 'no.npz'}\n"


def test_ctrl_c_exits_with_130_and_says_so(capsys):
    def interrupted():
        raise KeyboardInterrupt

    assert cli.run("deformrf-x", lambda: interrupted) == 130
    assert capsys.readouterr().err == "deformrf-x: interrupted\n"


def test_of_several_processes_the_first_one_speaks(capsys, monkeypatch):
    """torchrun ends the others when it is gone."""

    def mistaken():
        raise DatasetError("no data")

    def interrupted(seconds=0.0):
        raise KeyboardInterrupt

    monkeypatch.setattr("time.sleep", interrupted)
    for rank, sentences in (("0", ["no data", "interrupted"]), ("1", [])):
        monkeypatch.setenv("RANK", rank)
        codes = [cli.run("x", prepare) for prepare in (mistaken, interrupted)]
        assert codes == [cli.INPUT_ERROR, cli.INTERRUPTED]
        assert capsys.readouterr().err == "".join(f"x: {sentence}\n" for sentence in sentences)


def test_a_process_says_an_error_that_the_first_one_has_not(capsys, monkeypatch):
    """Such as more processes than GPUs, or too little memory in one of them."""

    def job():
        raise MemoryError("the GPU of worker 1 has too little memory")

    monkeypatch.setenv("RANK", "1")
    monkeypatch.setattr(cli, "FIRST_SECONDS", 0.0)
    assert cli.run("x", lambda: job) == cli.INPUT_ERROR
    assert capsys.readouterr().err == "x: the GPU of worker 1 has too little memory\n"


def test_a_fault_of_the_program_keeps_its_traceback():
    def job():
        raise ValueError("a bug")

    with pytest.raises(ValueError, match="a bug"):
        cli.run("deformrf-x", lambda: job)


@pytest.mark.parametrize("command", [cli.train, cli.evaluate])
def test_help_lists_every_flag(call, command):
    result = call(command, "--help")
    assert result.code == 0
    for flag in ("--device", "--image-size"):
        assert flag in result.out


def test_unknown_flags_exit_with_2(call):
    assert call(cli.train, Path(), "-o", "m.npz", "--fast").code == 2
