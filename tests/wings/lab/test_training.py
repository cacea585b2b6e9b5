"""What a report says of a model's training: from its history, and without one."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deformrf.core.training.run.monitoring import History
from deformrf.wings.lab import training


def row(seconds, stage, step, psnr):
    return {"seconds": seconds, "stage": stage, "step": step, "psnr": psnr}


ROWS = [
    row(4.0, 1, 50, 12.0),
    row(8.0, 1, 100, 20.0),
    *(row(10.0 + i, 2, 20 * i, 16.0 + 0.2 * i) for i in range(1, 81)),
]
META = {
    "data": "helmet",
    "seconds": 100.0,
    "stage_1_seconds": 9.5,
    "device": "NVIDIA H100",
    "workers": 1,
    "history": ROWS,
    "test_view_count": 7,
    "test_mean": {"psnr": 30.25},
}


@pytest.fixture
def trained(field):
    return replace(field, meta=META)


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).reshape(-1, 3)


def share_of(color, png):
    """Of the pixels, those near a color "#rrggbb"."""
    color = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return (np.abs(pixels(png).astype(int) - color).max(axis=1) < 24).mean()


def test_findings_are_those_of_the_history(trained):
    section = training.section(trained)
    assert section.key == "training" and section.passed is None
    assert section.findings == [
        "Training took 100.0 s on NVIDIA H100; the training rays end at 32.00 dB; "
        "the 7 test views are at 30.25 dB.",
        "Stage 1 took 9.5 s for 100 steps; stage 2 took 90.5 s for 1,600 steps.",
    ]


def test_the_table_has_tenths_and_the_values_all_rows(trained):
    section = training.section(trained)
    [table] = section.tables
    assert [r.share for r in table.rows] == [8, 20, 30, 40, 50, 60, 70, 80, 90]
    every = section.values["history"]
    assert [row(m.seconds, m.stage, m.step, m.psnr) for m in every] == ROWS
    assert set(table.rows) <= set(every)


def test_what_training_notes_is_what_is_read():
    rows = []
    History(rows, 2, 32, lambda: 1.5).note(16, 0.01)
    moments = training.history({"history": rows, "seconds": 3.0})
    assert moments == [training.Moment(1.5, 50.0, 2, 16, pytest.approx(20.0))]


def test_the_last_row_is_shown_however_seconds_round():
    for factor in np.random.default_rng(0).uniform(0.1, 10.0, 50):
        rows = [{**r, "seconds": factor * r["seconds"]} for r in ROWS]
        moments = training.history({"history": rows})
        assert training.tenths(moments)[-1] == moments[-1]


def test_the_picture_tells_stages_and_test_views_apart(trained):
    [figure] = training.section(trained).figures
    assert figure.name == "training"
    assert "test views" in figure.caption
    colors = [*training.COLORS.values(), training.TEST_COLOR]
    assert all(share_of(color, figure.png) > 2e-4 for color in colors)

    alone = replace(trained, meta={"history": ROWS[2:]})
    [figure] = training.section(alone).figures
    shares = [share_of(color, figure.png) for color in colors]
    assert shares[1] > 2e-4 and shares[0] == shares[2] == 0.0


def test_without_a_history_it_says_what_is_known(field):
    known = {key: META[key] for key in META if key != "history"}
    section = training.section(replace(field, meta=known))
    assert section.findings == [
        "The model keeps no history of its training; training took 100.0 s on NVIDIA H100; "
        "the 7 test views are at 30.25 dB."
    ]
    assert not section.tables and not section.figures
    assert (section.values["seconds"], section.values["test_psnr"]) == (100.0, 30.25)


def test_a_field_that_was_never_trained_is_no_error(field):
    section = training.section(replace(field, meta={}))
    assert section.findings == ["The model keeps no history of its training."]
    assert not section.figures


@pytest.mark.parametrize("missing", META)
def test_any_key_may_be_missing(trained, missing):
    meta = {key: META[key] for key in META if key != missing}
    section = training.section(replace(trained, meta=meta))
    assert all(finding.endswith(".") and "None" not in finding for finding in section.findings)
    assert bool(section.figures) == (missing != "history")


def test_equal_test_views_have_no_psnr(trained):
    section = training.section(replace(trained, meta={**META, "test_mean": {"psnr": None}}))
    assert "test views" not in " ".join(section.findings)


@pytest.mark.parametrize(("gain", "began"), [(0.436, "with"), (-1.35, "without")])
def test_what_a_trial_chose_is_told_with_what_it_was_worth(trained, gain, began):
    meta = {**META, "depth_gain": gain, "decay_gain": -0.2, "levels_left_out": 2}
    told = training.section(replace(trained, meta=meta)).findings
    said = f"Stage 2 began {began} a cost of depth, which gave {gain:+.2f} dB in a trial."
    assert told[2:5] == [
        said,
        "Stage 2 began without strong decay, which gave -0.20 dB in a trial.",
        "Finest levels left out, because no image shows them: 2.",
    ]


def test_runs_that_ended_early_say_so(trained):
    """In the first stage, and before the second one's first step."""
    for first, seconds in ((None, "100.0"), (9.5, "9.5")):
        early = {"history": ROWS[:2], "interrupted": True, "stage_1_seconds": first}
        findings = training.section(replace(trained, meta={**META, **early})).findings
        assert findings[1] == f"Stage 1 took {seconds} s for 100 steps."
        assert findings[2] == "The run was interrupted: the history ends there."
    lost = {**META, "diverged": "the loss became nan"}
    findings = training.section(replace(trained, meta=lost)).findings
    assert findings[2] == "The run ended early: the loss became nan."
