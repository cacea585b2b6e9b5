"""A rig's parts fit each other."""

import numpy as np
import pytest

from deformrf.wings.rig import Channel, Clip, Rig, VertexClip, make_skeleton

SKELETON = make_skeleton(("a", "b"), (-1, 0), [[0, 0, 0], [0, 0, 1]], [[0, 0, 1], [0, 0, 2]])
WEIGHTS = np.array([[1.0, 0.0], [0.5, 0.5]], np.float32)
KEY = Channel(2, "translation", "STEP", np.zeros(1), np.zeros((1, 3)))
FRAMES = VertexClip("v", np.zeros(1), np.zeros((1, 3, 3), np.float32))


def test_clips_are_found_by_name():
    rig = Rig(SKELETON, WEIGHTS, (Clip("Run", 1.0, ()),))
    assert rig.clip("Run").name == "Run"
    with pytest.raises(ValueError, match="no clip 'Walk'; its clips: Run"):
        rig.clip("Walk")


OFFSETS = np.array([[[0, 0, 0], [0, 0, 0]], [[0.1, 0, 0], [-0.1, 0, 0]]], np.float32)


def test_offsets_that_fit_are_taken():
    assert Rig(SKELETON, WEIGHTS).offsets is None
    assert Rig(SKELETON, WEIGHTS, offsets=OFFSETS).offsets is OFFSETS


@pytest.mark.parametrize(
    "offsets, sentence",
    [
        (OFFSETS[:, :1], r"the offsets are \[2, 1, 3\], but the weights are \[2, 2\]"),
        (OFFSETS * np.nan, "the offsets of vertex 0 hold NaN"),
        (OFFSETS * 1e8, "the offsets of vertex 1 hold NaN, or numbers beyond 1e6"),
        (OFFSETS[::-1], "vertex 0 has an offset for a bone that has no weight there"),
        (np.abs(OFFSETS), r"the offsets of vertex 1 sum to 0\.2, not 0 \(1 of 2"),
    ],
)
def test_offsets_that_do_not_fit_are_said_so(offsets, sentence):
    with pytest.raises(ValueError, match=sentence):
        Rig(SKELETON, WEIGHTS, offsets=offsets)


@pytest.mark.parametrize(
    "weights, clips, sentence",
    [
        (WEIGHTS[:, :1], (), "the skeleton has 2 bones"),
        (WEIGHTS * 0.9, (), r"vertex 0 sum to 0\.9, not 1 \(2 of 2"),
        (WEIGHTS * [[1, 1], [3, -1]], (), "vertex 1 hold NaN, or leave"),
        (WEIGHTS * np.nan, (), "vertex 0 hold NaN"),
        (WEIGHTS, (Clip("c", 0.0, (KEY,)),), "animates bone number 2"),
        (WEIGHTS, (FRAMES,), "moves 3 vertices, but the rig has weights for 2"),
        (WEIGHTS, (Clip("c", 0.0, ()), Clip("c", 1.0, ())), "two clips with the name 'c'"),
    ],
)
def test_what_does_not_fit_is_said_so(weights, clips, sentence):
    with pytest.raises(ValueError, match=sentence):
        Rig(SKELETON, weights, clips)
