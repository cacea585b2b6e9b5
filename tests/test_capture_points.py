"""points.npz: the sparse points beside transforms.json."""

import numpy as np
import pytest

from deformrf.core.capture import SparsePoints, load_points, save_points


def some_points(count=20):
    rng = np.random.default_rng()
    return SparsePoints(
        rng.normal(size=(count, 3)).astype(np.float32),
        rng.integers(0, 256, (count, 3)).astype(np.uint8),
        rng.integers(2, 9, count).astype(np.int32),
        rng.random(count).astype(np.float32),
    )


def test_points_come_back_as_they_were_saved(tmp_path):
    assert load_points(tmp_path) is None
    points = some_points()
    save_points(points, tmp_path)
    loaded = load_points(tmp_path)
    for name in ("points", "colors", "track_length", "errors"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(points, name))


@pytest.mark.parametrize("damage", ["text", "short", "huge", "object", "nan", "missing"])
def test_a_bad_file_of_points_is_one_sentence(tmp_path, damage):
    points = some_points()
    path = save_points(points, tmp_path)
    arrays = dict(np.load(path))
    if damage == "short":
        arrays["colors"] = arrays["colors"][:5]
    elif damage == "huge":
        arrays["points"] = np.zeros((20, 3, 2), np.float32)
    elif damage == "object":
        arrays["points"] = np.array([[{}, 1, 2]] * 20, object)
    elif damage == "nan":
        arrays["points"][3] = np.nan
    elif damage == "missing":
        del arrays["errors"]
    np.savez(path, **arrays)
    if damage == "text":
        path.write_text("no archive")
    with pytest.raises(ValueError, match=r"points\.npz does not hold") as caught:
        load_points(tmp_path)
    assert "\n" not in str(caught.value)
