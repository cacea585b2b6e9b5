"""Hostile model files: one sentence, at most a second, at most 200 MB; never a crash."""

import json
import subprocess
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.base.archive import one_sentence, open_archive
from deformrf.core.field import FieldOptions, ModelFileError, load, random_field, save
from deformrf.core.geometry import TetMesh, tet_neighbours
from deformrf.core.render import Renderer, from_field_of_view, look_at

CORNERS = np.array([[0, 0, 0], [8, 0, 0], [0, 8, 0], [0, 0, 8], [6, 6, 6]])
OPTIONS = FieldOptions(2, 2**6, (16,), (16,), march_step=0.01)
# What a load may cost beyond the program itself.
MEASURED_LOAD = """
import resource, sys, time
from pathlib import Path
from deformrf.core.field import ModelFileError, load
load(Path(sys.argv[1]))
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
before = peak()
for path in sys.argv[2:]:
    start = time.process_time()
    try:
        load(Path(path))
        sentence = "loaded"
    except ModelFileError as error:
        sentence = str(error)
    print(f"{time.process_time() - start:.3f} {peak() - before:.0f} {sentence}")
"""


def tets_field(tets):
    tets = np.array(tets, np.int32)
    used = CORNERS[: tets.max() + 1]
    mesh = TetMesh(0.1 * used, used.astype(np.int32), tets)
    return random_field(mesh, tet_neighbours(tets), OPTIONS)


@pytest.fixture
def path(tmp_path):
    save(tets_field([[0, 1, 2, 3]]), tmp_path / "one.npz")
    return tmp_path / "one.npz"


def arrays_of(path):
    with np.load(path) as archive:
        return dict(archive)


def spaces(stream, count):
    header = {"descr": "|u1", "fortran_order": False, "shape": (count,)}
    np.lib.format.write_array_header_1_0(stream, header)
    for _ in range(count // 10**6):
        stream.write(b" " * 10**6)


def bombs(path):
    """Small files that ask for gigabytes."""
    arrays = arrays_of(path)
    meta = json.loads(arrays["meta"].tobytes())

    def write(name, **changes):
        made = path.with_name(f"{name}.npz")
        np.savez_compressed(made, **(arrays | changes))
        return made

    def with_meta(**changes):
        text = json.dumps(meta | changes).encode()
        return np.frombuffer(text, np.uint8)

    large = meta["options"] | {"table_size": 2**40}
    million = {
        "tets": np.repeat(arrays["tets"], 10**6, axis=0),
        "occupancy": np.repeat(arrays["occupancy"], 10**6),
    }
    yield write("million", **million, meta=with_meta(options=large))
    yield write("million_small", **million)
    one = meta["options"] | {"level_count": 1}
    coarse = with_meta(options=one, entry_counts=[4], dense_level_count=1)
    yield write("million_coarse", **million, meta=coarse)
    large = meta["options"] | {"table_size": 2**26, "dense_levels": False}
    counts = {"entry_counts": [2**26] * 2, "dense_level_count": 0}
    bits = {f"reached_{k}": np.zeros(2**23, np.uint8) for k in range(2)}
    yield write("entries", meta=with_meta(options=large, **counts), **bits)
    yield write("tables", table_1=np.zeros((2**26, 4), np.float16))
    yield write("nested", meta=np.frombuffer(b"[" * 10**6, np.uint8))
    for name, entry, length in (("spaces", "meta.npy", 300), ("long", "tets.npy", 0)):
        made = path.with_name(f"{name}.npz")
        with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
            with archive.open(entry, "w", force_zip64=True) as stream:
                if length:
                    spaces(stream, length * 10**6)
                else:  # a header of 400 MB
                    stream.write(b"\x93NUMPY\x02\x00" + (4 * 10**8).to_bytes(4, "little"))
                    for _ in range(400):
                        stream.write(b"(" * 10**6)
            for other, values in arrays.items():
                if f"{other}.npy" != entry:
                    with archive.open(f"{other}.npy", "w") as stream:
                        np.lib.format.write_array(stream, values)
        yield made


def test_what_is_refused_takes_little_memory_and_time(path):
    files = list(bombs(path))
    command = [sys.executable, "-c", MEASURED_LOAD, path, *files]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = [line.split(" ", 2) for line in done.stdout.splitlines()]
    assert len(lines) == len(files)
    for seconds, megabytes, sentence in lines:
        assert sentence != "loaded"
        assert float(megabytes) < 200 and float(seconds) < 1.0, sentence


def test_a_long_list_of_entries_is_not_read(path):
    """zipfile would take it into memory at once."""
    data = bytearray(path.read_bytes())
    place = data.rindex(b"PK\x05\x06")
    data[place + 12 : place + 16] = (10**9).to_bytes(4, "little")
    data[place + 16 : place + 20] = bytes(4)
    with open(path, "wb") as stream:
        stream.truncate(10**9)  # a hole, which takes no room on the disk
        stream.seek(10**9)
        stream.write(data[place:])
    with pytest.raises(ModelFileError, match="list of entries takes 1000000000 bytes"):
        load(path)


def test_unknown_arrays_are_skipped_unread(path):
    """Neither their headers nor their values, damaged or large."""
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("other.npy", b"no array")
        with archive.open("large.npy", "w", force_zip64=True) as stream:
            spaces(stream, 10**8)
    command = [sys.executable, "-c", MEASURED_LOAD, path, path]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds, megabytes, sentence = done.stdout.split()
    assert sentence == "loaded" and float(megabytes) < 20 and float(seconds) < 0.5


@pytest.mark.parametrize(
    "tets",
    [[[0, 1, 2, 3]] * 2, [[0, 1, 2, 3], [0, 2, 1, 4], [0, 1, 3, 4], [0, 3, 2, 4], [1, 2, 3, 4]]],
)
def test_a_mesh_without_boundary_is_refused_with_a_sentence(tets, tmp_path):
    """A renderer of it would refit an empty mesh, which ended the process."""
    with pytest.raises(ValueError, match="no boundary"):
        Renderer(tets_field(tets))
    save(tets_field(tets), tmp_path / "closed.npz")
    with pytest.raises(ModelFileError, match="no boundary"):
        load(tmp_path / "closed.npz")


def test_one_tet_is_drawn(path):
    view = from_field_of_view(look_at((1.6, 1.2, 0.9), (0.3, 0.3, 0.3)), 0.7, 16, 16)
    assert np.isfinite(Renderer(load(path)).render(view).color_array()).all()


HEADERS = [
    b"{'descr': '<f4', 'fortran_order': False, 'shape': (",  # tokenize.TokenError
    b"{'descr': '<f4', 'fortran_order': False, 'shape': (1" + b"0" * 400 + b",), }",
    b"(" * 3000,
    b"{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (3,), }",
    b"{'descr': '<f4', 'fortran_order': False, 'shape': (-3,), }",
    b"{'descr': '<f4', 'fortran_order': False, 'shape': 3, }",
    b"{'descr': 3, 'fortran_order': False, 'shape': (3,), }",
    b"{[]: 3}",
    b"\0\xff",
]


@pytest.mark.parametrize("header", HEADERS)
def test_a_header_that_no_parser_likes_is_named(path, header):
    arrays = arrays_of(path)
    with zipfile.ZipFile(path, "w") as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w") as stream:
                if name == "tets":
                    stream.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
                    stream.write(bytes(100))
                else:
                    np.lib.format.write_array(stream, values)
    with pytest.raises(ModelFileError, match=r"'tets\.npy'") as caught:
        load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: 1e3 * v, "from the origin"),
        (lambda v: 1e15 * v, "from the origin"),
        (lambda v: 1e-6 * v, "long"),
        (lambda v: v + 1e6, "from the origin"),
        (lambda v: v * [1, 1, 1e-9], "rest volume"),
        (lambda v: v[[1, 0, 2, 3]], "rest volume"),
    ],
)
def test_what_no_renderer_can_draw_is_refused(path, change, words):
    arrays = arrays_of(path)
    meta = json.loads(arrays["meta"].tobytes()) | {"lattice_spacing": None}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    np.savez(path, **arrays | {"rest_vertices": change(0.1 * CORNERS[:4])})
    with pytest.raises(ModelFileError, match=words):
        load(path)


def test_a_small_march_step_needs_a_small_mesh(path):
    field = load(path)
    large = replace(field.mesh, rest_vertices=10 * field.mesh.rest_vertices)
    options = replace(field.options, march_step=2e-4)
    save(replace(field, mesh=large, options=options), path)
    with pytest.raises(ModelFileError, match="pieces, more than"):
        load(path)


@pytest.mark.parametrize("name", ["density_weights_0", "color_bias_1"])
def test_weights_that_overflow_are_refused(path, name):
    arrays = arrays_of(path)
    arrays[name] = np.full_like(arrays[name], 3e38)
    np.savez(path, **arrays)
    with pytest.raises(ModelFileError, match="reaches 3e"):
        load(path)


def test_an_entry_with_an_endless_name_is_quoted_in_bounds(path):
    """The length of its name is damaged: all of the file's bytes behind it are its name."""
    content = path.read_bytes()
    path.write_bytes(content[:26] + b"\xff\xff" + content[28:])
    with (
        pytest.raises(ValueError) as caught,
        one_sentence(path),
        open_archive(path, "rig") as found,
    ):
        list(found.values())
    assert str(caught.value).isprintable() and len(str(caught.value)) < len(str(path)) + 400
