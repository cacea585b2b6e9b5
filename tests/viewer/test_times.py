"""Frame times: what is measured is what is shown."""

import time

import pytest

from deformrf.viewer.times import TASKS, FrameTimes


def test_times_of_a_stage_add_up_within_a_frame():
    times = FrameTimes()
    times.end_frame()  # the first frame has no beginning
    for _ in range(9):
        with times.task("draw"):
            time.sleep(0.004)
        with times.task("draw"):
            time.sleep(0.004)
        times.end_frame()
    assert times.means()["draw"] == pytest.approx(0.008, rel=0.5)
    assert times.means()["upload"] == 0.0
    assert times.frame_seconds() >= 0.006
    assert set(times.means()) == set(TASKS)


def test_a_stage_that_fails_is_still_timed():
    times = FrameTimes()
    with pytest.raises(ValueError), times.task("render"):
        time.sleep(0.002)
        raise ValueError
    times.end_frame()
    assert times.frames[-1] == 0.0  # the first frame has no beginning


def test_what_happens_at_rest_is_part_of_no_frame():
    times = FrameTimes()
    times.end_frame()
    with times.task("render"):
        time.sleep(0.05)
    times.rest()
    times.end_frame()
    times.end_frame()
    assert max(times.frames) < 0.05
    assert times.recent(("render", "draw")) == 0.0


def test_recent_stages_are_added_up_frame_by_frame():
    times = FrameTimes()
    for _ in range(9):
        for stage in ("draw", "panel", "flip"):
            with times.task(stage):
                time.sleep(0.003)
        times.end_frame()
    assert times.recent(("draw", "panel")) == pytest.approx(0.006, rel=0.5)


def test_all_read_outs_are_of_the_last_second(monkeypatch):
    """A drag that begins shows at once, and what was before it is forgotten after a second."""
    now = 100.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)
    times = FrameTimes()
    times.end_frame()
    for length, simulate, count in ((0.02, 0.00005, 100), (0.1, 0.06, 20)):
        for _ in range(count):
            with times.task("simulate"):
                now += simulate
            now += length - simulate
            times.end_frame()
    assert times.frame_seconds() == pytest.approx(0.1)
    assert times.means()["simulate"] == pytest.approx(0.06)
    assert sum(times.means().values()) <= times.frame_seconds()


def test_the_pace_is_that_of_the_last_second_of_motion(monkeypatch):
    now = 100.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)
    times = FrameTimes()
    assert times.pace() == 1.0
    for seconds, ticks in ((1 / 30, 2), (0.25, 6)):
        for _ in range(40):
            now += seconds
            times.passed(seconds, ticks)
        assert times.pace() == pytest.approx(ticks / 60 / seconds)
    now += 2.0  # at rest
    assert times.pace() == 1.0


def test_a_tick_s_time_is_that_of_the_last_motion(monkeypatch):
    now = 100.0
    monkeypatch.setattr(time, "perf_counter", lambda: now)
    times = FrameTimes()
    assert times.tick_seconds() == 0.0
    for simulate, ticks in [(0.004, 1)] * 20 + [(0.002, 2)] * 20 + [(0.0, 0)]:
        with times.task("simulate"):
            now += simulate
        times.passed(0.1, ticks)
        times.end_frame()
    assert times.tick_seconds() == pytest.approx(0.001)
