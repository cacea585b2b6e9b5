"""points.npz: the sparse points beside transforms.json."""

import io
import struct
import zipfile

import numpy as np
import pytest
from peak_memory import peak_memory

from deformrf.core.training import SparsePoints, load_points, save_points
from deformrf.core.training.data.points import SHAPES


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


def refused(folder):
    """The sentence that refuses a folder's points, which were read in little memory."""
    lines = []

    def read():
        with pytest.raises(ValueError, match=r"points\.npz does not hold.*remove it") as caught:
            load_points(folder)
        lines.append(str(caught.value))

    assert peak_memory(read) < 30e6
    line = lines[-1]
    assert "\n" not in line and len(line) < len(str(folder)) + 400
    return line


def headers(text):
    """A zip whose arrays have this header, and nothing else."""
    packed, header = io.BytesIO(), text.encode() + b"\n"
    with zipfile.ZipFile(packed, "w") as archive:
        for name in SHAPES:
            content = b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header
            archive.writestr(f"{name}.npy", content)
    return packed.getvalue()


def patched(data: bytes, field: int, value: bytes) -> bytes:
    """A zip with other bytes in a field of all entries, by its place in their local headers."""
    data = bytearray(data)
    for signature, place in ((b"PK\3\4", field), (b"PK\1\2", field + 2)):
        at = -1
        while (at := data.find(signature, at + 1)) >= 0:
            data[at + place : at + place + len(value)] = value
    return bytes(data)


@pytest.mark.parametrize(
    "damage",
    {
        "a damaged stream": lambda good: good.replace(good[60:80], b"\xff" * 20),
        "method 99": lambda good: patched(good, 8, b"\x63\0"),
        "bzip2": lambda good: patched(good, 8, b"\x0c\0"),
        "encrypted": lambda good: patched(good, 6, b"\1\0"),
        "brackets": lambda good: headers("[" * 3000),
        "a negative count": lambda good: headers(
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-5, 3)}"
        ),
        "no keys": lambda good: headers("{}"),
        "a list": lambda good: headers(
            "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (3, 3)}"
        ),
        "cut off": lambda good: good[: len(good) // 2],
        "empty": lambda good: b"",
        "a pickle": lambda good: b"\x80\x04}.",
    }.items(),
    ids=lambda item: item[0],
)
def test_a_damaged_file_is_one_sentence(tmp_path, damage):
    path = save_points(some_points(), tmp_path)
    path.write_bytes(damage[1](path.read_bytes()))
    refused(tmp_path)


@pytest.mark.parametrize("count", [3_000_000, 15_000_000])
def test_a_small_file_of_many_points_takes_no_memory(tmp_path, count):
    """One below the limit of points, one above; no file of points unpacks to 100 times its size."""
    zeros = bytes(2**20)
    with zipfile.ZipFile(tmp_path / "points.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, (shape, kind) in SHAPES.items():
            kind = np.dtype(kind)
            header = {"descr": kind.str, "fortran_order": False, "shape": (count, *shape)}
            with archive.open(f"{name}.npy", "w") as stream:
                np.lib.format.write_array_header_1_0(stream, header)
                left = count * kind.itemsize * int(np.prod(shape))
                while left:
                    left -= stream.write(zeros[: min(left, len(zeros))])
    line = refused(tmp_path)
    assert ("at most 10000000 points are read" in line) == (count > 10_000_000)


@pytest.mark.parametrize("name", SHAPES)
def test_arrays_of_other_lengths_are_told_before_they_are_read(tmp_path, name):
    points = some_points()
    path = save_points(points, tmp_path)
    arrays = {n: getattr(points, n)[: 7 if n == name else None] for n in SHAPES}
    np.savez(path, **arrays)
    assert "it should be" in refused(tmp_path)


@pytest.mark.parametrize("write", [np.savez, np.savez_compressed])
def test_real_points_of_any_number_are_read(tmp_path, write):
    """Also without compression, and none at all."""
    for count in (0, 1, 100_000):
        points = some_points(count)
        write(tmp_path / "points.npz", **vars(points))
        np.testing.assert_array_equal(load_points(tmp_path).points, points.points)
