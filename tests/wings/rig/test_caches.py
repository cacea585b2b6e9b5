"""Point caches: read again exactly, and refused in one sentence when they are damaged."""

import struct
import zipfile

import numpy as np
import pytest
from point_caches import write_cache

from deformrf.wings.rig import VertexClip, read_cache
from deformrf.wings.rig.caches import MDD_HEADER, PC2_HEADER, PC2_MAGIC


def make_clip(samples=5, count=7, rate=24.0):
    random = np.random.default_rng()
    vertices = random.normal(size=(samples, count, 3)).astype(np.float32)
    return VertexClip("wave", np.arange(samples) / rate, vertices)


@pytest.mark.parametrize("ending", [".pc2", ".mdd", ".npz"])
def test_what_was_written_is_read_to_the_bit(tmp_path, ending):
    clip = make_clip()
    again = read_cache(write_cache(clip, tmp_path / f"wave{ending}"), 7)
    assert again.name == "wave"
    np.testing.assert_array_equal(again.vertices, clip.vertices)
    np.testing.assert_allclose(again.times, clip.times, rtol=1e-6)


def test_the_bytes_are_those_of_the_formats(tmp_path):
    clip = make_clip(samples=2, count=1)
    pc2 = write_cache(clip, tmp_path / "a.pc2").read_bytes()
    assert pc2[:32] == b"POINTCACHE2\0" + struct.pack("<iiffi", 1, 1, 0.0, 1.0, 2)
    assert struct.unpack("<6f", pc2[32:]) == tuple(clip.vertices.ravel())
    mdd = write_cache(clip, tmp_path / "a.mdd").read_bytes()
    assert mdd[:16] == struct.pack(">iiff", 2, 1, 0.0, 1.0 / 24.0)
    assert struct.unpack(">6f", mdd[16:]) == tuple(clip.vertices.ravel())


def test_a_clip_begins_at_0_and_frames_become_seconds(tmp_path):
    values = np.zeros((3, 1, 3), np.float32)
    header = PC2_HEADER.pack(PC2_MAGIC, 1, 1, 101.0, 2.0, 3)
    (tmp_path / "a.pc2").write_bytes(header + values.tobytes())
    np.testing.assert_allclose(read_cache(tmp_path / "a.pc2", 1, 30.0).times, [0, 2 / 30, 4 / 30])
    times = np.array([10.0, 10.5, 11.5], ">f4").tobytes()
    (tmp_path / "a.mdd").write_bytes(MDD_HEADER.pack(3, 1) + times + values.tobytes())
    np.testing.assert_allclose(read_cache(tmp_path / "a.mdd", 1).times, [0.0, 0.5, 1.5])


def pc2(samples=2, count=3, version=1, step=1.0, magic=PC2_MAGIC, values=None):
    values = np.zeros((2, 3, 3), "<f4") if values is None else values
    return PC2_HEADER.pack(magic, version, count, 0.0, step, samples) + values.tobytes()


def mdd(samples=2, count=3, times=(0.0, 1.0)):
    header = MDD_HEADER.pack(samples, count) + np.array(times, ">f4").tobytes()
    return header + np.zeros((2, 3, 3), ">f4").tobytes()


NAN = np.full((2, 3, 3), np.nan, "<f4")
BAD = {
    "a.txt": (b"", "has to end in .pc2, .mdd or .npz"),
    "missing.pc2": (None, "there is no point cache"),
    "empty.pc2": (b"", "0 bytes"),
    "other.pc2": (pc2(magic=b"POINTCACHE3\0"), "no PC2 file"),
    "new.pc2": (pc2(version=2), "version 2"),
    "short.pc2": (pc2()[:-1], "ends too early"),
    "huge.pc2": (pc2(samples=2**20), "ends too early"),
    "count.pc2": (pc2(count=4), "4 vertices, but the model has 3"),
    "negative.pc2": (pc2(samples=-1), "-1 samples"),
    "still.pc2": (pc2(step=0.0), "every 0 frames"),
    "nan.pc2": (pc2(values=NAN), "sample 0 holds NaN"),
    "empty.mdd": (b"1234", "4 bytes"),
    "short.mdd": (mdd()[:-4], "ends too early"),
    "huge.mdd": (mdd(samples=2**20), "ends too early"),
    "count.mdd": (mdd(count=2**30), "but the model has 3"),
    "times.mdd": (mdd(times=(0.0, np.nan)), "times"),
    "order.mdd": (mdd(times=(1.0, 1.0)), "order"),
    "text.npz": (b"no zip", "not a point cache"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_damaged_cache_ends_in_one_sentence(tmp_path, name):
    content, words = BAD[name]
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=words) as caught:
        read_cache(tmp_path / name, 3)
    assert "\n" not in str(caught.value) and str(tmp_path / name) in str(caught.value)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"times": np.zeros(1)}, "no array 'vertices'"),
        ({"times": np.zeros(2), "vertices": np.zeros((2, 3, 3))}, "float64"),
        ({"times": np.zeros(1), "vertices": np.zeros((2, 3, 3), np.float32)}, "1 times"),
        ({"times": np.zeros(2), "vertices": np.zeros((2, 5, 3), np.float32)}, "5 vertices"),
    ],
)
def test_a_damaged_npz_ends_in_one_sentence(tmp_path, arrays, words):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match=words):
        read_cache(tmp_path / "a.npz", 3)


def test_memory_is_not_taken_for_what_a_zip_declares(tmp_path):
    """A zip of zeros is small: what it unpacks to is known before."""
    np.savez_compressed(tmp_path / "a.npz", times=np.zeros(1))
    header = np.lib.format.magic(1, 0)
    text = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000, 1000000, 3), }"
    text = text.ljust(117) + b"\n"
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as file:
        file.writestr("vertices.npy", header + len(text).to_bytes(2, "little") + text)
    with pytest.raises(ValueError, match="declares"):
        read_cache(tmp_path / "a.npz", 1000000)


def test_a_cache_beyond_the_free_memory_is_refused(tmp_path, monkeypatch):
    path = write_cache(make_clip(), tmp_path / "a.pc2")
    monkeypatch.setattr("deformrf.wings.rig.caches.free_bytes", lambda: 100)
    with pytest.raises(ValueError, match="free memory"):
        read_cache(path, 7)
