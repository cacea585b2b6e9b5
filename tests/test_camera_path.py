"""Camera paths: files of keys, and what a film's camera does with them."""

import json

import numpy as np
import pytest

from deformrf.core.render import look_at
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.films.camera_path import CameraPathError, load_camera_path
from deformrf.viewer.timeline import orbit_at

CENTER, UNCHANGED = np.full(3, 0.5), np.eye(4)
PLACE = {"position": [2.0, 0.0, 1.0], "target": [0.5, 0.5, 0.4]}
OTHER = {"position": [0.0, 2.0, 1.5], "target": [0.4, 0.5, 0.5], "fov": 50}


def loaded(tmp_path, content, world_to_model=UNCHANGED):
    path = tmp_path / "path.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return load_camera_path(path, world_to_model, CENTER)


def test_the_camera_is_at_each_key_and_between_them(tmp_path):
    keys = loaded(tmp_path, {"keys": [{"t": 1.0, **PLACE}, {"t": 3.0, **OTHER}]})
    assert [key.tick for key in keys] == [0.0, 120.0]
    for key, place in zip(keys, (PLACE, OTHER), strict=True):
        wanted = look_at(place["position"], place["target"])
        np.testing.assert_allclose(orbits.pose_of(key.orbit), wanted, atol=1e-9)
        np.testing.assert_allclose(key.orbit.target, place["target"], atol=1e-9)
    assert np.degrees(keys[1].orbit.field_of_view) == pytest.approx(50)
    middle = orbit_at(keys, 60.0)
    np.testing.assert_allclose(middle.target, [0.45, 0.5, 0.45], atol=1e-9)
    assert orbit_at(keys, 999.0) is keys[1].orbit


def test_a_matrix_may_be_rolled(tmp_path):
    rolled = look_at([2.0, 0.0, 1.0], CENTER, up=(0.3, 0.2, 1.0))
    flat = rolled.ravel().tolist()
    content = [{"transform_matrix": rolled.tolist()}, {"t": 5, "transform_matrix": flat[:12]}]
    for key in loaded(tmp_path, content):
        np.testing.assert_allclose(orbits.pose_of(key.orbit), rolled, atol=1e-9)


def test_cameras_of_a_data_set_are_in_its_space(tmp_path):
    matrix = np.diag([0.25, 0.25, 0.25, 1.0])
    matrix[:3, 3] = 0.5
    poses = [look_at(at, [0.0, 0.0, 0.0]) for at in ([4.0, 0, 1], [0, 4.0, 1])]
    frames = [{"file_path": "a", "transform_matrix": pose.tolist()} for pose in poses]
    keys = loaded(tmp_path, {"camera_angle_x": 0.7, "frames": frames}, matrix)
    assert [key.tick for key in keys] == [0, 60]
    np.testing.assert_allclose(orbits.pose_of(keys[0].orbit)[:3, 3], [1.5, 0.5, 0.75])
    np.testing.assert_allclose(orbits.pose_of(keys[1].orbit)[:3, :3], poses[1][:3, :3], atol=1e-9)
    assert keys[0].orbit.field_of_view == pytest.approx(0.7)


def test_a_path_of_nerfstudio_has_its_own_rate(tmp_path):
    pose = look_at([4.0, 0.0, 1.0], [0.0, 0.0, 0.0]).ravel().tolist()
    entries = 7 * [{"camera_to_world": pose, "fov": 60, "aspect": 1.5}]
    keys = loaded(tmp_path, {"camera_path": entries, "fps": 6})
    assert keys[-1].tick == pytest.approx(60.0)
    assert np.degrees(keys[0].orbit.field_of_view) == pytest.approx(60)


@pytest.mark.parametrize(
    "content, sentence",
    [
        ("no JSON", "it is not JSON"),
        ('{"keys": NaN}', "it is not JSON"),
        (100_000 * "[", "it is not JSON"),
        ({"poses": []}, "no keys, frames or camera_path"),
        ({"keys": [PLACE]}, "has 2 to 10,000 keys"),
        ([PLACE, 3], "key 2 is not in braces"),
        ([{"t": 1, **PLACE}, {"t": 1, **OTHER}], "key 2 is at 1 s, not after"),
        ([PLACE, {"t": -1, **OTHER}], "key 2 has t = -1"),
        ([PLACE, {"t": 2, "fov": 500, **PLACE}], "fov = 500; 0.1 to 170"),
        ([PLACE, {"position": [1, 2]}], "has to be [x, y, z]"),
        ([PLACE, {"position": [1, 2, True]}], "has to be [x, y, z]"),
        ([PLACE, {"position": [1, 2, 3], "target": [1, 2, 3]}], "looks nowhere"),
        ([PLACE, {"t": 4}], "needs a position"),
        ([PLACE, {"transform_matrix": [[1, 2], [3]]}], "needs a position"),
        ([PLACE, {"transform_matrix": [[10**400] * 4] * 4}], "needs a position"),
        ([PLACE, {"transform_matrix": np.diag([1, -1, 1, 1]).tolist()}], "not a rotation"),
    ],
)
def test_what_is_no_path_is_explained(tmp_path, content, sentence):
    with pytest.raises(CameraPathError) as raised:
        loaded(tmp_path, content)
    assert sentence in str(raised.value) and "\n" not in str(raised.value)
