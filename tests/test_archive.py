"""A model file's arrays: only what the zip's own headers promise, or one sentence."""

import zipfile

import numpy as np
import pytest

from deformrf.core.field import ModelFileError
from deformrf.core.field.archive import array, read_arrays


@pytest.fixture
def path(tmp_path):
    values = np.random.default_rng().normal(size=(1000, 3))
    np.savez(tmp_path / "model.npz", meta=np.zeros(10, np.uint8), values=values)
    return tmp_path / "model.npz"


def test_other_files_are_refused(tmp_path):
    missing, text, empty = tmp_path / "a.npz", tmp_path / "b.npz", tmp_path / "c.npz"
    text.write_text("no model")
    with zipfile.ZipFile(empty, "w"):
        pass
    for path, words in ((missing, "no model file"), (text, "not a model"), (empty, "no 'meta'")):
        with pytest.raises(ModelFileError, match=words):
            read_arrays(path)


def test_a_zip_bomb_is_refused_by_its_headers(tmp_path):
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("meta.npy", "w", force_zip64=True) as stream:
            block = bytes(2**24)
            for _ in range(2**31 // len(block) + 1):
                stream.write(block)
    with pytest.raises(ModelFileError, match="GiB"):
        read_arrays(path)


def test_a_header_that_promises_too_much_is_refused(path):
    """Without a look at it first, NumPy would ask for the memory."""
    data = path.read_bytes()
    shape = b"'shape': (1000000000000, 3)"
    place = data.index(b"'shape': (1000, 3)", data.index(b"'<f8'"))
    end = data.index(b"\n", place)
    header = data[place:end].replace(b"'shape': (1000, 3)", shape)
    path.write_bytes(data[:place] + header[: end - place].ljust(end - place) + data[end:])
    with pytest.raises(ModelFileError):
        read_arrays(path)


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
        read_arrays(path)


def test_a_truncated_file_is_refused(path):
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(ModelFileError):
        read_arrays(path)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (np.zeros((5, 3), np.int64), r"int64 \[5, 3\].* uint16 or int32 \['any', 3\]"),
        (np.zeros((5, 4), np.int32), r"int32 \[5, 4\]"),
        (np.zeros(5, np.int32), r"int32 \[5\]"),
    ],
)
def test_a_wrong_array_is_named_with_what_it_should_be(found, words):
    with pytest.raises(ModelFileError, match=words):
        array({"a": found}, "a", (np.uint16, np.int32), (None, 3))
