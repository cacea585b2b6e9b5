"""deformrf eval: the scores and files that it writes, and what it refuses."""

import errno
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deformrf.commands import evaluate
from deformrf.commands.running import INPUT_ERROR
from deformrf.core.field import modelfile
from deformrf.core.training import evaluation


@pytest.fixture
def model(field, tmp_path):
    modelfile.save(field, tmp_path / "model.npz")
    return tmp_path / "model.npz"


def test_evaluation_reports_each_view_and_the_mean(call, data, model, tmp_path):
    scores, images = tmp_path / "new" / "scores.json", tmp_path / "images"
    result = call(evaluate.main, model, data, "-o", scores, "--pictures", images)
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
    flags = ("--split", "train", "--views", 2, "--image-size", 15, "-o", tmp_path / "s.json")
    assert call(evaluate.main, model, data, *flags).code == 0
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
def test_evaluation_says_that_a_model_lacks_its_surroundings(
    call, field, write_dataset, tmp_path, asked, kept, color, said
):
    from deformrf.core.training.run.surroundings import random_surroundings

    write_dataset(tmp_path / "data", [Image.new("RGBA", (16, 12), color)])
    around = random_surroundings(np.array([[0.0] * 3, [1.0] * 3])) if kept else None
    meta = {"options": {"surroundings": asked}} if asked else {}
    modelfile.save(replace(field, surroundings=around, meta=meta), tmp_path / "m.npz")
    result = call(evaluate.main, tmp_path / "m.npz", tmp_path / "data", "--device", "cpu")
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
        {"seconds": "long", "test_mean": "good", "levels_left_out": {}, "device": [1]},
        {"seconds": 10**400, "peak_memory_bytes": "much", "options": None},
        {"seconds": float("nan"), "stage_1_seconds": float("inf"), "levels_left_out": None},
    ],
    ids=["null", "list", "wrong types", "more wrong types", "huge", "no numbers"],
)
def test_a_model_with_a_malformed_training_entry_is_evaluated(call, data, model, training):
    change_meta(model, training=training)
    result = call(evaluate.main, model, data, "--device", "cpu", "-o", data / "scores.json")
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
        (lambda data, model: shutil.rmtree(data / "test"), "none of the 2 test images"),
    ],
    ids=["missing", "no model", "version", "nested", "no transforms", "images missing"],
)
def test_bad_input_to_evaluation_ends_in_one_sentence(call, data, model, spoil, sentence, refused):
    spoil(data, model)
    assert sentence in refused(call(evaluate.main, model, data, "--device", "cpu"))


def test_missing_images_are_reported_and_skipped(call, data, model):
    (data / "test" / "r_1.png").unlink()
    result = call(evaluate.main, model, data, "--device", "cpu")
    assert result.code == 0
    assert "1 of 2 test images are missing and were skipped, first ./test/r_1.png" in result.err


@pytest.mark.parametrize(
    "flags, sentence",
    [
        (["--image-size", 8], "at least 11x11 pixels"),
        (["--views", 0], "number of views is 0"),
        (["--split", "tset"], "--split: invalid choice: 'tset' (choose from"),
        (["--split", "val"], "holds no transforms_val.json"),
        (["-o", "scores.txt"], "has to end in .json"),
        (["--step-factor", 0], "--step-factor is 0"),
    ],
)
def test_bad_flags_of_evaluation_end_in_one_sentence(call, data, model, flags, sentence, refused):
    assert sentence in refused(call(evaluate.main, model, data, *flags))


def test_a_device_that_is_missing_is_refused(call, data, model, monkeypatch, refused):
    monkeypatch.setattr("warp.is_cuda_available", lambda: False)
    assert "no CUDA device" in refused(call(evaluate.main, model, data, "--device", "cuda"))


def test_a_command_prints_one_sentence_and_nothing_else(data, tmp_path):
    """In a process of its own, where C++ libraries may print too."""
    program = "import sys; from deformrf.commands.evaluate import main; sys.exit(main())"
    command = [sys.executable, "-c", program, tmp_path / "no.npz", data]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == f"deformrf eval: there is no model file at {tmp_path / 'no.npz'}\n"


@pytest.mark.parametrize("name", ["report.json", "001_r_1.png"])
def test_images_never_overwrite_a_file_of_another_program(call, data, model, name, refused):
    """Such as the report of deformrf report."""
    path = data / "results" / name
    path.parent.mkdir()
    path.write_text('{"format": "deformrf-report", "sections": {}}')
    before = path.read_bytes()
    result = call(evaluate.main, model, data, "--device", "cpu", "--pictures", path.parent)
    assert f"{path} exists and is not a file of deformrf eval" in refused(result)
    assert path.read_bytes() == before


def test_scores_never_overwrite_the_data_set(call, data, model, refused):
    path = data / "transforms_test.json"
    before = path.read_bytes()
    result = call(evaluate.main, model, data, "--device", "cpu", "-o", path)
    assert f"{path} exists and is not a file of deformrf eval" in refused(result)
    assert path.read_bytes() == before


def test_its_own_files_are_written_again(call, data, model, tmp_path):
    flags = ("--device", "cpu", "--pictures", tmp_path / "a", "-o", tmp_path / "a.json")
    for _ in range(2):
        assert call(evaluate.main, model, data, *flags).code == 0


def test_files_of_a_killed_run_are_written_again(call, data, model, tmp_path, monkeypatch):
    """A killed run writes no more files after its first picture."""
    folder = tmp_path / "a"
    flags = ("--device", "cpu", "--pictures", folder)
    with monkeypatch.context() as patch:
        patch.setattr(evaluation, "score_view", killed)
        with pytest.raises(Killed):
            call(evaluate.main, model, data, *flags)
    assert list(folder.glob("*.png"))
    assert not json.loads((folder / "report.json").read_text())["complete"]
    assert call(evaluate.main, model, data, *flags).code == 0
    assert json.loads((folder / "report.json").read_text())["complete"]


class Killed(Exception):
    pass


def killed(*_):
    raise Killed


def test_an_empty_file_may_become_the_scores(call, data, model, tmp_path):
    path = tmp_path / "a.json"
    path.touch()
    assert call(evaluate.main, model, data, "--device", "cpu", "-o", path).code == 0
    assert len(json.loads(path.read_text())["views"]) == 2


def test_a_full_disk_costs_pictures_and_no_scores(call, data, model, tmp_path, monkeypatch):
    def full_disk(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", full_disk)
    flags = ("--device", "cpu", "--pictures", tmp_path / "a", "-o", tmp_path / "a.json")
    result = call(evaluate.main, model, data, *flags)
    assert result.code == INPUT_ERROR
    picture = tmp_path / "a" / "000_r_0.png"
    assert result.err.endswith(f"deformrf eval: can't write {picture}: No space left on device\n")
    assert "mean" in result.out
    for path in (tmp_path / "a.json", tmp_path / "a" / "report.json"):
        assert len(json.loads(path.read_text())["views"]) == 2
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["report.json"]


def test_scores_that_can_not_be_written_are_still_printed(call, data, model, tmp_path, monkeypatch):
    def full_disk(self, *_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full_disk)
    path = tmp_path / "a.json"
    result = call(evaluate.main, model, data, "--device", "cpu", "-o", path)
    assert (result.code, "mean" in result.out) == (INPUT_ERROR, True)
    assert result.err.endswith(f"deformrf eval: can't write {path}: No space left on device\n")
    assert not path.exists()


def test_a_plain_model_is_scored_without_torch(call, data, model, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    assert call(evaluate.main, model, data, "--device", "cpu").code == 0


def test_a_model_with_surroundings_needs_torch(call, field, data, tmp_path, monkeypatch, refused):
    from deformrf.core.training.run.surroundings import random_surroundings

    around = random_surroundings(np.array([[0.0] * 3, [1.0] * 3]))
    modelfile.save(replace(field, surroundings=around), tmp_path / "m.npz")
    monkeypatch.setitem(sys.modules, "torch", None)
    result = call(evaluate.main, tmp_path / "m.npz", data, "--device", "cpu")
    assert 'torch, which trains models, is not installed: pip install ".[train]"' in refused(result)
