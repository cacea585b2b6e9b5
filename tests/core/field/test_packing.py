"""What a model file leaves out comes back exactly; what it rounds, within its bound.

Files hold only what the zip's own headers promise, or are refused with one sentence.
"""

import zipfile
from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.base.archive import open_archive
from deformrf.core.base.schema import FileError
from deformrf.core.field import FEATURES, ModelFileError, load, modelfile
from deformrf.core.field.layout import Layout
from deformrf.core.field.packing import (
    pack_mesh,
    pack_tables,
    quantize,
    unpack_mesh,
    unpack_tables,
)
from deformrf.core.geometry import a15_grid


def read_arrays(path):
    with open_archive(path, "model file") as arrays:
        return {name: np.asarray(arrays[name]) for name in arrays}


LAYOUT = Layout((300, 1024, 1024), 0, ())


def random_tables():
    rng = np.random.default_rng()
    table = rng.normal(size=(sum(LAYOUT.entry_counts), FEATURES)).astype(np.float32)
    return table * np.float32([0.01, 1.0, 3.0, 0.0]), rng.random(len(table)) < 0.5


@pytest.mark.parametrize("spacing", [0.25, 0.13, 0.1])
def test_a_lattice_needs_no_rest_vertices(spacing):
    mesh = a15_grid(spacing)
    occupancy = np.arange(mesh.tet_count).astype(np.uint64)
    arrays, found = pack_mesh(mesh, occupancy)
    assert set(arrays) == {"addresses", "tets", "occupancy"}
    assert arrays["tets"].dtype == arrays["addresses"].dtype == np.uint16
    again, bits = unpack_mesh(arrays, found, level_count=6)
    for name in ("rest_vertices", "addresses", "tets"):
        before, after = getattr(mesh, name), getattr(again, name)
        np.testing.assert_array_equal(after, before)
        assert after.dtype == before.dtype
    np.testing.assert_array_equal(bits, occupancy)


def test_large_numbers_keep_32_bits():
    mesh = a15_grid(0.25)
    mesh = replace(mesh, addresses=mesh.addresses + 70_000)
    arrays, spacing = pack_mesh(mesh, np.zeros(mesh.tet_count, np.uint64))
    assert spacing is None  # the offset is none of the lattice's
    assert arrays["addresses"].dtype == np.int32
    again, _ = unpack_mesh(arrays, spacing, level_count=3)
    np.testing.assert_array_equal(again.addresses, mesh.addresses)
    np.testing.assert_array_equal(again.rest_vertices, mesh.rest_vertices)


def test_entries_that_are_not_reached_come_back_as_zero():
    table, reached = random_tables()
    arrays = pack_tables(table, LAYOUT, reached)
    expected = np.where(reached[:, None], table.astype(np.float16), 0)
    np.testing.assert_array_equal(unpack_tables(arrays, LAYOUT), expected)
    rows = sum(len(a) for name, a in arrays.items() if name.startswith("table"))
    assert rows == reached.sum()


@pytest.mark.parametrize("left_out", [0, 3])
def test_few_missing_entries_are_not_worth_their_bits(left_out):
    table, reached = random_tables()
    reached[:] = True
    reached[300 : 300 + left_out] = False
    arrays = pack_tables(table, LAYOUT, reached)
    assert set(arrays) == {"table_0", "table_1", "table_2"}
    np.testing.assert_array_equal(unpack_tables(arrays, LAYOUT), table.astype(np.float16))


def test_a_field_that_reaches_nothing_has_empty_tables():
    table, reached = random_tables()
    for entry_bits in (8, 16):
        arrays = pack_tables(table, LAYOUT, np.zeros_like(reached), entry_bits)
        assert sum(len(arrays[f"table_{level}"]) for level in range(3)) == 0
        assert not unpack_tables(arrays, LAYOUT).any()


def test_one_byte_is_wrong_by_half_its_scale_at_most():
    table, reached = random_tables()
    arrays = pack_tables(table, LAYOUT, reached, entry_bits=8)
    again = unpack_tables(arrays, LAYOUT)
    for level in range(3):
        part = slice(*LAYOUT.offsets[level : level + 2])
        values, kept, scale = table[part], reached[part], arrays[f"scale_{level}"]
        np.testing.assert_allclose(scale, np.abs(values[kept]).max(axis=0) / 127, rtol=1e-6)
        error = np.abs(again[part] - values)[kept]
        assert (error <= 0.5001 * scale).all()
        assert not again[part][~kept].any()


def test_quantizing_keeps_extremes_signs_and_zero():
    values = np.float32([[-2.0], [0.0], [2.0], [1.0]])
    integers, scale = quantize(values)
    np.testing.assert_array_equal(integers[:, 0], [-127, 0, 127, 64])
    assert scale == np.float32(2.0 / 127)


def test_a_file_of_few_bytes_cannot_ask_for_a_huge_table():
    with pytest.raises(FileError, match="entries, more than"):
        unpack_tables({}, Layout((2**40,), 0, ()))


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
            load(path)


def test_a_header_that_promises_too_much_is_refused(path):
    """Without a look at it first, NumPy would ask for the memory."""
    data = path.read_bytes()
    shape = b"'shape': (1000000000000, 3)"
    place = data.index(b"'shape': (1000, 3)", data.index(b"'<f8'"))
    end = data.index(b"\n", place)
    header = data[place:end].replace(b"'shape': (1000, 3)", shape)
    path.write_bytes(data[:place] + header[: end - place].ljust(end - place) + data[end:])
    with pytest.raises(FileError):
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
    with pytest.raises(ModelFileError, match=r"encrypted|strong"):
        load(path)


def test_a_truncated_file_is_refused(path):
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(FileError):
        read_arrays(path)


@pytest.mark.parametrize("limit", [0, 2**30])
def test_a_file_is_deflated_unless_it_would_be_refused(
    make_ball_field, tmp_path, monkeypatch, limit
):
    field, path = make_ball_field(3), tmp_path / "model.npz"
    monkeypatch.setattr(modelfile, "unpacked_limit", lambda file_size: limit)
    modelfile.save(field, path)
    with zipfile.ZipFile(path) as archive:
        ways = {entry.compress_type for entry in archive.infolist()}
        assert archive.testzip() is None
    assert ways == {zipfile.ZIP_DEFLATED if limit else zipfile.ZIP_STORED}
    assert np.abs(load(path).table).max() == np.abs(field.table.astype(np.float16)).max()
