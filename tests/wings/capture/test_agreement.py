"""Cameras and the matches of pairs: what is right agrees, and lookalikes are told."""

import json
from dataclasses import replace

import numpy as np
import pytest
from captures import circle, similarity_errors, write_capture, write_twins

from deformrf.commands import train
from deformrf.core.training import load_dataset
from deformrf.wings.capture import (
    CaptureError,
    agreement,
    cameras,
    comparing,
    doubts_about,
    features,
    mapping,
    matching,
    photos,
    work,
)
from deformrf.wings.capture.phases import Phases

pytest.importorskip("pycolmap")
COUNT = 16


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The work folder of a small capture, and its cameras."""
    folder = tmp_path_factory.mktemp("photos")
    write_capture(folder, circle(COUNT), np.random.default_rng(7))
    kept, _ = work.open_work(folder / "work", photos.find_photos(folder)[0], 240)
    with Phases() as phases:
        features.find_features(kept, phases.phase)
        matching.match_photos(kept, False, phases.phase, comparing.HostComparer())
        return kept, cameras.placed(mapping.map_photos(kept, phases.phase))


def test_cameras_that_are_right_agree_with_all_pairs(found):
    agreed = agreement.agreement(*found)
    assert agreed.strong >= COUNT and agreed.contradicting == 0
    assert agreed.sentences() == []


def moved(poses):
    """Two of them are a quarter of their distance higher."""
    poses[[4, 11], 2, 3] += 0.25 * cameras.DISTANCE


def turned(poses):
    """Two of them look 10 degrees lower."""
    poses[[4, 11], :3, :3] = poses[[4, 11], :3, :3] @ rotation(np.radians([-10.0, 0.0, 0.0]))


def swapped(poses):
    poses[[4, 12]] = poses[[12, 4]]


def folded(poses):
    """The second half of the way lies on the first."""
    poses[COUNT // 2 :] = poses[: COUNT // 2]


def rotation(vector):
    """[3, 3]"""
    angle = np.linalg.norm(vector)
    cross = np.cross(np.eye(3), vector / angle)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@pytest.mark.parametrize("change", [moved, turned, swapped, folded])
def test_cameras_that_are_wrong_are_contradicted(found, change):
    kept, right = found
    poses = right.poses.copy()
    change(poses)
    agreed = agreement.agreement(kept, replace(right, poses=poses))
    assert agreed.contradicting >= 2
    assert agreed.strong == agreement.agreement(*found).strong
    (sentence,) = agreed.sentences()
    assert sentence.startswith(f"{agreed.contradicting} of the {agreed.strong} pairs")


def test_the_unit_of_length_and_the_world_do_not_matter(found):
    kept, right = found
    poses = right.poses.copy()
    poses[4, :3, 3] *= 1.1
    before = agreement.agreement(kept, replace(right, poses=poses))
    poses[:, :3] = rotation(np.array([0.3, 1.0, -0.4])) @ poses[:, :3]
    poses[:, :3, 3] = 7.0 * poses[:, :3, 3] + [1.0, 2.0, 3.0]
    assert agreement.agreement(kept, replace(right, poses=poses)) == before


def test_distances_from_epipolar_lines_have_a_closed_form():
    """Of cameras side by side these are rows; both photographs share a match's error."""
    rng = np.random.default_rng()
    poses = np.stack([np.eye(4)] * 2)
    poses[1, 0, 3] = rng.uniform(0.5, 2.0)
    x = rng.uniform(-0.5, 0.5, (50, 2))
    off = rng.normal(size=50) * 0.01
    y = x + np.stack([rng.uniform(-0.1, 0.1, 50), off], axis=1)
    expected = 200.0 * np.abs(off) / np.sqrt(2.0)
    np.testing.assert_allclose(agreement.distances(poses, x, y, 200.0), expected, atol=1e-9)


def test_points_that_two_cameras_see_lie_on_their_epipolar_lines():
    rng, poses = np.random.default_rng(), circle(9)[[0, 2]]
    points = rng.uniform(-0.5, 0.5, (40, 3))
    local = [(points - pose[:3, 3]) @ pose[:3, :3] * [1.0, -1.0, -1.0] for pose in poses]
    x, y = (p[:, :2] / p[:, 2:] for p in local)
    assert agreement.distances(poses, x, y, 200.0).max() < 1e-9


def test_a_pair_is_strong_beside_the_strongest_of_one_of_its_photographs():
    counts = {(0, 1): 100, (1, 2): 50, (0, 2): 49, (2, 3): 20, (3, 4): 60}
    assert agreement.strong_pairs(counts) == [(0, 1), (1, 2), (0, 2), (3, 4)]
    assert agreement.strong_pairs({}) == []


def test_few_contradictions_are_not_told():
    rows = ((0, 0, 0), (20, 1, 0), (20, 2, 1), (400, 4, 0), (400, 5, 1))
    for strong, contradicting, told in rows:
        assert len(agreement.Agreement(strong, contradicting).sentences()) == told


def test_pairs_with_few_matches_contradict_nothing(found, monkeypatch):
    kept, right = found
    poses = right.poses.copy()
    moved(poses)
    wrong = replace(right, poses=poses)
    assert agreement.agreement(kept, wrong).contradicting
    monkeypatch.setattr(agreement, "ENOUGH", 10_000)
    assert not agreement.agreement(kept, wrong).contradicting


def test_two_things_that_look_alike_are_told(call, trainer, tmp_path):
    """Mostly all photographs get a camera, and it is wrong; or too few of them fit together.

    Features are found by several threads, so their order differs, and with it what RANSAC draws.
    """
    poses, folder = circle(24, radius=4.2, height=2.0), tmp_path / "photos"
    write_twins(folder, poses, np.random.default_rng(1))
    result = call(train.main, folder, "-o", tmp_path / "m.npz", "--check")
    if result.code:
        for words in ("fit together", "things look alike", "newspaper"):
            assert words in result.err
        return
    views = load_dataset(folder, "train")
    centers, _ = similarity_errors(views.poses, poses[[int(name) for name in views.names]])
    assert np.median(centers) > 0.1  # of right ones 0.02 at most (test_cameras.py)
    (doubt,) = doubts_about(folder)
    assert "things look alike" in doubt and "newspaper" in doubt
    assert result.out.count(doubt) == 2, "where the cameras are found, and with the page"


def test_photographs_that_do_not_fit_together_are_told_as_well(found):
    """With cameras of less than half of them."""
    kept, right = found
    poses = np.concatenate([right.poses[: COUNT // 4]] * 2)
    part = replace(right, poses=poses, numbers=right.numbers[: COUNT // 2])
    with pytest.raises(CaptureError, match=r"only 8 of 16 .* 9 are needed; .* things look alike"):
        cameras.check_mapped("photos", kept, part)


def test_groups_that_matches_connect_are_not_said_to_show_nothing_in_common(found):
    kept, right = found
    half = slice(COUNT // 2)
    groups = tuple(tuple(range(first, first + COUNT // 2)) for first in (0, COUNT // 2))
    part = replace(right, poses=right.poses[half], numbers=right.numbers[half], groups=groups)
    with pytest.raises(CaptureError, match="2 groups that share something, but do not fit") as told:
        cameras.check_mapped("photos", kept, part)
    assert "one thing at a time" in str(told.value) and "\n" not in str(told.value)


@pytest.mark.parametrize(
    "text",
    [
        '{"made_by": "deformrf-train", "frames": []}',
        '{"made_by": "deformrf-train", "agreement": {"strong": "many", "contradicting": 3}}',
        '{"made_by": "deformrf-train", "agreement": [9, 9]}',
        '{"made_by": "deformrf-train", "agreement"',
        '{"agreement": {"strong": 9, "contradicting": 9}}',
    ],
)
def test_files_that_say_nothing_of_it_raise_no_doubt(tmp_path, text):
    assert doubts_about(tmp_path) == []
    (tmp_path / "transforms.json").write_text(text)
    assert doubts_about(tmp_path) == []
    (tmp_path / "transforms.json").write_text(
        json.dumps({"made_by": "deformrf-train", "agreement": {"strong": 9, "contradicting": 9}})
    )
    assert len(doubts_about(tmp_path)) == 1
