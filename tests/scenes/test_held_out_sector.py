"""A sector that training holds out: what is trained on, kept in the model, scored and reported."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deformrf.commands import evaluate, train
from deformrf.core import training as core_training
from deformrf.core.field import modelfile
from deformrf.core.render import look_at, rows_of_views
from deformrf.core.training import Sector, load_dataset
from deformrf.wings.lab import training

SIZE = 16, 12


@pytest.fixture
def around(tmp_path, write_dataset):
    """24 gray training views around an object, and 8 test views between them."""
    for split, count, begin in (("train", 24, 0.0), ("test", 8, 7.5)):
        angles = np.radians(begin + 360.0 * np.arange(count) / count)
        poses = [look_at((4 * np.cos(a), 4 * np.sin(a), 1.0), (0, 0, 0)) for a in angles]
        images = [Image.new("RGBA", SIZE, (100, 100, 100, 255))] * count
        write_dataset(tmp_path / "data", images, split, poses=poses)
    return tmp_path / "data"


@pytest.fixture
def model(around, trainer, field, tmp_path):
    """A model file as `trainer` would have trained it, which from now on it gives."""
    from deformrf.core.training import find_sector

    sector = find_sector(around)
    views = load_dataset(around, "train", sector=sector)
    meta = {"views": rows_of_views(views.poses, views.lenses), **sector.as_report()}
    trainer.trained.field = replace(field, meta=meta)
    modelfile.save(trainer.trained.field, tmp_path / "m.npz")
    return tmp_path / "m.npz"


FLAGS = "--device", "cpu", "--hold-out", "sector"


def test_the_others_are_trained_on_and_the_user_is_told_which(call, trainer, model, around):
    result = call(train.main, around, "-o", model, *FLAGS)
    assert result.code == 0
    [(views, *_)] = trainer.calls
    assert views.names == tuple(f"r_{i}" for i in range(4, 24))
    assert views.sector.views == tuple(f"train/r_{i}.png" for i in range(4))
    assert result.err == (
        "Held out: 4 training views, those from 0° to 60° around the object, counterclockwise from "
        "above; the first training view is at 0°.\n"
    )


def test_a_model_keeps_the_scores_of_the_sector_and_of_test_views(call, model, around):
    """The test views are at 7.5° + k · 45°, two of eight in the sector of 0° to 60°."""
    result = call(train.main, around, "-o", model, *FLAGS)
    meta = modelfile.load(model).meta
    scores = meta["sector_scores"]
    counts = {name: part["view_count"] for name, part in scores.items()}
    assert counts == {"held_out": 4, "test_inside": 2, "test_outside": 6}
    assert meta["test_view_count"] == 8
    middle = flat_angle(30.0)
    assert scores["held_out"]["angles"]["largest"] == pytest.approx(middle, abs=0.05)
    assert scores["test_inside"]["angles"]["largest"] == pytest.approx(flat_angle(22.5), abs=0.05)
    assert scores["test_outside"]["angles"]["median"] == pytest.approx(flat_angle(7.5), abs=0.05)
    psnr = [scores[name]["mean"]["psnr"] for name in ("test_inside", "test_outside")]
    assert meta["test_mean"]["psnr"] == pytest.approx(0.25 * psnr[0] + 0.75 * psnr[1])
    held = scores["held_out"]["mean"]["psnr"]
    assert f"Held-out sector: {held:.2f} dB and SSIM" in result.out
    assert f"Test views elsewhere: {psnr[1]:.2f} dB" in result.out
    assert f"{flat_angle(7.5):.1f}° from the nearest training view (median; at most" in result.out


def test_scores_that_ctrl_c_ended_early_are_neither_printed_nor_kept(
    call, model, around, monkeypatch
):
    real = core_training.evaluate

    def evaluate(field, views, *given, **named):
        return {**real(field, views, *given, **named), "complete": views.split == "sector"}

    monkeypatch.setattr(core_training, "evaluate", evaluate)
    result = call(train.main, around, "-o", model, *FLAGS)
    assert result.code == 130
    assert "Held-out sector: " in result.out
    assert "test views" not in result.out.lower()
    meta = modelfile.load(model).meta
    assert list(meta["sector_scores"]) == ["held_out"] and "test_mean" not in meta


def test_a_check_says_what_would_be_held_out(call, trainer, model, around):
    result = call(train.main, around, "-o", model, "--hold-out", "sector", "--check")
    assert result.code == 0 and "Held out: 4 training views" in result.err
    assert not trainer.calls


def flat_angle(turn):
    """Between two views that are so far apart around the object [degrees]: they look down."""
    down = np.arctan(0.25)
    return np.degrees(np.arccos(np.cos(down) ** 2 * np.cos(np.radians(turn)) + np.sin(down) ** 2))


def test_eval_scores_just_these_views(call, model, around, tmp_path):
    flags = "--split", "sector", "-o", tmp_path / "scores.json", "--device", "cpu"
    result = call(evaluate.main, model, around, *flags)
    assert result.code == 0
    report = json.loads((tmp_path / "scores.json").read_text())
    assert report["split"] == "sector"
    assert [view["name"] for view in report["views"]] == ["r_0", "r_1", "r_2", "r_3"]
    angles = [view["angle"] for view in report["views"]]
    expected = [flat_angle(turn) for turn in (15.0, 30.0, 30.0, 15.0)]
    np.testing.assert_allclose(angles, expected, atol=0.05)
    assert report["angles"] == {"median": np.median(angles), "largest": max(angles)}
    assert report["sector"]["inside"]["view_count"] == 4
    assert report["sector"]["outside"]["mean"]["psnr"] is None
    said = f"{np.median(angles):.1f}° from the nearest training view"
    assert f"The views are {said} (median; at most {max(angles):.1f}°)." in result.out


def test_eval_of_test_views_tells_those_in_the_sector_apart(call, model, around, tmp_path):
    result = call(evaluate.main, model, around, "-o", tmp_path / "s.json", "--device", "cpu")
    report = json.loads((tmp_path / "s.json").read_text())
    inside = [view["name"] for view in report["views"] if view["in_sector"]]
    assert inside == ["r_0", "r_1"]
    psnr = [report["sector"][word]["mean"]["psnr"] for word in ("inside", "outside")]
    assert (
        f"2 of the views lie in the sector that training held out: {psnr[0]:.2f} dB there, "
        f"{psnr[1]:.2f} dB elsewhere."
    ) in result.out


def test_a_model_that_held_none_out_has_no_such_views(call, field, around, tmp_path, refused):
    modelfile.save(field, tmp_path / "plain.npz")
    result = call(evaluate.main, tmp_path / "plain.npz", around, "--split", "sector")
    assert "plain.npz held no sector out: train with --hold-out sector" in refused(result)


def test_views_that_are_not_there_any_more_are_named(call, model, around, refused):
    (around / "train" / "r_2.png").unlink()
    result = call(evaluate.main, model, around, "--split", "sector", "--device", "cpu")
    assert "1 of the 4 views that training held out are no training images" in refused(result)
    assert "first train/r_2.png" in result.err


def test_a_data_set_without_a_sector_is_refused_before_training(
    call, trainer, data, tmp_path, refused
):
    result = call(train.main, data, "-o", tmp_path / "m.npz", *FLAGS)
    assert "a sector of 60° can't be held out: there are 3 training views" in refused(result)
    assert not trainer.calls


def test_a_resumed_run_holds_out_the_same_sector(call, trainer, model, around):
    unfinished(model, around, trainer.trained.field.meta)
    result = call(train.main, around, "-o", model, "--device", "cpu", "--resume")
    assert result.code == 0 and "Held out: 4 training views" in result.err
    assert trainer.calls[0][0].view_count == 20


def test_a_resumed_run_can_not_begin_to_hold_one_out(call, trainer, model, around, refused):
    unfinished(model, around, {})
    result = call(train.main, around, "-o", model, *FLAGS, "--resume")
    assert "--resume keeps what the interrupted run trained on: drop --hold-out" in refused(result)


def unfinished(model, around, meta):
    """Write the checkpoint of a run on its views."""
    from deformrf.core.geometry import a15_grid
    from deformrf.core.training import preset
    from deformrf.core.training.run.checkpoint import Checkpoint, save_checkpoint

    sector = {"sector": meta["sector"]} if meta else {}
    count = 20 if meta else 24
    report = {"view_count": count, "image_size": list(SIZE), "seconds": 9.0, **sector}
    options = preset("tiny", seed=5)
    path = model.with_suffix(".checkpoint")
    save_checkpoint(Checkpoint(options, 1, a15_grid(0.25), {}, np.eye(4), report), path)


def test_the_report_has_both_scores(call, model, around):
    call(train.main, around, "-o", model, *FLAGS)
    section = training.section(modelfile.load(model))
    [table] = section.tables
    assert [(row.which, row.count) for row in table.rows] == [
        ("training views of the sector, held out", 4),
        ("test views in the sector", 2),
        ("test views elsewhere", 6),
    ]
    assert table.rows[0].largest == pytest.approx(flat_angle(30.0), abs=0.05)
    assert "training views of the sector, held out: " in section.findings[1].lower()


def test_a_real_run_trains_scores_and_is_scored_again(call, ball_folder, tmp_path):
    """20 views of a ball from all sides, some steps."""
    path = tmp_path / "m.npz"
    flags = "--preset", "tiny", "--steps", 30, "--leave-out", "coarse-stage", *FLAGS
    result = call(train.main, ball_folder, "-o", path, *flags)
    assert result.code == 0, result.err
    meta = modelfile.load(path).meta
    held = Sector.of_report(meta).views
    assert meta["view_count"] == len(meta["views"]) == 20 - len(held)
    scores = tmp_path / "s.json"
    flags = "--split", "sector", "--samples", 1, "-o", scores, "--device", "cpu"
    assert call(evaluate.main, path, ball_folder, *flags).code == 0
    report = json.loads(scores.read_text())
    assert [f"train/{view['name']}.png" for view in report["views"]] == list(held)
    kept = meta["sector_scores"]["held_out"]
    assert report["mean"]["psnr"] == pytest.approx(kept["mean"]["psnr"], abs=1e-3)
    assert report["angles"] == pytest.approx(kept["angles"])
    assert report["angles"]["largest"] > 15.0
