"""Images that move: fewer rays are faster to have and farther from the exact image."""

from itertools import pairwise

import numpy as np
import pytest

from deformrf.wings.lab.rendering import moving


@pytest.fixture(scope="module")
def table(make_ball_field):
    shares = []
    found = moving.table(make_ball_field(7), 60, shares.append)
    assert shares == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    return found


def test_the_way_begins_at_rest_and_holds_the_foot(make_ball_field):
    field = make_ball_field(7)
    way, rest = moving.poses(field), field.mesh.rest_vertices
    np.testing.assert_allclose(way[0], rest, atol=1e-6)
    foot = rest[:, 2] == rest[:, 2].min()
    size = np.linalg.norm(np.ptp(rest, axis=0))
    for before, after in pairwise(way):
        np.testing.assert_array_equal(after[foot], before[foot])
        step = np.linalg.norm(after - before, axis=1).max()
        arc = moving.AMPLITUDE * 2.0 * np.pi * moving.FRAME_SECONDS / moving.TURN_SECONDS
        assert step == pytest.approx(arc * size, rel=0.01)


def test_fewer_rays_lose_and_upsampling_beats_scaling(table):
    rows = table.rows
    assert [row.rays for row in rows] == ["all", "1/4", "1/6", "1/9", "1/16"]
    decibels = [row.psnr for row in rows]
    assert decibels[0] > 45.0 and decibels == sorted(decibels, reverse=True)
    for row in rows[1:]:
        assert row.worst_psnr <= row.psnr and row.psnr > row.scaled_psnr
        assert 0.0 < row.upsampling < row.frame.median
    assert rows[0].scaled_psnr is None and rows[0].upsampling is None


def test_what_is_said_has_the_numbers_of_the_table(table):
    (sentence,) = moving.findings([table])
    assert f"{table.rows[2].psnr:.1f} dB" in sentence and "1/6" in sentence
    assert moving.findings([]) == []
