"""Work that threads share: shares, order of results, errors; and a pose in shares."""

import threading
import time
from functools import partial

import numpy as np
import pytest

from deformrf.core.base import threads
from deformrf.core.base.threads import shares_of, side_by_side
from deformrf.core.render import Pose
from deformrf.core.render.overlap import search
from deformrf.core.render.overlap.search import Overlap
from deformrf.core.render.rays import pose as poses


@pytest.mark.parametrize("cores", [1, 2, 3, 64])
@pytest.mark.parametrize(
    "count, least", [(0, 1), (1, 1), (7, 2), (499, 500), (500, 500), (1000, 3)]
)
def test_shares_hold_everything_once(monkeypatch, cores, count, least):
    monkeypatch.setattr(threads, "thread_count", lambda: cores)
    shares = shares_of(count, least)
    assert [n for first, end in shares for n in range(first, end)] == list(range(count))
    assert len(shares) == max(min(cores, count // least), 1)
    assert len(shares) == 1 or min(end - first for first, end in shares) >= least


def test_tasks_run_side_by_side_and_keep_their_order():
    meeting = threading.Barrier(2, timeout=20)  # which one task alone never passes

    def task(name):
        meeting.wait()
        return name, threading.get_ident()

    (first, here), (second, there) = side_by_side([lambda: task("a"), lambda: task("b")])
    assert (first, second) == ("a", "b") and here == threading.get_ident() != there
    assert side_by_side([lambda: 3]) == [3]


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_comes_when_all_have_ended(failing):
    ended = []

    def task(number):
        if number == failing:
            raise ValueError(f"task {number}")
        time.sleep(0.1 * number)
        ended.append(number)

    with pytest.raises(ValueError, match=f"task {failing}"):
        side_by_side([partial(task, number) for number in range(3)])
    assert ended == [number for number in range(3) if number != failing]


def test_a_pose_is_the_same_in_shares(make_ball_field, monkeypatch):
    """Frames of tets, how many are mirrored, and what the search for overlap counts."""
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), gap=0.1)
    rest = field.mesh.rest_vertices
    shaken = rest + 0.1 * rng.normal(size=rest.shape)
    monkeypatch.setattr(poses, "TETS_PER_THREAD", 20)
    monkeypatch.setattr(search, "EDGES_PER_THREAD", 20)
    found = []
    for cores in (1, 3):
        monkeypatch.setattr(threads, "thread_count", lambda cores=cores: cores)
        pose = Pose(field.mesh, field.neighbours, "cpu")
        overlap = Overlap(field.mesh, field.neighbours, pose)
        for vertices, tangled in ((rest, False), (shaken, True), (rest, False)):
            pose.set_vertices(vertices)
            assert overlap.exists() == tangled
            assert len(pose._frame_launches) == len(overlap._launches) == cores
            tets, crossings = overlap.counts.numpy()
            assert (tets > 0) == (crossings > 0) == tangled
            arrays = pose.geometry.rows, pose.geometry.shapes, pose.geometry.rotations
            found.append([a.numpy().copy() for a in arrays])
            found[-1] += [pose.geometry.mirrored_count.numpy().copy(), tets]
            found[-1].append(np.sort(overlap.tangled.ids.numpy()[:tets]))
    for one, shares in zip(found[:3], found[3:], strict=True):
        for a, b in zip(one, shares, strict=True):
            np.testing.assert_array_equal(a, b)
