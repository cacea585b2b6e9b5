"""Rendering with what is left out: all is measured, and differs by what it should."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.field import multiplies_pairs, occupied_share
from deformrf.wings.lab.omissions import frames as bench
from deformrf.wings.lab.omissions.measure import NONE, RENDERING, SAVES, Bench


@pytest.fixture
def frames():
    def frames(field, device, size=24):
        return bench.Frames(field, device, size, view_count=2)

    return frames


def decibels(change):
    return float(change.split(" dB")[0])


ROWS = (
    "samples in empty",
    "tets without",
    "samples behind",
    "samples where",
    "the path for",
    "rendering again",
    "the finest level",
    "view dependence",
)
CPU_ROWS, CUDA_ROWS = ("samples where",), ("rounds that",)
PRECISION = "single precision"  # a row where half precision is one of default mode's means


def measured(frames, name):
    """The row whose name begins like this."""
    [switch] = [s for s in bench.frame_switches(frames) if s.name.startswith(name)]
    return switch.measured(Bench(RENDERING, frames.device, 3, 1.0, frames.change))


def test_these_are_all_rows(ball, frames):
    of_cpu = bench.frame_switches(frames(ball, "cpu"))
    rows = [*ROWS[:5], PRECISION, *ROWS[5:]] if multiplies_pairs() else ROWS
    assert all(s.name.startswith(name) for s, name in zip(of_cpu, rows, strict=True))
    of_cuda = frames(ball, "cpu")
    of_cuda.device = "cuda:0"
    both = [
        {s.name for s in of if not s.name.startswith(PRECISION)}
        for of in (bench.frame_switches(of_cuda), of_cpu)
    ]
    for names, rows in ((both[0] - both[1], CUDA_ROWS), (both[1] - both[0], CPU_ROWS)):
        assert len(names) == len(rows)
        assert all(any(name.startswith(begin) for name in names) for begin in rows)


@pytest.mark.parametrize("name", ROWS)
def test_every_row_is_measured(make_ball_field, frames, device, name):
    if name in CPU_ROWS and device != "cpu":
        pytest.skip("a row of CPUs alone")
    found = measured(frames(make_ball_field(3, occupied_share=0.3, level_count=3), device), name)
    for timing in (found.with_it, found.without):
        assert np.isfinite([timing.low, timing.high]).all() and timing.count == 3
        assert 0.0 <= timing.low <= timing.median <= timing.high
    least, most = (
        found.with_it.low - found.without.high,
        found.with_it.high - found.without.low,
    )
    assert least <= found.saving.median <= most
    assert found.unit == "ms" and found.change and found.why


def test_each_way_has_a_renderer_of_its_own(ball):
    """A wavefront expects as many rounds as its last image took."""
    frames = bench.Frames(ball, "cpu", 16, view_count=1)
    frames.device = "cuda:0"  # for the names of all rows; the renderers are those of the CPU
    switches = bench.frame_switches(frames)
    frames.device = "cpu"
    assert len(switches) == len(ROWS) - len(CPU_ROWS) + len(CUDA_ROWS) + 1  # and the precision
    for switch in switches:
        assert switch.with_it().renderer is not switch.without().renderer, switch.name


def test_a_full_mask_leaves_nothing_out(ball, frames, device):
    ball = replace(ball, occupancy=np.full_like(ball.occupancy, bench.FULL))
    for name in ROWS[:2]:
        assert measured(frames(ball, device), name).change == NONE


def test_the_mask_changes_what_is_seen_and_empty_tets_do_not(make_ball_field, frames, device):
    few = frames(make_ball_field(5, occupied_share=0.2), device, 32)
    assert decibels(measured(few, "samples in empty").change) < 40.0
    with_empty = few.way(part_of=bench.every_tet)
    assert with_empty.renderer.part.mesh.tet_count == few.field.mesh.tet_count
    assert few.usual.renderer.part.mesh.tet_count < few.field.mesh.tet_count
    change = measured(few, "tets without").change
    assert change == NONE or decibels(change) > 45.0


def test_filling_the_mask_brings_no_empty_tet_back(make_ball_field, frames):
    field = make_ball_field(5, occupied_share=0.2)
    few = frames(field, "cpu", 16)
    switch = bench.frame_switches(few)[0]
    filled, usual = (make().renderer.part.occupancy for make in (switch.with_it, switch.without))
    assert len(filled) == len(usual) == (field.occupancy != 0).sum() < field.mesh.tet_count
    assert (filled == bench.FULL).all() and (usual != bench.FULL).any()
    share = 100.0 * (1.0 - occupied_share(usual))
    assert f"{share:.0f} % of the sub-tets" in switch.why and "never trained" in switch.why


def test_rendering_again_is_left_out_without_any_change(ball, frames):
    row = measured(frames(ball, "cpu"), "rendering again")
    assert row.verdict == SAVES and row.change == NONE and row.left_out


def test_levels_finer_than_a_pixel_are_named(make_ball_field, frames):
    field = make_ball_field(1, level_count=4)
    fine, coarse = (
        next(s for s in bench.frame_switches(frames(field, "cpu", size)) if "level" in s.name)
        for size in (4, 100)
    )
    assert fine.name == "levels finer than a pixel" and "of 4 levels" in fine.why
    assert coarse.name == "the finest level" and "no level" in coarse.why
    assert not fine.left_out and not coarse.left_out


def test_view_dependence_is_left_out_where_the_model_has_none(make_ball_field, frames):
    field = make_ball_field(12)
    row = measured(frames(field, "cpu"), "view dependence")
    assert not row.left_out and decibels(row.change) < 50.0
    (weights, bias), *rest = field.color_layers
    weights = weights.copy()
    weights[17:] = 0.0  # 16 features and the constant harmonic stay
    field = replace(
        field,
        color_layers=((weights, bias), *rest),
        options=replace(field.options, view_dependence=False),
    )
    row = measured(frames(field, "cpu"), "view dependence")
    assert row.left_out and (row.change == NONE or decibels(row.change) > 60.0)


def test_views_take_turns(ball, frames, monkeypatch):
    seen, both = [], frames(ball, "cpu")
    way = both.way()
    render = way.renderer.render

    def watched(camera, options):
        seen.append(camera)
        return render(camera, options)

    monkeypatch.setattr(way.renderer, "render", watched)
    for _ in range(4):
        way.turn()
    assert [id(c) for c in seen] == 2 * [id(c) for c in both.cameras]
    assert both.change(way, both.usual) == NONE


def test_a_cpu_may_multiply_pairs(ball, frames):
    if not multiplies_pairs():
        pytest.skip("this processor does not multiply pairs of bfloat16")
    assert decibels(measured(frames(ball, "cpu"), PRECISION).change) > 45.0  # of random numbers


@pytest.mark.gpu
def test_half_precision_is_left_out_on_cuda(ball, frames):
    row = measured(frames(ball, "cuda:0"), PRECISION)
    assert decibels(row.change) > 45.0
    waiting = measured(frames(ball, "cuda:0"), "rounds that")
    assert waiting.change == NONE or decibels(waiting.change) > 45.0
