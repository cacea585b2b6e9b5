"""Damage to .npz files that knows what a zip and an array's header say, and bombs of them."""

import io
import struct
import zipfile

import numpy as np

from .damage import with_arrays, with_bytes

LOCAL, CENTRAL = b"PK\3\4", b"PK\1\2"
# Bytes from an entry's mark on, and how many: version, flags, method, checksum, sizes, name.
LOCAL_FIELDS = [(4, 2), (6, 2), (8, 2), (14, 4), (18, 4), (22, 4), (26, 2), (28, 2)]
CENTRAL_FIELDS = [(6, 2), (8, 2), (10, 2), (16, 4), (20, 4), (24, 4), (28, 2), (34, 2), (42, 4)]
METHODS = [8, 9, 12, 14, 93, 99, 0]
HEADERS = ["[" * 3000, "{}", "{'descr': [('a','<f4')], 'fortran_order': False, 'shape': (3,)}"]
HEADERS += ["{'descr': '\\x00', 'fortran_order': False, 'shape': (3,)}", "9" * 4000, "-" * 3000]
HEADERS += ["{'descr': '|O', 'fortran_order': False, 'shape': (3,)}", "", "None", "x" * 60_000]
BOMB_BYTES = 550 * 2**20  # beyond what a mutant may take
BOMBS = []  # the one that was made, since that takes seconds


def with_zip(rng, data: bytes, arrays: dict) -> tuple[bytes, str]:
    """An .npz that is damaged somewhere."""
    kind = int(rng.integers(12))
    if kind <= 3:
        return with_arrays(rng, arrays), "arrays"
    if kind <= 5:
        return _with_field(rng, data)
    if kind == 6:
        return _with_method(rng, arrays)
    if kind == 7:
        return _with_header(rng, arrays), "an array's header"
    if kind == 8:
        return _damaged_stream(rng, arrays), "a deflate stream that is none"
    if kind == 9 and rng.random() < 0.2:
        if not BOMBS:
            BOMBS.append(bomb(arrays))
        return BOMBS[0], "a bomb"
    return with_bytes(rng, data), "bytes"


def _entries(data, mark):
    at = -1
    while (at := data.find(mark, at + 1)) >= 0:
        yield at


def _with_field(rng, data):
    data = bytearray(data)
    mark, fields = ((LOCAL, LOCAL_FIELDS), (CENTRAL, CENTRAL_FIELDS))[rng.integers(2)]
    entries = list(_entries(data, mark))
    place, size = fields[rng.integers(len(fields))]
    at = entries[rng.integers(len(entries))] + place
    value = int(rng.choice([0, 1, 2 ** (8 * size) - 1, 2 ** (8 * size - 1), 9, 99, 2**15]))
    data[at : at + size] = (value % 2 ** (8 * size)).to_bytes(size, "little")
    return bytes(data), f"{value} in a zip's entry"


def _with_method(rng, arrays):
    """All entries say another compression, or that they are encrypted."""
    stream = io.BytesIO()
    (np.savez_compressed if rng.random() < 0.5 else np.savez)(stream, **arrays)
    data, encrypted = bytearray(stream.getvalue()), rng.random() < 0.3
    method = int(METHODS[rng.integers(len(METHODS))])
    for mark, flags in ((LOCAL, 6), (CENTRAL, 8)):
        for at in _entries(data, mark):
            if encrypted:
                data[at + flags] |= 1
            else:
                data[at + flags + 2 : at + flags + 4] = struct.pack("<H", method)
    return bytes(data), "encrypted" if encrypted else f"method {method}"


def _damaged_stream(rng, arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    data = bytearray(stream.getvalue())
    entries = list(_entries(data, LOCAL))
    at = entries[rng.integers(len(entries))]
    first = at + 30 + sum(struct.unpack_from("<HH", data, at + 26)) + int(rng.integers(20))
    data[first : first + 12] = b"\xff" * 12
    return bytes(data)


def _with_header(rng, arrays):
    """One array has a header that NumPy doesn't write, or a shape that isn't its own."""
    stream, chosen = io.BytesIO(), list(arrays)[rng.integers(len(arrays))]
    with zipfile.ZipFile(stream, "w") as file:
        for name, values in arrays.items():
            own = io.BytesIO()
            np.save(own, values)
            content = own.getvalue()
            if name == chosen:
                text = HEADERS[rng.integers(len(HEADERS))]
                if rng.random() < 0.5:
                    shape = [(-5, 3), (2**31, 3), (2**62, 2**62), (0, 2**60), (True,), ()][
                        rng.integers(6)
                    ]
                    text = repr({"descr": "<f4", "fortran_order": False, "shape": shape})
                header = text.encode() + b"\n"
                version = b"\x93NUMPY\2\0" + struct.pack("<I", len(header))
                content = version + header + values.tobytes()
            file.writestr(f"{name}.npy", content)
    return stream.getvalue()


def bomb(arrays) -> bytes:
    """The first array has BOMB_BYTES of zeros: half a megabyte of file."""
    stream, (first, *others) = io.BytesIO(), arrays
    row = arrays[first][:1]
    shape = (BOMB_BYTES // max(row.nbytes, 1), *row.shape[1:])
    header = repr({"descr": row.dtype.str, "fortran_order": False, "shape": shape}).encode()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        with file.open(f"{first}.npy", "w", force_zip64=True) as entry:
            entry.write(b"\x93NUMPY\1\0" + struct.pack("<H", len(header) + 1) + header + b"\n")
            left = shape[0] * row.nbytes
            while left > 0:
                entry.write(bytes(min(left, 2**22)))
                left -= 2**22
        for name in others:
            own = io.BytesIO()
            np.save(own, arrays[name])
            file.writestr(f"{name}.npy", own.getvalue())
    return stream.getvalue()
