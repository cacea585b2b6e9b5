"""Bones and matrices in JSON."""

import json

import numpy as np
import pytest

from deformrf.wings.rig import read_matrices


def values():
    lift = np.eye(4)
    lift[2, 3] = 0.5
    bones = [
        {"name": "b", "parent": "a", "head": [0, 0, 1], "tail": [0, 0, 2]},
        {"name": "a", "parent": None, "head": [0, 0, 0], "tail": [0, 0, 1]},
    ]
    samples = [
        {"time": t, "skinning_matrices": {"a": np.eye(4).tolist(), "b": m.tolist()}}
        for t, m in ((0.0, np.eye(4)), (1.0, lift))
    ]
    return {"bones": bones, "clips": {"Up": {"duration": 1.5, "samples": samples}}}


def test_matrices_come_back(tmp_path):
    (tmp_path / "rig.json").write_text(json.dumps(values()))
    rig = read_matrices(tmp_path / "rig.json")
    assert rig.skeleton.names == ("a", "b") and rig.skeleton.parents.tolist() == [-1, 0]
    (clip,) = rig.clips
    assert clip.duration == 1.5
    found = clip.matrices_at(rig.skeleton, 0.5)
    np.testing.assert_allclose(found[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(found[1, :3, 3], [0, 0, 0.25], atol=1e-12)


def changed(*path, value):
    found = values()
    place = found
    for key in path[:-1]:
        place = place[key]
    if value is KeyError:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return found


SAMPLE = ("clips", "Up", "samples", 1)


@pytest.mark.parametrize(
    "content, sentence",
    [
        (changed("bones", 0, "parent", value="c"), "'c', is missing"),
        (changed("bones", 1, "parent", value="b"), "its own ancestor"),
        (changed("bones", 0, "name", value="a"), "two bones|its own ancestor"),
        (changed("bones", 0, "head", value=[1, 2]), "not three numbers"),
        (changed("bones", 0, "head", value="a\nb"), "is a b, not three numbers"),
        (changed("bones", 0, "head", value=[0, 1e300, 0]), "beyond 1e"),
        (changed("bones", 0, "head", value=[0, float("nan"), 0]), "beyond 1e"),
        (changed("bones", 0, "head", value=[0, 10**400, 0]), "no file of bones"),
        (changed("bones", value=[]), "no list of 1 to"),
        (changed("bones", value=KeyError), "no file of bones and matrices"),
        (changed(*SAMPLE, "skinning_matrices", "b", value=KeyError), "no matrix of bone 'b'"),
        (changed(*SAMPLE, "skinning_matrices", "b", 0, 0, value=float("nan")), "hold NaN"),
        (changed(*SAMPLE, "skinning_matrices", "b", value=[[1, 0], [0, 1]]), "rig.json"),
        (changed(*SAMPLE, "time", value=0.0), "not in order"),
        (changed("clips", "Up", "samples", value=[]), "has no samples"),
        ([1, 2], "no file of bones and matrices"),
    ],
)
def test_bad_files_end_in_one_sentence(tmp_path, content, sentence):
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=sentence) as caught:
        read_matrices(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_what_is_no_json_is_said_so(tmp_path):
    (tmp_path / "rig.json").write_bytes(b"\xff\xfe{")
    with pytest.raises(ValueError, match=r"rig\.json"):
        read_matrices(tmp_path / "rig.json")
    with pytest.raises(ValueError, match=r"none\.json"):
        read_matrices(tmp_path / "none.json")


def test_more_values_than_a_rig_has_are_refused_before_they_take_memory(tmp_path):
    path = tmp_path / "rig.json"
    path.write_text('{"bones": [' + "[]," * 2**22 + "[]]}")
    with pytest.raises(ValueError, match="more than 4194304 values"):
        read_matrices(path)


def test_long_names_are_not_printed_in_full(tmp_path):
    (tmp_path / "rig.json").write_text(json.dumps(changed("bones", 0, "parent", value="c" * 10**6)))
    with pytest.raises(ValueError, match="is missing") as caught:
        read_matrices(tmp_path / "rig.json")
    assert len(str(caught.value)) < 300 + len(str(tmp_path))
