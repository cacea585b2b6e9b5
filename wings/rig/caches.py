"""Point caches: all vertices of a mesh over time, as other programs write them.

    .pc2   PC2, little endian: "POINTCACHE2\\0", then int32 version (1), int32 vertices, float32
           first frame, float32 frames a sample, int32 samples; then float32 [samples, vertices, 3]
    .mdd   MDD, big endian: int32 samples, int32 vertices, float32 seconds [samples], then
           float32 [samples, vertices, 3]
    .npz   ours: `times` [samples] float64 in seconds, `vertices` [samples, vertices, 3] float32

PC2 counts frames, so reading it takes the frames of a second.  A clip's first sample is at 0 s,
whatever frame or second a file begins with.  The vertices are in model space, z up.

A file is compared with what it declares before memory is taken.  Every error is a ValueError of
one sentence.
"""

import math
import struct
from pathlib import Path

import numpy as np

from ...core.base.archive import one_sentence, open_archive
from ...core.base.memory import free_bytes
from ...core.base.reading import open_file
from ...core.base.schema import check
from .clips import VertexClip

PC2_MAGIC = b"POINTCACHE2\0"
PC2_HEADER = struct.Struct("<12siiffi")
MDD_HEADER = struct.Struct(">ii")
FRAMES_PER_SECOND = 24.0  # Blender's own
SLOWEST, FASTEST = 1e-3, 1e5  # frames a second
MOST_SAMPLES = 2**20


def read_cache(
    path: str | Path, vertex_count: int, frames_per_second: float = FRAMES_PER_SECOND
) -> VertexClip:
    """The clip in a point cache of a mesh with so many vertices; its name is the file's.

    Raises:
        ValueError: The file is missing, damaged, too large, or of another mesh.
    """
    path = Path(path)
    read = {".pc2": _read_pc2, ".mdd": _read_mdd, ".npz": _read_npz}.get(path.suffix.lower())
    check(read, f"{path} is no point cache: its name has to end in .pc2, .mdd or .npz")
    check(path.is_file(), f"there is no point cache at {path}")
    check(
        SLOWEST <= frames_per_second <= FASTEST,
        f"{frames_per_second} frames a second: give {SLOWEST:g} to {FASTEST:g}",
    )
    with one_sentence(path):
        times, vertices = read(path, vertex_count, float(frames_per_second))
        check(np.isfinite(times).all(), "its times hold NaN or infinity")
        bad = ~np.isfinite(vertices).all(axis=(1, 2))
        number, count = int(np.argmax(bad)), int(bad.sum())
        check(count == 0, f"sample {number} holds NaN or infinity ({count} samples do)")
        return VertexClip(path.stem, times - times[0], vertices)


def _read_pc2(path, vertex_count, frames_per_second):
    with open_file(path) as stream:
        magic, version, count, _, step, samples = _header(stream, PC2_HEADER, "PC2")
        check(magic == PC2_MAGIC, "it is no PC2 file: it does not begin with POINTCACHE2")
        check(version == 1, f"it has PC2 version {version}, this program reads 1")
        check(0.0 < step < math.inf, f"it has a sample every {step:g} frames")
        _check_counts(samples, count, vertex_count)
        vertices = _samples(stream, path, samples, count, "<f4", PC2_HEADER.size)
    return np.arange(samples) * (step / frames_per_second), vertices


def _read_mdd(path, vertex_count, _):
    with open_file(path) as stream:
        samples, count = _header(stream, MDD_HEADER, "MDD")
        _check_counts(samples, count, vertex_count)
        header_size = MDD_HEADER.size + 4 * samples
        _check_size(path, samples, count, header_size)
        times = np.frombuffer(stream.read(4 * samples), ">f4").astype(float)
        return times, _samples(stream, path, samples, count, ">f4", header_size)


def _read_npz(path, vertex_count, _):
    with open_archive(path, "point cache") as arrays:
        for name in ("times", "vertices"):
            good = name in arrays
            check(good, f"it has no array '{name}'; a point cache has times and vertices")
        times, vertices = arrays["times"], arrays["vertices"]
        check(
            times.ndim == 1 and times.dtype.kind == "f",
            f"'times' is {times.dtype} {list(times.shape)}, not float [samples]",
        )
        check(
            vertices.dtype == np.float32 and vertices.ndim == 3 and vertices.shape[2] == 3,
            f"'vertices' is {vertices.dtype} {list(vertices.shape)}, "
            "not float32 [samples, vertices, 3]",
        )
        _check_counts(len(vertices), vertices.shape[1], vertex_count)
        good = len(times) == len(vertices)
        check(good, f"it has {len(times)} times, but {len(vertices)} samples")
        _check_memory(vertices.nbytes)
        return np.asarray(times, float), np.asarray(vertices)


def _header(stream, header, kind):
    start = stream.read(header.size)
    good = len(start) == header.size
    check(good, f"it has {len(start)} bytes; a {kind} file has at least {header.size}")
    return header.unpack(start)


def _check_counts(samples, count, vertex_count):
    good = 0 < samples <= MOST_SAMPLES
    check(good, f"it declares {samples} samples; a point cache has 1 to {MOST_SAMPLES}")
    check(
        count == vertex_count,
        f"it has {count} vertices, but the model has {vertex_count}: it belongs to another "
        "mesh, or vertices were added or removed",
    )


def _check_size(path, samples, count, header_size):
    wanted, found = header_size + 12 * samples * count, path.stat().st_size
    check(
        found >= wanted,
        f"it ends too early: {samples} samples of {count} vertices take {wanted} bytes, the "
        f"file has {found}",
    )


def _check_memory(byte_count):
    free = free_bytes()
    if free is not None and byte_count > free // 2:  # the clip, and what is made of it
        raise ValueError(
            f"its vertices take {byte_count / 2**20:.0f} MiB, more than half of the "
            f"{free / 2**20:.0f} MiB of free memory"
        )


def _samples(stream, path, samples, count, kind, header_size):
    """[samples, count, 3] float32"""
    _check_size(path, samples, count, header_size)
    _check_memory(12 * samples * count)
    vertices = np.empty((samples, count, 3), np.float32)
    for sample in vertices:  # one at a time: there is no second copy of all
        sample[:] = np.frombuffer(stream.read(12 * count), kind).reshape(count, 3)
    return vertices
