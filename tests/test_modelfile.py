"""model.npz: a round trip, and one sentence for whatever is wrong with a file."""

import json
import zipfile

import numpy as np
import pytest

from deformrf.core.field import modelfile
from deformrf.core.field.modelfile import ModelFileError


@pytest.fixture
def field(make_ball_field):
    return make_ball_field(np.random.default_rng().integers(1000), level_count=3)


@pytest.fixture
def path(field, tmp_path):
    modelfile.save(field, tmp_path / "model.npz", {"note": "a test"})
    return tmp_path / "model.npz"


def rewrite(path, **changes):
    """Replace arrays of a file; None removes one, a function changes it."""
    with np.load(path) as archive:
        arrays = dict(archive)
    for name, change in changes.items():
        arrays[name] = change(arrays[name]) if callable(change) else change
    np.savez(path, **{name: a for name, a in arrays.items() if a is not None})


def rewrite_meta(path, **changes):
    def change(meta):
        values = {**json.loads(meta.tobytes()), **changes}
        return np.frombuffer(json.dumps(values).encode(), np.uint8)

    rewrite(path, meta=change)


def test_what_is_saved_is_loaded(field, path):
    loaded = modelfile.load(path)
    for name in ("rest_vertices", "addresses", "tets"):
        np.testing.assert_array_equal(getattr(loaded.mesh, name), getattr(field.mesh, name))
    np.testing.assert_array_equal(loaded.neighbours, field.neighbours)
    np.testing.assert_array_equal(loaded.occupancy, field.occupancy)
    np.testing.assert_array_equal(loaded.table, field.table.astype(np.float16))
    for ours, theirs in (
        (field.density_layers, loaded.density_layers),
        (field.color_layers, loaded.color_layers),
    ):
        for (w, b), (w2, b2) in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(w, w2)
            np.testing.assert_array_equal(b, b2)
    assert loaded.options == field.options
    assert loaded.meta["note"] == "a test"
    assert not path.with_name("model.npz.part").exists()


def test_saving_again_writes_the_same_bytes(path, tmp_path):
    """Nothing drifts, nothing is lost: half precision survives the round trip exactly."""
    again = tmp_path / "again.npz"
    modelfile.save(modelfile.load(path), again)
    with np.load(path) as a, np.load(again) as b:
        for name in a.files:
            np.testing.assert_array_equal(a[name], b[name])


def set_entry(value, index=0):
    def change(array):
        array = array.copy()
        array.reshape(-1)[index] = value
        return array

    return change


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"meta": None}, "no 'meta'"),
        ({"tets": None}, "'tets' is missing"),
        ({"tets": set_entry(10**6)}, "outside 0"),
        ({"tets": lambda a: a[:, [1, 0, 2, 3]]}, "rest volume"),
        ({"tets": lambda a: a.astype(np.int64)}, "int64"),
        ({"rest_vertices": set_entry(np.nan)}, "NaN"),
        ({"addresses": set_entry(-5)}, "addresses"),
        ({"table_1": lambda a: a[:-1]}, "table_1"),
        ({"table_2": set_entry(np.inf)}, "NaN or infinite"),
        ({"color_weights_0": lambda a: a.T}, "color_weights_0"),
        ({"occupancy": lambda a: a[1:]}, "occupancy"),
        ({"density_bias_0": np.array(["pickled", 1], object)}, "damaged"),
    ],
)
def test_damage_is_named_in_one_sentence(path, changes, words):
    rewrite(path, **changes)
    with pytest.raises(ModelFileError, match=words) as caught:
        modelfile.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format_version": 99}, "version 99"),
        ({"format": "something"}, "not a deformrf model"),
        ({"options": {}}, "entries|damaged|table|weights"),
        ({"entry_counts": [1, 2]}, "declares"),
        ({"feature_count": 8}, "8 features"),
        ({"dense_level_count": 0}, "0 of them dense"),
        ({"world_to_model": [1.0]}, "4x4"),
    ],
)
def test_wrong_metadata_is_named_in_one_sentence(path, changes, words):
    rewrite_meta(path, **changes)
    with pytest.raises(ModelFileError, match=words):
        modelfile.load(path)


def test_other_files_are_refused(tmp_path):
    missing, text, empty = tmp_path / "a.npz", tmp_path / "b.npz", tmp_path / "c.npz"
    text.write_text("no model")
    with zipfile.ZipFile(empty, "w"):
        pass
    for path, words in ((missing, "no model file"), (text, "not a model"), (empty, "no 'meta'")):
        with pytest.raises(ModelFileError, match=words):
            modelfile.load(path)


def test_a_zip_bomb_is_refused_by_its_headers(tmp_path):
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("meta.npy", "w", force_zip64=True) as stream:
            block = bytes(2**24)
            for _ in range(2**31 // len(block) + 1):
                stream.write(block)
    with pytest.raises(ModelFileError, match="GiB"):
        modelfile.load(path)


def test_a_header_that_promises_too_much_is_refused(path):
    """Without a look at it first, NumPy would ask for the memory."""
    data = path.read_bytes()
    shape = b"'shape': (1000000000000, 3)"
    with np.load(path) as archive:
        vertex_count = len(archive["rest_vertices"])
    old = f"'shape': ({vertex_count}, 3)".encode()
    start = data.index(b"'<f8'")
    place = data.index(old, start)
    end = data.index(b"\n", place)
    header = data[place:end].replace(old, shape)
    changed = data[:place] + header[: end - place].ljust(end - place) + data[end:]
    path.write_bytes(changed)
    with pytest.raises(ModelFileError):
        modelfile.load(path)


@pytest.mark.parametrize("flag", [0x1, 0x800001])
def test_an_encrypted_file_is_refused(path, flag):
    data = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = data.find(signature)
        while place >= 0:
            data[place + offset] |= flag & 0xFF
            place = data.find(signature, place + 4)
    path.write_bytes(bytes(data))
    with pytest.raises(ModelFileError):
        modelfile.load(path)


def test_a_failed_save_leaves_nothing_behind(field, tmp_path, monkeypatch):
    def no_space(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr(np, "savez", no_space)
    with pytest.raises(OSError, match="no space"):
        modelfile.save(field, tmp_path / "model.npz")
    assert not list(tmp_path.iterdir())


def test_a_truncated_file_is_refused(path):
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(ModelFileError):
        modelfile.load(path)
