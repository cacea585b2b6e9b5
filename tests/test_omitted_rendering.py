"""Rendering with what is left out: all is measured, and differs by what it should."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.lab.omissions import of_rendering as rows
from deformrf.core.lab.omissions.rows import NONE, SAVES
from deformrf.core.render import RenderOptions


@pytest.fixture
def frames():
    def frames(field, device, size=24):
        return rows.Frames(field, device, size, view_count=2, repeats=3)

    return frames


def decibels(change):
    return float(change.split(" dB")[0])


@pytest.mark.parametrize("row", rows.rendering_rows("cpu"), ids=lambda row: row.__name__)
def test_every_row_is_measured(make_ball_field, frames, device, row):
    found = row(frames(make_ball_field(3, occupied_share=0.3, level_count=3), device))
    for timing in (found.with_it, found.without):
        assert np.isfinite([timing.low, timing.high]).all() and timing.count == 3
        assert 0.0 <= timing.low <= timing.median <= timing.high
    least, most = (
        found.with_it.low - found.without.high,
        found.with_it.high - found.without.low,
    )
    assert least <= found.saving.median <= most
    assert found.unit == "ms" and found.change and found.why


@pytest.mark.parametrize(
    "row",
    [row for row in rows.rendering_rows("cuda:0") if row is not rows.unchanged_view],
    ids=lambda row: row.__name__,
)
def test_each_way_has_a_renderer_of_its_own(ball, row):
    """A wavefront expects as many rounds as its last image took."""
    pairs = []

    class Watched(rows.Frames):
        def compared(self, *ways):
            pairs.append(ways)
            return super().compared(*ways)

    row(Watched(ball, "cpu", 16, view_count=1, repeats=3))
    for with_it, without in pairs:
        assert with_it.renderer is not without.renderer
    assert len(pairs) == 1


def test_a_full_mask_leaves_nothing_out(ball, frames, device):
    ball = replace(ball, occupancy=np.full_like(ball.occupancy, rows.ALL_SUBTETS))
    for row in (rows.empty_space, rows.empty_tets):
        assert row(frames(ball, device)).change == NONE


def test_the_mask_changes_what_is_seen_and_empty_tets_do_not(make_ball_field, frames, device):
    few = frames(make_ball_field(5, occupied_share=0.2), device, 32)
    assert decibels(rows.empty_space(few).change) < 40.0
    with_empty = few.way(part_of=rows._every_tet)
    assert with_empty.renderer.part.mesh.tet_count == few.field.mesh.tet_count
    assert few.usual.renderer.part.mesh.tet_count < few.field.mesh.tet_count
    change = rows.empty_tets(few).change
    assert change == NONE or decibels(change) > 45.0


def test_filling_the_mask_brings_no_empty_tet_back(make_ball_field):
    field, masks = make_ball_field(5, occupied_share=0.2), []

    class Watched(rows.Frames):
        def compared(self, *ways):
            masks.extend(way.renderer.part.occupancy for way in ways)
            return super().compared(*ways)

    row = rows.empty_space(Watched(field, "cpu", 16, view_count=1, repeats=3))
    filled, usual = masks
    assert len(filled) == len(usual) == (field.occupancy != 0).sum() < field.mesh.tet_count
    assert (filled == rows.ALL_SUBTETS).all() and (usual != rows.ALL_SUBTETS).any()
    assert "never trained" in row.why and "ends rays early" in row.why


def test_rendering_again_is_left_out_without_any_change(ball, frames):
    row = rows.unchanged_view(frames(ball, "cpu"))
    assert row.verdict == SAVES and row.change == NONE and row.left_out


def test_levels_finer_than_a_pixel_are_named(make_ball_field, frames):
    field = make_ball_field(1, level_count=4)
    fine, coarse = (rows.fine_levels(frames(field, "cpu", size)) for size in (4, 100))
    assert fine.name == "levels finer than a pixel" and "of 4 levels" in fine.why
    assert coarse.name == "the finest level" and "no level" in coarse.why
    assert not fine.left_out and not coarse.left_out


def test_view_dependence_is_left_out_where_the_model_has_none(make_ball_field, frames):
    field = make_ball_field(12)
    row = rows.view_dependence(frames(field, "cpu"))
    assert not row.left_out and decibels(row.change) < 50.0
    (weights, bias), *rest = field.color_layers
    weights = weights.copy()
    weights[17:] = 0.0  # 16 features and the constant harmonic stay
    field = replace(
        field,
        color_layers=((weights, bias), *rest),
        options=replace(field.options, view_dependence=False),
    )
    row = rows.view_dependence(frames(field, "cpu"))
    assert row.left_out and (row.change == NONE or decibels(row.change) > 60.0)


def test_views_take_turns(ball, frames):
    seen = []
    both = frames(ball, "cpu")

    class Watched:
        def render(self, camera, options):
            seen.append(camera)
            return both.usual.renderer.render(camera, options)

    way = rows.Way(Watched(), RenderOptions())
    _, change = both.compared(way, both.usual)
    assert change == NONE and {id(c) for c in seen} == {id(c) for c in both.cameras}


@pytest.mark.gpu
def test_half_precision_is_left_out_on_cuda_alone(ball, frames):
    assert rows.single_precision in rows.rendering_rows("cuda:0")
    row = rows.single_precision(frames(ball, "cuda:0"))
    assert decibels(row.change) > 45.0
    waiting = rows.waiting_rounds(frames(ball, "cuda:0"))
    assert waiting.change == NONE or decibels(waiting.change) > 45.0
