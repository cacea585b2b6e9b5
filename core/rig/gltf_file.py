"""The bytes of a glTF 2.0 file: its parts through pygltflib, its numbers with checked sizes.

A file is read without trust.  Buffers have to be inside it (a .glb, or a .gltf with embedded
data): no other file and no address is ever opened for it.
"""

import base64
from pathlib import Path

import numpy as np

LARGEST_FILE = 2**29  # bytes
MOST_NUMBERS = 2**27  # of one table
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DATA_URI = "data:"
# Extensions that change how things look, or that `Gltf.numbers` reads.
HARMLESS = ("KHR_materials", "KHR_texture", "KHR_lights", "EXT_texture", "KHR_mesh_quantization")


def check(condition, sentence):
    if not condition:
        raise ValueError(sentence)


class Gltf:
    """A glTF file: its parts, and the numbers of its accessors.

    Attributes:
        parts: What pygltflib read.  The types of its values are not checked.
    """

    def __init__(self, path: Path):
        import warnings

        import pygltflib

        check(path.is_file(), f"there is no file at {path}")
        size = path.stat().st_size
        check(size <= LARGEST_FILE, f"it has {size / 2**20:.0f} MiB, more than 512")
        content = path.read_bytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pygltflib's, of what we check ourselves
            if content[:4] == b"glTF":
                self.parts = pygltflib.GLTF2.load_from_bytes(content)
            else:
                self.parts = pygltflib.GLTF2.gltf_from_json(content.decode())
        check(self.parts is not None, "it holds no glTF")
        version = str(self.parts.asset.version)
        check(version.startswith("2."), f"it is glTF {version[:10]}, this program reads 2.0")
        for name in self.parts.extensionsRequired or ():
            check(
                str(name).startswith(HARMLESS),
                f"it needs the glTF extension {str(name)[:60]}; export it without compression",
            )
        self._buffers = {}

    def numbers(self, index, kind: str, what: str) -> np.ndarray:
        """The values of an accessor.  [count], or [count, width]

        Args:
            kind: The accessor's type, such as "VEC3".
            what: Whose values they are, for the sentence about what is wrong.

        Returns:
            float64; whole numbers as they are, unless they are meant as fractions.
        """
        accessor = self.at(self.parts.accessors, index, "accessor", what)
        check(accessor.sparse is None, f"{what} are stored sparsely, which this program can't read")
        check(
            accessor.type == kind and accessor.componentType in COMPONENTS,
            f"{what} have the type {str(accessor.type)[:20]}, not {kind}",
        )
        dtype, width = np.dtype(COMPONENTS[accessor.componentType]), WIDTHS[kind]
        count, start = accessor.count, accessor.byteOffset or 0
        check(
            _is_count(count) and count * width <= MOST_NUMBERS,
            f"{what} are {str(count)[:20]}, which is no number of values",
        )
        view = self.at(self.parts.bufferViews, accessor.bufferView, "buffer view", what)
        stride = view.byteStride or dtype.itemsize * width
        first, length = view.byteOffset or 0, view.byteLength
        good = all(map(_is_count, (start, stride, first, length)))
        needed = start + (count - 1) * stride + width * dtype.itemsize if good and count else 0
        data = self._buffer(view.buffer, what)
        check(
            good and width * dtype.itemsize <= stride <= 252 and needed <= length,
            f"{what} need {needed} bytes of a part of {str(length)[:20]}",
        )
        check(first + length <= len(data), f"{what} lie outside of the file's {len(data)} bytes")
        values = np.ndarray(
            (count, width), dtype, data[first : first + length], start, (stride, dtype.itemsize)
        )
        whole = dtype.kind in "iu"
        if whole and not accessor.normalized:
            return values.astype(np.int64)[:, 0] if width == 1 else values.astype(np.int64)
        with np.errstate(invalid="ignore"):  # of NaN: they are refused below
            values = values.astype(np.float64)
        if whole:
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        check(np.isfinite(values).all(), f"{what} hold NaN or infinite numbers")
        return values[:, 0] if width == 1 else values

    def at(self, parts, index, kind: str, what: str):
        """The part of that number; ValueError if there is none."""
        good = _is_count(index) and index < len(parts)
        check(good, f"{what} are in {kind} {str(index)[:20]}, of {len(parts)}")
        return parts[index]

    def _buffer(self, index, what) -> bytes:
        buffer = self.at(self.parts.buffers, index, "buffer", what)
        if index not in self._buffers:
            uri = buffer.uri
            if uri is None:
                data = self.parts.binary_blob()
                check(index == 0 and data is not None, f"{what} are in a buffer without data")
            else:
                check(
                    str(uri).startswith(DATA_URI) and ";base64," in uri[:200],
                    f"{what} are in another file, {str(uri)[:60]!r}, which is not read; export "
                    "everything into one .glb",
                )
                data = base64.b64decode(uri.split(",", 1)[1], validate=True)
            self._buffers[index] = data
        return self._buffers[index]


def _is_count(value) -> bool:
    return type(value) is int and 0 <= value < 2**31
