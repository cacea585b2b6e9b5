"""The bytes of a glTF 2.0 file: its JSON as objects, its numbers with checked sizes.

A file is read without trust.  Buffers have to be inside it (a .glb, or a .gltf with embedded
data): no other file and no address is ever opened for it.  What many objects share is decoded once,
and all together has a limit that is compared with what the file declares, before memory is taken.
"""

import base64
import json
import struct
from pathlib import Path

import numpy as np

from ...core.base.memory import no_garbage_collected
from ...core.base.schema import check, integer
from ...core.base.streams import one_line

LONGEST_COPYRIGHT = 1000  # characters
LARGEST_FILE = 2**29  # bytes
LARGEST_TEXT = 2**26  # bytes of JSON, embedded data included
MOST_VALUES = 2**20  # of the JSON, as `json_values` counts them
MOST_NUMBERS = 2**23  # of all tables together
JSON, BINARY = 0x4E4F534A, 0x004E4942  # kinds of a .glb's chunks
LISTS = ("accessors", "animations", "buffers", "bufferViews", "meshes", "nodes", "skins")
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
is_count = integer(0, 2**31 - 1)
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
DATA_URI = "data:"
# Extensions that change how things look, or that `Gltf.numbers` reads.
HARMLESS = ("KHR_materials", "KHR_texture", "KHR_lights", "EXT_texture", "KHR_mesh_quantization")


class JsonObject:
    """An object of the JSON: its members are attributes, and None where it has none."""

    def __init__(self, members: dict):
        self.__dict__ = members

    def __getattr__(self, name):
        return None


class Gltf:
    """A glTF file: its objects, and the numbers of its accessors.

    Attributes:
        root: That of the JSON; its LISTS are lists of objects.  Other values are not checked.
        copyright: Of the file's contents, one line; empty if it states none.
    """

    def __init__(self, path: Path):
        check(path.is_file(), f"there is no file at {path}")
        self._path, self._blob = path, None
        self.root = _root(self._text())
        version = str(getattr(self.root.asset, "version", None))
        check(version.startswith("2."), f"it is glTF {version[:10]}, this program reads 2.0")
        said = getattr(self.root.asset, "copyright", None)
        self.copyright = one_line(said, LONGEST_COPYRIGHT) if said and isinstance(said, str) else ""
        for name in self.root.extensionsRequired or ():
            check(
                str(name).startswith(HARMLESS),
                f"it needs the glTF extension {str(name)[:60]}; export it without compression",
            )
        self._buffers, self._tables, self._left = {}, {}, MOST_NUMBERS

    def numbers(self, index, kind: str, what: str) -> np.ndarray:
        """The values of an accessor, not to be written to.  [count], or [count, width]

        Args:
            kind: The accessor's type, such as "VEC3".
            what: Whose values they are, for the sentence about what is wrong.

        Returns:
            float64; whole numbers as int64, unless they are meant as fractions.
        """
        accessor = self.at(self.root.accessors, index, "accessor", what)
        check(
            accessor.type == kind and accessor.componentType in COMPONENTS,
            f"{what} have the type {str(accessor.type)[:20]}, not {kind}",
        )
        if index not in self._tables:
            self._tables[index] = self._decoded(accessor, WIDTHS[kind], what)
            self._tables[index].flags.writeable = False
        return self._tables[index]

    def count(self, index, what: str) -> int:
        """How many values an accessor declares."""
        count = self.at(self.root.accessors, index, "accessor", what).count
        check(is_count(count), f"{what} are {str(count)[:20]}, which is no number of values")
        return count

    def at(self, objects, index, kind: str, what: str):
        """The object of that number; ValueError if there is none."""
        good = is_count(index) and index < len(objects)
        check(good, f"{what} are in {kind} {str(index)[:20]}, of {len(objects)}")
        return objects[index]

    def _decoded(self, accessor: JsonObject, width: int, what: str) -> np.ndarray:
        dtype, count, sparse = np.dtype(COMPONENTS[accessor.componentType]), accessor.count, None
        check(is_count(count), f"{what} are {str(count)[:20]}, which is no number of values")
        if accessor.sparse is not None:
            sparse = self._changes(accessor, dtype, width, what)
        self._take(count * width, what)
        if sparse is not None and accessor.bufferView is None:
            values = np.zeros((count, width), dtype)
        else:
            values = self._stored(accessor, dtype, count, width, what)
        if sparse is not None:
            values = values.copy()
            values[sparse[0]] = sparse[1]
        whole = dtype.kind in "iu"
        if whole and not accessor.normalized:
            values = values.astype(np.int64)
            return values[:, 0] if width == 1 else values
        with np.errstate(invalid="ignore"):  # of NaN: they are refused below
            values = values.astype(np.float64)
        if whole:
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        check(np.isfinite(values).all(), f"{what} hold NaN or infinite numbers")
        return values[:, 0] if width == 1 else values

    def _changes(self, accessor: JsonObject, dtype, width: int, what: str):
        """Which values of a sparse accessor differ [n], and what they are [n, width]."""
        sparse, whose = accessor.sparse, f"sparse {what}"
        count, places, values = sparse.count, sparse.indices, sparse.values
        good = is_count(count) and 0 < count <= accessor.count
        check(good, f"{whose} are {str(count)[:20]} of {accessor.count}")
        check(
            isinstance(places, JsonObject) and isinstance(values, JsonObject),
            f"{whose} lack their indices or values",
        )
        kind = np.dtype(COMPONENTS.get(places.componentType, "f4"))
        check(kind.kind == "u", f"{whose} have indices that are no whole numbers")
        self._take(count * (1 + width), whose)
        places = self._stored(places, kind, count, 1, whose)[:, 0]
        last = int(places.max())
        check(last < accessor.count, f"{whose} change value {last} of {accessor.count}")
        return places, self._stored(values, dtype, count, width, whose)

    def _take(self, count: int, what: str):
        """Take so many numbers off what may be decoded."""
        self._left -= count
        check(
            self._left >= 0,
            f"with {what} it has more than {MOST_NUMBERS} numbers; export fewer parts or clips",
        )

    def _stored(self, owner: JsonObject, dtype, count: int, width: int, what: str) -> np.ndarray:
        """The numbers that an object's buffer view holds.  [count, width]"""
        view = self.at(self.root.bufferViews, owner.bufferView, "buffer view", what)
        start, size = owner.byteOffset or 0, width * dtype.itemsize
        stride, first, length = view.byteStride or size, view.byteOffset or 0, view.byteLength
        good = all(map(is_count, (start, stride, first, length)))
        needed = start + (count - 1) * stride + size if good and count else 0
        check(
            good and size <= stride <= 252 and needed <= length,
            f"{what} need {needed} bytes of a part of {str(length)[:20]}",
        )
        buffer = self._buffer(view.buffer, what)
        check(
            first + length <= len(buffer), f"{what} lie outside of the file's {len(buffer)} bytes"
        )
        data = buffer[first + start : first + max(start, needed)]
        return np.ndarray((count, width), dtype, data, 0, (stride, dtype.itemsize))

    def _buffer(self, index, what):
        """What has the bytes of a buffer: it has a length, and slices."""
        buffer = self.at(self.root.buffers, index, "buffer", what)
        if index not in self._buffers:
            uri = buffer.uri
            if uri is None:
                check(index == 0 and self._blob, f"{what} are in a buffer without data")
                self._buffers[index] = self._blob
            else:
                check(
                    str(uri)[:200].startswith(DATA_URI) and ";base64," in uri[:200],
                    f"{what} are in another file, {str(uri)[:60]!r}, which is not read; export "
                    "everything into one .glb",
                )
                data = base64.b64decode(uri.split(",", 1)[1], validate=True)
                self._buffers[index] = memoryview(data)
        return self._buffers[index]

    def _text(self) -> bytes:
        """The JSON; of a .glb, `_blob` becomes where its numbers are."""
        size = self._path.stat().st_size
        check(size <= LARGEST_FILE, f"it has {size / 2**20:.0f} MiB, more than 512")
        with open(self._path, "rb") as stream:
            start = stream.read(20)
            if start[:4] != b"glTF":
                check(
                    size <= LARGEST_TEXT,
                    f"it has {size / 2**20:.0f} MiB of text, more than 64; export it as .glb",
                )
                return start + stream.read(LARGEST_TEXT)
            check(len(start) == 20, "it ends in its header")
            _, version, _, length, kind = struct.unpack("<4sIIII", start)
            check(version == 2, f"it is glTF {version}, this program reads 2.0")
            check(kind == JSON and length <= LARGEST_TEXT, "its first part is no JSON of 64 MiB")
            text = stream.read(length)
            check(len(text) == length, f"it ends in its JSON, which has {length} bytes")
            header = stream.read(8)
            if len(header) == 8:
                length, kind = struct.unpack("<II", header)
                if kind == BINARY:
                    first = stream.tell()
                    self._blob = _InFile(self._path, first, min(length, size - first))
            return text


class _InFile:
    """Bytes of a .glb; a slice of them is read where it is needed."""

    def __init__(self, path: Path, first: int, length: int):
        self._path, self._first, self._length = path, first, length

    def __len__(self):
        return self._length

    def __getitem__(self, span: slice) -> bytes:
        with open(self._path, "rb") as stream:
            stream.seek(self._first + span.start)
            data = stream.read(span.stop - span.start)
        check(len(data) == span.stop - span.start, "it changed while it was read")
        return data


def _root(text: bytes) -> JsonObject:
    """The root of the JSON."""
    good = json_values(text) <= MOST_VALUES
    check(good, f"its JSON has more than {MOST_VALUES} values; export less")
    try:
        with no_garbage_collected():  # which would go through all objects again and again
            root = json.loads(text.decode("utf-8-sig"), object_hook=JsonObject)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"its JSON can't be read ({one_line(error, 100)})") from None
    check(isinstance(root, JsonObject), "it holds no glTF")
    for name in LISTS:
        objects = getattr(root, name)
        objects = [] if objects is None else objects
        good = isinstance(objects, list) and all(isinstance(one, JsonObject) for one in objects)
        check(good, f"its {name} are no list")
        setattr(root, name, objects)
    return root


def json_values(text: bytes) -> int:
    """How many values JSON has at most, by its marks: before they take memory."""
    return 1 + sum(map(text.count, (b"{", b"[", b",", b":")))
