"""What a report says of a model's training: from its history, and without one."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deformrf.core.training.run.monitoring import History
from deformrf.wings.lab.report.parts import record
from deformrf.wings.lab.training import tell as training


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
    part = training.section(trained)
    assert part.key == "training" and part.passed is None
    assert part.findings == [
        "Training took 100.0 s on NVIDIA H100; the training rays end at 32.00 dB; "
        "the 7 test views are at 30.25 dB.",
        "The training rays are at 20.00 dB after 10 % of the time (stage 1), "
        "24.00 dB after 50 % of the time (stage 2), 32.00 dB after 100 % of the time (stage 2). "
        "The last half of the time gained 8.00 dB.",
        "Stage 1 took 9.5 s for 100 steps; stage 2 took 90.5 s for 1,600 steps.",
    ]
    assert part.values["psnr_at_percent"] == {"10": 20.0, "50": 24.0, "100": 32.0}
    assert part.values["last_half_gain_db"] == pytest.approx(8.0)
    assert part.values["stages"][1] == training.StageTime(2, 90.5, 1600)


def test_tables_hold_all_rows_and_print_few(trained):
    tenths, whole = training.section(trained).tables
    assert whole.name == "training" and whole.first < 10
    names = ("seconds", "stage", "step", "psnr")
    assert [{name: record(r)[name] for name in names} for r in whole.rows] == ROWS
    assert [r.share for r in tenths.rows] == [8, 20, 30, 40, 50, 60, 70, 80, 90]
    for table in (tenths, whole):
        assert set(table.headings) <= set(record(table.rows[0]))
    assert {r in whole.rows for r in tenths.rows} == {True}


def test_what_training_notes_is_what_is_read():
    rows = []
    History(rows, 2, 32, lambda: 1.5).note(16, 0.01)
    moments = training.history({"history": rows, "seconds": 3.0})
    assert moments == [training.Moment(1.5, 50.0, 2, 16, pytest.approx(20.0))]


def test_the_last_row_is_shown_however_seconds_round():
    for factor in np.random.default_rng().uniform(0.1, 10.0, 50):
        rows = [{**r, "seconds": factor * r["seconds"]} for r in ROWS]
        moments = training.history({"history": rows})
        assert training.tenths(moments)[-1] == moments[-1]


def test_the_picture_tells_stages_and_test_views_apart(trained):
    [figure] = training.section(trained).figures
    assert figure.name == "training"
    assert "helmet" in figure.caption and "NVIDIA H100" in figure.caption
    colors = [*training.COLORS.values(), training.TEST_COLOR]
    assert all(share_of(color, figure.png) > 2e-4 for color in colors)

    alone = replace(trained, meta={"history": ROWS[2:]})
    [figure] = training.section(alone).figures
    shares = [share_of(color, figure.png) for color in colors]
    assert shares[1] > 2e-4 and shares[0] == shares[2] == 0.0


def test_without_a_history_it_says_what_is_known(field):
    known = {key: META[key] for key in META if key != "history"}
    part = training.section(replace(field, meta=known))
    assert part.findings == [
        "The model keeps no history of its training; training took 100.0 s on NVIDIA H100; "
        "the 7 test views are at 30.25 dB."
    ]
    assert not part.tables and not part.figures
    assert (part.values["seconds"], part.values["test_psnr"]) == (100.0, 30.25)


def test_a_field_that_was_never_trained_is_no_error(field):
    part = training.section(replace(field, meta={}))
    assert part.findings == ["The model keeps no history of its training."]
    assert not part.figures


@pytest.mark.parametrize("missing", META)
def test_any_key_may_be_missing(trained, missing):
    meta = {key: META[key] for key in META if key != missing}
    part = training.section(replace(trained, meta=meta))
    assert all(finding.endswith(".") and "None" not in finding for finding in part.findings)
    assert bool(part.figures) == (missing != "history")


def test_equal_test_views_have_no_psnr(trained):
    part = training.section(replace(trained, meta={**META, "test_mean": {"psnr": None}}))
    assert "test views" not in " ".join(part.findings)


def test_runs_that_ended_early_say_so(trained):
    """In the first stage, and before the second one's first step."""
    for first, seconds in ((None, "100.0"), (9.5, "9.5")):
        early = {"history": ROWS[:2], "interrupted": True, "stage_1_seconds": first}
        findings = training.section(replace(trained, meta={**META, **early})).findings
        assert findings[2] == f"Stage 1 took {seconds} s for 100 steps."
        assert findings[3] == "The run was interrupted: the history ends there."
    lost = {**META, "diverged": "the loss became nan"}
    findings = training.section(replace(trained, meta=lost)).findings
    assert findings[3] == "The run ended early: the loss became nan."


def test_before_the_first_row_nothing_is_claimed(trained):
    late = [row(90.0, 2, 16, 20.0), row(99.0, 2, 32, 19.0)]
    part = training.section(replace(trained, meta={"history": late, "seconds": 100.0}))
    places = "19.00 dB after 100 % of the time (stage 2)"
    assert part.findings[1] == f"The training rays are at {places}."
    assert part.findings[2] == "Stage 2 took 100.0 s for 32 steps."
    assert part.values["last_half_gain_db"] is None
