"""transforms.json as instant-ngp and nerfstudio write it."""

import json

import numpy as np
import pytest
from colmap_files import write_capture
from PIL import Image, ImageOps

from deformrf.core.render import Camera, camera_rays
from deformrf.core.training import DatasetError, NoSplitError, load_dataset

PHONE = {
    "fl_x": 40.0, "fl_y": 41.0, "cx": 15.5, "cy": 21.0, "w": 30, "h": 40,
    "k1": 0.05, "k2": -0.08, "p1": -1e-3, "p2": 2e-4,
}  # fmt: skip


def write(folder, count=9, sizes=None, per_frame=None, name="transforms.json", **scene):
    """Random images in images/, listed in a JSON; `per_frame` goes to frame i."""
    rng = np.random.default_rng()
    (folder / "images").mkdir(parents=True, exist_ok=True)
    frames = []
    for i in range(count):
        width, height = (sizes or {}).get(i, (30, 40))
        pixels = rng.integers(0, 256, (height, width, 3), np.uint8)
        Image.fromarray(pixels).save(folder / f"images/{i:04d}.png")
        pose = np.eye(4)
        pose[0, 3] = i
        frame = {"file_path": f"images/{i:04d}.png", "transform_matrix": pose.tolist()}
        frames.append(frame | (per_frame or {}).get(i, {}))
    (folder / name).write_text(json.dumps({**PHONE, "frames": frames, **scene}))
    return folder


def test_intrinsics_and_distortion_are_read(tmp_path):
    dataset = load_dataset(write(tmp_path), "train")
    lens = dataset.lenses[0]
    assert (lens.focal, lens.center) == ((40.0, 41.0), (15.5, 21.0))
    assert (lens.radial, lens.tangential) == ((0.05, -0.08, 0.0, 0.0), (-1e-3, 2e-4))
    assert not dataset.has_alpha


def test_every_eighth_view_of_a_common_file_is_for_testing(tmp_path):
    write(tmp_path, count=17)
    train, test = (load_dataset(tmp_path, split) for split in ("train", "test"))
    assert test.names == ("0000", "0008", "0016")
    assert len(train.names) == 14
    assert not set(train.names) & set(test.names)


def test_nerfstudios_lists_are_followed(tmp_path):
    names = [f"images/{i:04d}.png" for i in range(9)]
    write(tmp_path, train_filenames=names[:4], val_filenames=names[4:6], test_filenames=names[6:])
    assert load_dataset(tmp_path, "train").names == ("0000", "0001", "0002", "0003")
    assert load_dataset(tmp_path, "test").names == ("0006", "0007", "0008")
    write(tmp_path, train_filenames=names[:4], val_filenames=names[4:6])
    assert load_dataset(tmp_path, "test").names == ("0004", "0005")


def test_a_common_file_is_no_test_split_of_one_that_has_its_own(tmp_path):
    """Else training views would be scored."""
    write(tmp_path)
    write(tmp_path, name="transforms_train.json")
    assert len(load_dataset(tmp_path, "train").names) == 9
    with pytest.raises(NoSplitError, match=r"transforms_test\.json"):
        load_dataset(tmp_path, "test")


def test_only_a_split_without_views_is_no_test_split(tmp_path):
    """A test view that can't be read is a mistake, and the error names it."""
    write(tmp_path / "bad", per_frame={8: {"transform_matrix": [[1, 2], [3, 4]]}})
    assert load_dataset(tmp_path / "bad", "train").view_count == 7
    with pytest.raises(DatasetError, match=r"transform_matrix of images/0008\.png"):
        load_dataset(tmp_path / "bad", "test")
    write(tmp_path / "one", count=1)
    write(tmp_path / "all", train_filenames=[f"images/{i:04d}.png" for i in range(9)])
    for name in ("one", "all"):
        with pytest.raises(NoSplitError):
            load_dataset(tmp_path / name, "test")


def test_frames_may_have_their_own_lens(tmp_path):
    """Portrait and landscape in one folder."""
    turned = {"w": 40, "h": 30, "cx": 21.0, "cy": 14.5, "fl_x": 39.0, "k1": 0.0, "k2": 0.0}
    write(tmp_path, sizes={3: (40, 30)}, per_frame={3: turned})
    dataset = load_dataset(tmp_path, "train")
    landscape = dataset.lenses[dataset.names.index("0003")]
    assert (landscape.width, landscape.height) == (40, 30)
    assert (landscape.focal, landscape.center) == ((39.0, 41.0), (21.0, 14.5))
    assert dataset.lenses[0].radial[0] == 0.05
    assert landscape.radial == (0.0,) * 4


def test_images_smaller_than_the_json_says_keep_their_rays(tmp_path):
    """As with instant-ngp's images_2/ folders."""
    full = load_dataset(write(tmp_path / "full"), "train").lenses[0]
    sizes = dict.fromkeys(range(9), (15, 20))
    half = load_dataset(write(tmp_path / "half", sizes=sizes), "train").lenses[0]
    assert half == full.resized(15, 20)
    corner = [camera_rays(Camera(np.eye(4), lens))[1][0] for lens in (full, half)]
    np.testing.assert_allclose(*corner, atol=0.02)


def test_missing_images_are_counted(tmp_path):
    write(tmp_path)
    (tmp_path / "images/0002.png").unlink()
    dataset = load_dataset(tmp_path, "train")
    assert dataset.missing == ("images/0002.png",)
    assert len(dataset.names) == 6


def test_a_scaled_pose_is_taken_without_its_scale(tmp_path):
    pose = np.diag([2.0, 2.0, 2.0, 1.0])
    write(tmp_path, per_frame={1: {"transform_matrix": pose.tolist()}})
    np.testing.assert_allclose(load_dataset(tmp_path, "train").poses[0], np.eye(4))


MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()


@pytest.mark.parametrize(
    "change, sentence",
    [
        ({"camera_model": "OPENCV_FISHEYE"}, "'OPENCV_FISHEYE', which is no perspective"),
        ({"is_fisheye": True}, "no perspective camera"),
        ({"fl_x": "wide"}, "fl_x = 'wide'"),
        ({"fl_x": 0.0}, "focal lengths 0 and"),
        ({"fl_x": float("nan")}, "not all finite"),
        ({"cx": 300.0}, r"principal point \(300, 21\) lies outside"),
        ({"k1": -9.0}, "some of the 30x40 pixels have no ray"),
        ({"w": 40, "h": 30}, "says that images have 40x30 pixels, but images/.* has 30x40"),
        ({"per_frame": {1: {"transform_matrix": MIRRORED}}}, "skew or mirrored"),
        ({"per_frame": {1: {"transform_matrix": [[0.0] * 4] * 4}}}, "axis has no length"),
    ],
)
def test_unusable_files_are_refused_in_one_sentence(tmp_path, change, sentence):
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(write(tmp_path, **change), "train")
    assert "\n" not in str(caught.value)


def test_the_fox_capture_is_read(shared_data):
    folder = shared_data("fox_capture")
    train, test = (load_dataset(folder, split, image_size=120) for split in ("train", "test"))
    assert (train.view_count, test.view_count) == (43, 7)
    assert (train.lenses[0].width, train.lenses[0].height) == (68, 120)
    assert train.lenses[0].is_distorted


BIG = 10**400  # as an integer it fits into no float


@pytest.mark.parametrize(
    "change, sentence",
    [
        ({"fl_x": BIG}, "are not all finite"),
        ({"w": BIG}, "infx40"),
        ({"w": 0}, "0x40"),
        ({"w": -30, "h": -40}, "-30x-40"),
        ({"w": 1e-308, "h": 1e308}, r"1e-308x1e\+308"),
        ({"k1": BIG}, "are not all finite"),
        ({"cx": True}, "cx = True: it has to be a number"),
        ({"camera_model": []}, r"camera_model \[\], which is no"),
        ({"camera_model": {}}, r"camera_model \{\}, which is no"),
        ({"train_filenames": 5}, "train_filenames = 5.0: it has to be a list of names"),
        ({"train_filenames": [[]]}, r"train_filenames = \[\[\]\]: it has to be a list"),
        ({"per_frame": {1: {"transform_matrix": [[BIG] * 4] * 4}}}, "4 finite numbers"),
        ({"per_frame": {1: {"transform_matrix": [[1e300] * 4] * 4}}}, r"up to 1e\+12"),
        ({"per_frame": {1: {"transform_matrix": {"a": 1}}}}, "4 finite numbers"),
        ({"per_frame": {1: {"camera_model": [1]}}}, r"camera_model \[1.0\]"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_values_of_another_kind_are_named(tmp_path, change, sentence):
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(write(tmp_path, **change), "train")
    assert "\n" not in str(caught.value)


NASTY = (
    None, True, -1, 0.5, 1e-320, 1e308, BIG, float("nan"), "", "\ud800", "a\0\n", "..", "/dev/zero",
    "x" * 5000, [], [[]], {}, {"a": 1}, [[0] * 4] * 4, [["a"] * 4] * 4, [[1e300] * 4] * 4,
)  # fmt: skip


def places(value):
    """The holder and the key of every value in a JSON value."""
    for key in list(value) if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from places(value[key])


@pytest.mark.filterwarnings("error")
def test_whatever_a_scene_holds_it_is_read_or_refused(tmp_path):
    """Up to three of its values are replaced by nasty ones."""
    rng = np.random.default_rng()
    scene = json.loads((write(tmp_path, count=4) / "transforms.json").read_text())
    scene |= {"train_filenames": ["images/0001.png"], "camera_model": "OPENCV", "is_fisheye": 0}
    scene["made_by"] = "deformrf-train"
    for frame in scene["frames"]:
        frame |= {"mask_path": frame["file_path"], "time": 0.5, "ring": 1}
    counts = {True: 0, False: 0}
    for _ in range(400):
        changed = json.loads(json.dumps(scene))
        for _ in range(rng.integers(1, 4)):
            found = list(places(changed))
            holder, key = found[rng.integers(len(found))]
            holder[key] = json.loads(json.dumps(NASTY[rng.integers(len(NASTY))]))
        (tmp_path / "transforms.json").write_text(json.dumps(changed))
        try:
            load_dataset(tmp_path, "train")
            counts[True] += 1
        except DatasetError:
            counts[False] += 1
    assert min(counts.values()) > 20, counts


def test_null_is_no_value(tmp_path):
    without = dict.fromkeys(("w", "h", "cx", "cy", "fl_y", "k1", "p1", "camera_model"))
    (lens,) = load_dataset(write(tmp_path, count=2, **without), "train").lenses
    assert (lens.focal, lens.center) == ((40.0, 40.0), (15.0, 20.0))


def test_json_that_is_no_scene_is_refused_quickly(tmp_path):
    """Nested deeply, with a number of a million digits, or endless."""
    path = write(tmp_path) / "transforms.json"
    for text in ("[" * 100_000, '{"frames": 1' + "0" * 1_000_000 + "}"):
        path.write_text(text)
        with pytest.raises(DatasetError, match=r"transforms\.json"):
            load_dataset(tmp_path, "train")
    with path.open("wb") as file:
        file.truncate(2**33)  # takes no space on the disk
    with pytest.raises(
        DatasetError, match=r"transforms\.json can't be read: it is larger than 64 MiB"
    ):
        load_dataset(tmp_path, "train")


@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "\ud800", "images", "."])
def test_a_path_that_no_file_can_have_is_a_missing_image(tmp_path, name):
    write(tmp_path, per_frame={1: {"file_path": name}}, name="transforms_train.json")
    assert load_dataset(tmp_path, "train").missing == (name,)


def turn(folder, number):
    """Give image 1 an EXIF orientation; the image as stored, and as that turns it."""
    path, exif = folder / "images/0001.png", Image.Exif()
    exif[0x0112] = number
    Image.open(path).save(path, exif=exif)
    return np.asarray(Image.open(path)), np.asarray(ImageOps.exif_transpose(Image.open(path)))


@pytest.mark.parametrize("number", range(1, 9))
def test_the_stated_size_tells_whether_cameras_are_those_of_turned_images(tmp_path, number):
    """COLMAP's and instant-ngp's are not."""
    stored, _ = turn(write(tmp_path / "as stored", count=2), number)
    image = load_dataset(tmp_path / "as stored", "train").image(0)
    np.testing.assert_array_equal(image[..., :3], stored)
    _, turned = turn(write(tmp_path / "turned", count=2, sizes={1: (40, 30)}), number)
    if number < 5:  # it has 40x30 pixels, either way up
        with pytest.raises(DatasetError, match=r"30x40 pixels, but .* has 40x30"):
            load_dataset(tmp_path / "turned", "train")
    else:
        image = load_dataset(tmp_path / "turned", "train").image(0)
        np.testing.assert_array_equal(image[..., :3], turned)


def test_without_a_stated_size_a_turned_image_is_refused(tmp_path):
    write(tmp_path, count=2, w=None, h=None)
    turn(tmp_path, 6)
    with pytest.raises(DatasetError, match=r"0001\.png has EXIF orientation 6, .*store it upright"):
        load_dataset(tmp_path, "train")


@pytest.mark.parametrize("way", ["..", "absolute", "link", "linked folder"])
def test_images_outside_the_folder_are_refused_unless_asked_for(tmp_path, way):
    folder, other = write(tmp_path / "data", count=2), write(tmp_path / "other", count=2)
    name = "images/0001.png"
    if way == "..":
        write(folder, count=2, per_frame={1: {"file_path": f"../other/{name}"}})
    elif way == "absolute":
        write(folder, count=2, per_frame={1: {"file_path": str(other / name)}})
    else:
        inner, target = (name, other / name) if way == "link" else ("images", other / "images")
        (folder / inner).rename(tmp_path / "before")
        (folder / inner).symlink_to(target)
    for split in ("train", "test"):
        try:
            load_dataset(folder, split)
        except DatasetError as error:
            assert "lies outside the data set's folder" in str(error)
            break
    else:
        pytest.fail("both splits were read")
    expected = np.asarray(Image.open(other / name))
    dataset = load_dataset(folder, split, outside=True)
    assert any((dataset.image(i)[..., :3] == expected).all() for i in range(dataset.view_count))


def test_a_link_to_the_data_set_is_no_way_out(tmp_path):
    (tmp_path / "link").symlink_to(write(tmp_path / "data"))
    assert load_dataset(tmp_path / "link", "train").view_count == 7


def test_no_split_is_read_of_another_layouts_cameras(tmp_path):
    write(tmp_path, name="transforms_train.json")
    write_capture(tmp_path)
    with pytest.raises(NoSplitError, match=r"holds no transforms_test\.json"):
        load_dataset(tmp_path, "test")


@pytest.mark.parametrize("half", [(15, 20), (90, 120)])
def test_intrinsics_of_images_in_another_size_need_that_size(tmp_path, half):
    unsized = {"w": None, "h": None, "k1": 0, "k2": 0, "p1": 0, "p2": 0}
    write(tmp_path / "a", sizes=dict.fromkeys(range(9), half), **unsized)
    with pytest.raises(DatasetError, match=r"cx = 15\.5 and no w, .*: add the w and h"):
        load_dataset(tmp_path / "a", "train")
    known = write(tmp_path / "b", **unsized | {"w": 30, "h": 40})
    unknown = write(tmp_path / "c", **unsized)
    assert load_dataset(known, "train").lenses == load_dataset(unknown, "train").lenses


def test_images_that_were_shrunk_by_8_have_rounded_sides(tmp_path):
    whole = {"w": 480, "h": 270, "cx": 240, "cy": 135, "fl_x": 400, "fl_y": 400}
    write(tmp_path, sizes=dict.fromkeys(range(9), (60, 33)), **whole)
    assert load_dataset(tmp_path, "train").lenses[0].focal == pytest.approx((50, 400 * 33 / 270))
    write(tmp_path, sizes=dict.fromkeys(range(9), (60, 32)), **whole)
    with pytest.raises(DatasetError, match="turned or cropped"):
        load_dataset(tmp_path, "train")


@pytest.mark.parametrize("scene", ["root", "frame"])
def test_transposed_matrices_are_refused(tmp_path, scene):
    write(tmp_path)
    path = tmp_path / "transforms.json"
    content = json.loads(path.read_text())
    for frame in content["frames"][1:] if scene == "root" else content["frames"][5:6]:
        frame["transform_matrix"] = np.transpose(frame["transform_matrix"]).tolist()
    path.write_text(json.dumps(content))
    sentence = (
        "0 0 0 1, and ends in 5 0 0 1: if it is transposed" if scene == "frame" else "1 0 0 1"
    )
    with pytest.raises(DatasetError, match=sentence):
        load_dataset(tmp_path, "train")


def test_the_objects_box_is_read(tmp_path):
    write(tmp_path, object_box=[[-1, -2, 0.5], [1.5, 2, 3]])
    found = load_dataset(tmp_path, "train").bounds
    np.testing.assert_array_equal(found, [[-1, -2, 0.5], [1.5, 2, 3]])


@pytest.mark.parametrize(
    "box", [None, 5, [[1, 2, 3]], [[1, 2, "a"], [3, 4, 5]], [[0] * 3, [1e999] * 3]]
)
def test_a_box_that_is_none_is_refused(tmp_path, box):
    write(tmp_path, object_box=box)
    with pytest.raises(DatasetError, match="object_box that is not two corners"):
        load_dataset(tmp_path, "train")


def test_rings_are_read_where_there_are_masks(tmp_path):
    """Without masks nobody needs them."""
    frames = {i: {"mask_path": f"images/{i:04d}.png"} for i in range(9)}
    for i, ring in ((1, 2), (3, None), (4, 0)):
        frames[i]["ring"] = ring
    write(tmp_path, per_frame=frames, made_by="deformrf-train")
    rings = load_dataset(tmp_path, "train").rings
    np.testing.assert_array_equal(rings, [2, -1, -1, 0, -1, -1, -1])
    write(tmp_path, per_frame={1: {"ring": 2}}, made_by="deformrf-train")
    assert load_dataset(tmp_path, "train").rings is None
    write(tmp_path, per_frame=frames)  # another program's numbers mean something else
    assert (load_dataset(tmp_path, "train").rings == -1).all()


@pytest.mark.parametrize("ring", ["a", -1, 0.5, 1e999, True, [1]])
def test_a_ring_that_is_none_is_refused(tmp_path, ring):
    write(tmp_path, per_frame={1: {"ring": ring}}, made_by="deformrf-train")
    with pytest.raises(DatasetError, match=r"ring = .*: it has to be a whole number"):
        load_dataset(tmp_path, "train")
