"""The number of threads: the faster one is kept, and the other one tried now and then."""

import numpy as np

from deformrf.core.deform import pace
from deformrf.core.deform.pace import Pace


def run(paced, seconds, frame_count):
    """Thread counts of so many frames that last what `seconds` says for each count."""
    counts = []
    for _ in range(frame_count):
        counts.append(paced.thread_count)
        paced.note(seconds[paced.thread_count] * np.random.default_rng().uniform(1.0, 1.05))
    return np.array(counts)


def test_threads_that_help_are_kept():
    counts = run(Pace(4), {1: 2.0, 4: 1.0}, 2000)
    assert (counts == 4).mean() > 0.95
    assert (counts == 1).sum() >= pace.TRIAL


def test_slower_threads_are_dropped_and_tried_less_often():
    counts = run(Pace(4), {1: 1.0, 4: 50.0}, 4000)
    assert (counts == 4).sum() <= 8 * pace.TRIAL
    assert counts[-100:].max() == 1


def test_a_machine_that_gets_busy_or_free_is_noticed():
    paced = Pace(2)
    run(paced, {1: 2.0, 2: 1.0}, 200)
    assert paced.thread_count == 2
    run(paced, {1: 2.0, 2: 30.0}, 20)
    assert paced.thread_count == 1
    run(paced, {1: 2.0, 2: 1.0}, pace.LONGEST_PAUSE + 20)
    assert paced.thread_count == 2


def test_one_thread_stays_one():
    assert set(run(Pace(1), {1: 1.0}, 50)) == {1}


def test_small_meshes_have_one_thread():
    assert pace.thread_limit(500) == 1
    assert 1 <= pace.thread_limit(10**6) <= pace.MOST_THREADS
