"""Camera paths: files of keys, and what a film's camera does with them."""

import json
import math
from types import SimpleNamespace

import numpy as np
import posed_data
import pytest
from posed_data import PHONE, circle, transforms, write_frames

from deformrf.core.render import Camera, camera_rays, in_space, look_at
from deformrf.core.training import load_dataset
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.document import orbit_at
from deformrf.viewer.films import Film, load_camera_path
from deformrf.viewer.films.camera_path import CameraPathError

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
        np.testing.assert_allclose(key.orbit.pose, wanted, atol=1e-9)
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
        np.testing.assert_allclose(key.orbit.pose, rolled, atol=1e-9)


def test_cameras_of_a_data_set_are_in_its_space(tmp_path):
    matrix = np.diag([0.25, 0.25, 0.25, 1.0])
    matrix[:3, 3] = 0.5
    poses = [look_at(at, [0.0, 0.0, 0.0]) for at in ([4.0, 0, 1], [0, 4.0, 1])]
    frames = [{"file_path": "a", "transform_matrix": pose.tolist()} for pose in poses]
    keys = loaded(tmp_path, {"camera_angle_x": 0.7, "frames": frames}, matrix)
    assert [key.tick for key in keys] == [0, 60]
    np.testing.assert_allclose(keys[0].orbit.pose[:3, 3], [1.5, 0.5, 0.75])
    np.testing.assert_allclose(keys[1].orbit.pose[:3, :3], poses[1][:3, :3], atol=1e-9)
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
        ([PLACE, {"transform_matrix": [*np.eye(4)[:3].tolist(), [3, 0, 0, 1]]}], "not a rotation"),
    ],
)
def test_what_is_no_path_is_explained(tmp_path, content, sentence):
    with pytest.raises(CameraPathError) as raised:
        loaded(tmp_path, content)
    assert sentence in str(raised.value) and "\n" not in str(raised.value)


# -- the cameras of data sets ---------------------------------------------------------------------

PORTRAIT = {"fl_x": 40.0, "fl_y": 40.0, "w": 30, "h": 40}
FOV = math.degrees(2 * math.atan(20 / 40))  # its vertical one
ANGLES = {"camera_angle_x": 2 * math.atan(15 / 40)}
TWO = {i % 2: size for i, size in enumerate([(30, 40), (40, 30)])}


def turned(i):
    """Intrinsics of portrait and landscape in turn."""
    width, height = TWO[i % 2]
    return {"w": width, "h": height, "fl_x": 39.0 + i, "cx": 0.48 * width, "k1": 0.01 * i}


LAYOUTS = {
    "lens and axis of all": lambda f: transforms(f, **PHONE),
    "fl_x alone": lambda f: transforms(f, fl_x=40.0, w=30, h=40),
    "fl_x without a size": lambda f: transforms(f, fl_x=40.0),
    "all per frame": lambda f: transforms(f, per_frame=turned, sizes=list(TWO.values())),
    "per frame over all": lambda f: transforms(f, per_frame=lambda i: {"fl_x": 50.0 + i}, **PHONE),
    "angle of a portrait": lambda f: transforms(f, **ANGLES),
    "angle and size": lambda f: transforms(f, w=30, h=40, **ANGLES),
    "smaller images": lambda f: transforms(f, sizes=[(23, 31)], **PHONE | {"k1": 0.0, "k2": 0.0}),
    "far origin": lambda f: transforms(f, offset=(448000, 5411000, 312), **PHONE),
    "nsvf": posed_data.nsvf,
    "colmap": posed_data.colmap,
    "polycam": posed_data.polycam,
    "record3d": posed_data.record3d,
    **{
        name: name
        for name in ("chair", "mic", "helmet", "helmet_twist", "foxrig", "shiny", "fox_capture")
    },
}


def film_of(path, world_to_model, size):
    """A film whose camera is a data set's, with that size in pixels."""
    keys = load_camera_path(path, world_to_model, CENTER, size)
    return Film(SimpleNamespace(orbit=orbits.Orbit()), None, 30, path=keys), keys


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_film_along_a_data_set_has_the_rays_that_training_takes(tmp_path, layout, shared_data):
    """At the photographs' sizes; a similarity with a turn takes the world to the model."""
    make = LAYOUTS[layout]
    folder = shared_data(make) if isinstance(make, str) else make(tmp_path / "data")
    file = next((p for p in sorted(folder.glob("transforms*.json"))), None)
    split = "test" if file and file.name == "transforms_test.json" else "train"
    data = load_dataset(folder, split, **({"view_count": 3} if isinstance(make, str) else {}))
    turn = np.linalg.qr(np.random.default_rng().normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    world_to_model = np.eye(4)
    world_to_model[:3, :3] = 0.2 * turn
    world_to_model[:3, 3] = 0.5 - 0.2 * turn @ np.median(data.poses[:, :3, 3], axis=0)
    poses = in_space(data.poses, world_to_model)
    for view in range(data.view_count):
        lens = data.lenses[view]
        film, keys = film_of(file or folder, world_to_model, (lens.width, lens.height))
        seen = [film.camera(key.tick, lens.width, lens.height) for key in keys]
        apart = [np.abs(camera.position - poses[view, :3, 3]).max() for camera in seen]
        camera = seen[int(np.argmin(apart))]
        wanted = camera_rays(Camera(poses[view], lens))
        for mine, theirs in zip(camera_rays(camera), wanted, strict=True):
            np.testing.assert_allclose(mine, theirs, atol=2e-6)


def test_between_two_photographs_the_lens_is_between_theirs(tmp_path):
    folder = transforms(tmp_path, count=3, per_frame=lambda i: {"fl_x": 40.0 + 4 * i}, **PHONE)
    film, keys = film_of(folder, UNCHANGED, (30, 40))
    lenses = [film.camera(tick, 30, 40).lens for tick in (0.0, 30.0, 60.0)]
    assert lenses[0].focal[0] == pytest.approx(40.0)
    assert lenses[0].focal[0] < lenses[1].focal[0] < lenses[2].focal[0] == pytest.approx(44.0)
    assert type(film.orbit(30.0)) is type(keys[0].orbit) is not orbits.Orbit
    film.show(15)
    assert type(film.scene.orbit) is orbits.Orbit  # as scenes and sessions have them
    assert film.scene.orbit.field_of_view == pytest.approx(film.orbit(30.0).field_of_view)


@pytest.mark.parametrize("size", [(30, 40), (60, 80), (120, 60), (40, 40)])
def test_a_film_of_another_size_has_the_photographs_vertical_field_of_view(tmp_path, size):
    film, _ = film_of(transforms(tmp_path, **PORTRAIT), UNCHANGED, size)
    lens = film.camera(0.0, *size).lens
    assert math.degrees(2 * math.atan(0.5 * size[1] / lens.focal[1])) == pytest.approx(FOV)
    assert lens.center == pytest.approx((size[0] / 2, size[1] / 2))
    assert lens.focal[0] == pytest.approx(lens.focal[1])


def test_a_film_that_is_too_wide_for_the_distortion_goes_without_it(tmp_path, caplog):
    folder = transforms(tmp_path, **PHONE | {"k1": -0.25, "k2": 0.0})
    film, _ = film_of(folder, UNCHANGED, (30, 40))
    assert film.camera(0.0, 30, 40).lens.is_distorted and not caplog.records
    film, _ = film_of(folder, UNCHANGED, (160, 40))
    assert not film.camera(0.0, 160, 40).lens.is_distorted
    assert "160x40 pixels shows more at its borders" in caplog.text


@pytest.mark.parametrize("head", [PORTRAIT, ANGLES | {"w": 30, "h": 40}, "per frame", "angles"])
def test_images_need_not_be_there_where_a_size_or_angles_are_stated(tmp_path, head):
    angles = ANGLES | {"camera_angle_y": math.radians(FOV)}
    head = {"angles": angles, "per frame": {}}.get(head, head) if isinstance(head, str) else head
    own = {} if head else PORTRAIT
    frames = [{"file_path": "gone", "transform_matrix": p.tolist(), **own} for p in circle(3)]
    keys = loaded(tmp_path, {"frames": frames, **head})
    assert [math.degrees(key.orbit.field_of_view) for key in keys] == pytest.approx([FOV] * 3)


def test_an_image_that_is_neither_there_nor_has_a_size_is_taken_for_square_and_told(
    tmp_path, caplog
):
    frames = [{"transform_matrix": p.tolist()} for p in circle(3)]
    keys = loaded(tmp_path, {"frames": frames, "camera_angle_x": 0.7})
    assert keys[0].orbit.field_of_view == pytest.approx(0.7)
    assert "(w, h) of 3 of 3 images" in caplog.text and "taken for square" in caplog.text


def test_frames_without_intrinsics_are_keys_as_ever(tmp_path):
    frames = [{"transform_matrix": p.tolist(), "fov": 50} for p in circle(3)]
    assert loaded(tmp_path, {"frames": frames})[0].orbit.field_of_view == pytest.approx(
        math.radians(50)
    )


@pytest.mark.parametrize(
    "change, sentence",
    [
        ({"camera_model": "OPENCV_FISHEYE"}, "which is no perspective camera: undistort"),
        ({"is_fisheye": True}, "no perspective camera"),
        ({"fl_x": "wide"}, "fl_x = 'wide'"),
        ({"k1": -9.0}, "have no ray"),
        ({"w": 40, "h": 30}, "says that images have 40x30 pixels, but"),
        ({"offset": (1e6, 0, 0)}, "model sizes away: is this the data set of this model?"),
        ({"count": 1}, "a camera path has 2 to 10,000 keys"),
        ({"per_frame": lambda i: {"transform_matrix": [[1]]}}, "has to be 4 rows"),
    ],
)
def test_cameras_that_cant_be_filmed_are_refused_in_one_sentence(tmp_path, change, sentence):
    folder = transforms(tmp_path, **PHONE | change)
    with pytest.raises(CameraPathError) as caught:
        load_camera_path(folder / "transforms.json", UNCHANGED, CENTER)
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


def test_a_folder_without_cameras_is_no_path(tmp_path):
    with pytest.raises(CameraPathError, match=r"holds no transforms\.json \(transforms files"):
        load_camera_path(tmp_path, UNCHANGED, CENTER)
    write_frames(tmp_path, [])
    with pytest.raises(CameraPathError):
        load_camera_path(tmp_path, UNCHANGED, CENTER)


# -- nerfstudio's ---------------------------------------------------------------------------------


def nerfstudios(offset=(0, 0, 0), **more):
    pose = look_at([4.0, 0.0, 1.0], [0.0, 0.0, 0.0])
    pose[:3, 3] += offset
    return {"camera_path": 3 * [{"camera_to_world": pose.ravel().tolist(), "fov": 60}], **more}


@pytest.mark.parametrize("kind", ["fisheye", "equirectangular", 3])
def test_pictures_that_are_no_pinholes_are_refused(tmp_path, kind):
    with pytest.raises(CameraPathError, match=f"has camera_type {kind!r}: only 'perspective'"):
        loaded(tmp_path, nerfstudios(camera_type=kind))
    assert len(loaded(tmp_path, nerfstudios(camera_type="perspective"))) == 3


def test_whose_space_a_path_of_nerfstudio_has_to_be_in_is_told(tmp_path, caplog):
    loaded(tmp_path, nerfstudios())
    assert "fits if nerfstudio trained without centering and scaling" in caplog.text


@pytest.mark.parametrize("kind", ["camera_path", "frames"])
def test_far_origins_are_no_matter_of_the_path(tmp_path, kind):
    far = np.array([412345.6, 5431234.5, 312.0])
    content = nerfstudios(far)
    if kind == "frames":  # without intrinsics
        rows = content["camera_path"][0]["camera_to_world"]
        content = {"frames": 2 * [{"transform_matrix": np.reshape(rows, (4, 4)).tolist()}]}
    to_model = np.eye(4)
    to_model[:3, 3] = -far
    pose = loaded(tmp_path, content, to_model)[0].orbit.pose
    np.testing.assert_allclose(pose, look_at([4.0, 0.0, 1.0], [0.0, 0.0, 0.0]), atol=1e-6)
    with pytest.raises(CameraPathError, match="model sizes away: is this the space of"):
        loaded(tmp_path, content)


def test_what_a_sentence_quotes_of_a_data_set_can_be_printed(tmp_path):
    folder = transforms(tmp_path / "data", **PHONE)
    path = folder / "transforms.json"
    scene = json.loads(path.read_text())
    scene["frames"][2] |= {"file_path": "a\x1b[2J\nb.png", "transform_matrix": [[1.0] * 4] * 4}
    path.write_text(json.dumps(scene))
    with pytest.raises(CameraPathError, match="transform_matrix") as caught:
        load_camera_path(path, np.eye(4), np.zeros(3), (64, 48))
    assert str(caught.value).isprintable()
