"""Images and files with what is left out: they differ by what they should."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import modelfile, multiplies_pairs
from deformrf.core.render import Renderer
from deformrf.wings.lab.effort import EFFORTS
from deformrf.wings.lab.omissions import frames
from deformrf.wings.lab.omissions.switch import NONE, NOT_MEASURED, SAVES, measured

EFFORT = EFFORTS[True, True]._replace(frame_size=24, view_count=2, frame_turns=3)
ENTRIES = "table entries that no occupied sub-tet reaches"


@pytest.fixture
def rows(tmp_path, device):
    """Measure the switches whose names begin like this, of a field that is saved first."""

    def rows(field, *names, **settings):
        path = tmp_path / "model.npz"
        modelfile.save(field, path, **settings)
        switches = frames.frame_switches(modelfile.load(path), device, EFFORT)
        found = [s for name in names for s in switches if s.name.startswith(name)]
        return [measured(switch) for switch in found], path

    return rows


def decibels(change):
    return 100.0 if change == NONE else float(change.split(" dB")[0])


def test_every_image_is_measured_with_and_without(make_ball_field, rows):
    names = "samples in empty", "samples behind", "the path for", "rendering again"
    field = make_ball_field(3, occupied_share=0.3, level_count=3)
    found, _ = rows(field, *names)
    assert [row.name for row in found] == [
        next(row.name for row in found if row.name.startswith(name)) for name in names
    ]
    for row in found:
        assert row.with_it.count == row.without.count == 3 and row.unit == "ms"
        assert np.isfinite([row.with_it.low, row.without.low, row.saving.median]).all()
    masked, behind, merged, again = found
    assert decibels(masked.change) < 40.0  # what was never trained is seen
    assert min(decibels(behind.change), decibels(merged.change)) > 40.0
    assert again.change == NONE


def test_a_full_mask_leaves_nothing_out(ball, rows):
    ball = replace(ball, occupancy=np.full_like(ball.occupancy, frames.FULL))
    assert rows(ball, "samples in empty")[0][0].change == NONE


def test_view_dependence_is_left_out_where_the_model_has_none(make_ball_field, rows):
    field = make_ball_field(12)
    assert rows(field, "view dependence")[0] == []
    (weights, bias), *rest = field.color_layers
    weights = weights.copy()
    weights[17:] = 0.0  # 16 features and the constant harmonic stay
    options = replace(field.options, view_dependence=False)
    field = replace(field, color_layers=((weights, bias), *rest), options=options)
    [row] = rows(field, "view dependence")[0]
    assert decibels(row.change) > 60.0


def test_tets_without_density_are_crossed_with_the_same_image(make_ball_field, rows):
    field = make_ball_field(3, occupied_share=0.3, level_count=3)
    field.occupancy[::2] = 0
    [row], _ = rows(field, "tets without")
    assert row.why.startswith("5") and decibels(row.change) > 60.0


def test_precision_and_rounds_are_rows_where_the_device_has_a_choice(ball, rows, device):
    found, _ = rows(ball, "single precision", "rounds that the host")
    on_cuda = ["rounds that the host waits for"] if device != "cpu" else []
    half = device != "cpu" or multiplies_pairs()
    assert [row.name for row in found] == half * ["single precision of networks"] + on_cuda
    for row in found:
        assert row.verdict != NOT_MEASURED and decibels(row.change) > 45.0
    if half:
        assert found[0].change != NONE


@pytest.mark.parametrize("entry_bits", [8, 16])
def test_entries_that_nothing_reaches_are_not_stored(make_ball_field, rows, entry_bits):
    field = make_ball_field(4, occupied_share=0.2, level_count=3)
    [row], path = rows(field, ENTRIES, entry_bits=entry_bits)
    assert row.verdict == SAVES and row.unit == "MB"
    assert row.change == NONE  # with noise in all of them
    assert row.without.median == pytest.approx(path.stat().st_size / 1e6, rel=0.02)


def test_views_take_turns_and_each_side_has_its_renderer(ball, monkeypatch):
    seen, render = [], Renderer.render

    def watched(renderer, camera, options):
        seen.append((id(renderer), id(camera)))
        return render(renderer, camera, options)

    cameras = frames.views(ball, 2, 16)
    one, other = (frames.ViewSeries(ball, "cpu", cameras) for _ in range(2))
    monkeypatch.setattr(Renderer, "render", watched)
    for _ in range(4):
        one.turn()
        other.turn()
    assert [camera for _, camera in seen[::2]] == 2 * [id(camera) for camera in cameras]
    assert len({renderer for renderer, _ in seen}) == 2
