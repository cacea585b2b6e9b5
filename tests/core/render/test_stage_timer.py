"""Stages add their times to the dict that was there when they began."""

import warp as wp

from deformrf.core.render import StageTimer


def test_times_of_one_stage_add_up(device):
    timer = StageTimer(device)
    seconds = timer.seconds = {}
    for _ in range(2):
        with timer("copy"):
            wp.zeros(1 << 16, dtype=float, device=device)
        timer.collect()
    assert list(seconds) == ["copy"]
    assert 0.0 < seconds["copy"] < 10.0


def test_a_stage_that_is_pending_when_nobody_asks_any_more_counts_for_who_asked(device):
    timer = StageTimer(device)
    seconds = timer.seconds = {}
    with timer("copy"):
        wp.zeros(1 << 16, dtype=float, device=device)
        timer.seconds = None
    with timer("other"):
        pass
    timer.collect()
    assert list(seconds) == ["copy"]
