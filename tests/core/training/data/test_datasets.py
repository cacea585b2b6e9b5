import numpy as np
import pytest
from PIL import Image

from deformrf.core.render import look_at
from deformrf.core.training import (
    DatasetError,
    NoImagesError,
    NoSplitError,
    load_dataset,
    white_composite,
)
from deformrf.core.training.data import datasets

ANGLE = 0.7  # of the data sets that conftest.py writes


def view_image(index, size=(12, 8), mode="RGBA"):
    """Random pixels; size is (width, height)."""
    rng = np.random.default_rng(index)
    return Image.fromarray(rng.integers(0, 256, (size[1], size[0], len(mode)), np.uint8), mode)


def view_poses(count):
    """The poses that conftest.py writes."""
    eyes = [(4.0 * np.cos(view), 4.0 * np.sin(view), 1.0) for view in range(count)]
    return np.array([look_at(eye, (0.0, 0.0, 0.0)) for eye in eyes])


def sizes(dataset):
    return [(lens.width, lens.height) for lens in dataset.lenses]


def test_what_was_written_is_read(tmp_path, write_dataset):
    images = [view_image(i) for i in range(3)]
    dataset = load_dataset(write_dataset(tmp_path, images), "test")
    assert dataset.names == ("r_0", "r_1", "r_2")
    assert (sizes(dataset), dataset.split) == ([(12, 8)] * 3, "test")
    for view, image in enumerate(images):
        np.testing.assert_array_equal(dataset.image(view), image)
    np.testing.assert_allclose(dataset.poses, view_poses(3), atol=1e-12)


def test_the_outermost_pixel_edges_span_the_field_of_view(tmp_path, write_dataset):
    dataset = load_dataset(write_dataset(tmp_path, [view_image(0)]), "test")
    (lens,) = dataset.lenses
    assert np.arctan(0.5 * lens.width / lens.focal[0]) == pytest.approx(0.5 * ANGLE)
    assert lens.focal[0] == lens.focal[1]
    assert lens.center == (6.0, 4.0)
    assert not lens.is_distorted


@pytest.mark.parametrize("name", ["r_0.png", "r_0.webp", "r_0.v2.png"])
def test_the_ending_may_be_left_out(tmp_path, name, write_dataset):
    path = f"./test/{name.rsplit('.', 1)[0]}"
    write_dataset(tmp_path, [view_image(0)], names=[name], paths=[path])
    np.testing.assert_array_equal(load_dataset(tmp_path, "test").image(0), view_image(0))


def test_images_without_alpha_are_opaque(tmp_path, write_dataset):
    dataset = load_dataset(write_dataset(tmp_path, [view_image(0, mode="RGB")]), "test")
    np.testing.assert_array_equal(dataset.image(0)[..., :3], view_image(0, mode="RGB"))
    assert (dataset.pixels[:, 3] == 255).all()
    assert not dataset.has_alpha


def test_compositing_is_exact_where_alpha_is_0_or_255():
    pixels = np.array([[10, 20, 30, 0], [51, 102, 204, 255], [0, 0, 0, 51]], np.uint8)
    expected = [[1, 1, 1], [0.2, 0.4, 0.8], [0.8, 0.8, 0.8]]
    np.testing.assert_allclose(white_composite(pixels), expected, atol=1e-6)


def test_shrinking_averages_what_is_seen(tmp_path, write_dataset):
    """The mean of the composite, not of colors that alpha hides; the field of view stays."""
    full = load_dataset(write_dataset(tmp_path, [view_image(i) for i in range(4)]), "test")
    half = load_dataset(tmp_path, "test", image_size=6)
    assert sizes(half) == [(6, 4)] * 4
    np.testing.assert_allclose(half.lenses[0].focal, np.array(full.lenses[0].focal) / 2)
    seen = white_composite(full.pixels).reshape(4, 4, 2, 6, 2, 3).mean(axis=(2, 4))
    # Pillow rounds premultiplied colors, alpha and the colors again to 8 bits.
    half = white_composite(half.pixels).reshape(seen.shape)
    np.testing.assert_allclose(half, seen, atol=2.5 / 255)


def test_images_are_never_enlarged(tmp_path, write_dataset):
    dataset = load_dataset(write_dataset(tmp_path, [view_image(0)]), "test", image_size=100)
    assert sizes(dataset) == [(12, 8)]


def test_a_few_views_are_spread_evenly(tmp_path, write_dataset):
    write_dataset(tmp_path, [view_image(i) for i in range(9)])
    dataset = load_dataset(tmp_path, "test", view_count=3)
    assert dataset.names == ("r_0", "r_4", "r_8")
    np.testing.assert_allclose(dataset.poses, view_poses(9)[[0, 4, 8]], atol=1e-12)


@pytest.mark.parametrize("terminal", [False, True])
def test_only_a_terminal_shows_a_progress_bar(monkeypatch, capsys, terminal):
    if terminal:
        monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes it for a terminal
    assert list(datasets.track(iter("abc"), 3, "Loading")) == ["a", "b", "c"]
    error = capsys.readouterr().err
    assert ("Loading" in error) if terminal else (error == "")


def test_images_of_two_shapes_go_together(tmp_path, write_dataset):
    """Portrait and landscape; Blender's angle is that of each image's width."""
    images = [view_image(0), view_image(1, size=(8, 12))]
    dataset = load_dataset(write_dataset(tmp_path, images), "test")
    assert sizes(dataset) == [(12, 8), (8, 12)]
    np.testing.assert_array_equal(dataset.image(1), images[1])
    assert dataset.lenses[1].focal[0] == pytest.approx(dataset.lenses[0].focal[0] * 8 / 12)


def test_missing_images_are_skipped_and_counted(tmp_path, write_dataset):
    images = [view_image(i) for i in range(3)]
    paths = ["test/r_0", "test/gone", "test/r_2"]
    dataset = load_dataset(write_dataset(tmp_path, images, paths=paths), "test")
    assert dataset.names == ("r_0", "r_2")
    assert dataset.missing == ("test/gone",)
    np.testing.assert_allclose(dataset.poses, view_poses(3)[[0, 2]], atol=1e-12)


def test_no_split_and_a_split_without_its_images_are_told_apart(tmp_path, write_dataset):
    write_dataset(tmp_path, [view_image(0)], split="train")
    with pytest.raises(NoSplitError):
        load_dataset(tmp_path, "test")
    write_dataset(tmp_path, [], paths=["test/gone"])
    with pytest.raises(NoImagesError):
        load_dataset(tmp_path, "test")


def bad(id, prepare, sentence):
    return pytest.param(prepare, sentence, id=id)


@pytest.mark.parametrize(
    "prepare, sentence",
    [
        bad("no folder", lambda f, write: None, r"nowhere is not a folder"),
        bad("no file", lambda f, write: f.mkdir(), r"holds no transforms_test\.json .*: none"),
        bad(
            "other split",
            lambda f, write: write(f, [view_image(0)], split="train"),
            r"holds no transforms_test\.json .*: transforms_train\.json",
        ),
        bad("no frames", lambda f, write: write(f, [], frames=[]), r"lists no frames"),
        bad("no list", lambda f, write: write(f, [], frames=7), r"lists no frames"),
        bad(
            "no object",
            lambda f, write: (write(f, []) / "transforms_test.json").write_text("[]"),
            r"lists no frames",
        ),
        bad(
            "all images missing",
            lambda f, write: write(f, [view_image(0)], paths=["test/gone"]),
            r"none of the 1 test images is there: test/gone",
        ),
        bad(
            "no angle",
            lambda f, write: write(f, [view_image(0)], camera_angle_x=None),
            r"camera_angle_x = None",
        ),
        bad(
            "degrees",
            lambda f, write: write(f, [view_image(0)], camera_angle_x=40.0),
            r"camera_angle_x = 40\.0.*radians",
        ),
        bad("no path", lambda f, write: write(f, [], frames=[{}]), r"has no file_path"),
        bad(
            "no pose",
            lambda f, write: write(f, [view_image(0)], frames=[{"file_path": "test/r_0"}]),
            r"transform_matrix of test/r_0 has to be 4 rows",
        ),
        bad(
            "not JSON",
            lambda f, write: (write(f, []) / "transforms_test.json").write_text("{"),
            r"transforms_test\.json is not JSON",
        ),
        bad(
            "not an image",
            lambda f, write: (write(f, [view_image(0)]) / "test/r_0.png").write_text("text"),
            r"r_0\.png can't be read as an image",
        ),
    ],
)
def test_a_bad_folder_ends_in_one_sentence(tmp_path, prepare, sentence, write_dataset):
    folder = tmp_path / "nowhere"
    prepare(folder, write_dataset)
    with pytest.raises(DatasetError, match=sentence) as caught:
        load_dataset(folder, "test")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("option", ["image_size", "view_count"])
def test_a_size_of_zero_is_refused(tmp_path, option, write_dataset):
    with pytest.raises(DatasetError, match=r"is 0: it has to be at least 1"):
        load_dataset(write_dataset(tmp_path, [view_image(0)]), "test", **{option: 0})


def test_the_development_data_are_read(shared_data):
    dataset = load_dataset(shared_data("helmet"), "test", view_count=2)
    assert sizes(dataset) == [(400, 400)] * 2
    assert dataset.has_alpha
