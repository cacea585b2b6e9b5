"""Damage to files: of bytes, of text, of JSON, of the arrays of an .npz; each knows structure.

Every function takes a random generator and something whole, and returns something damaged.
A `Binary` knows where its counts and lengths stand and where its parts begin.
"""

import copy
import io
import json
import struct
from dataclasses import dataclass

import numpy as np

NASTY = [None, True, -1, 0, 1, 2**31, 2**63, 10**400, 1e300, float("nan"), float("inf"), 0.5]
NASTY += ["", "a\n\x1b[31mb", "é" * 500, [], {}, [[]], [1] * 1000, {"a": [None]}, 1e-300, 3]
NASTY_NUMBERS = [0, 1, -1, 2**16 - 1, 2**31 - 1, 1e38, -3e38, 1e-40, np.nan, np.inf, 65504]
NASTY_WORDS = ["nan", "-inf", "1e400", "-1", "0", "18446744073709551616", "99999999999", "1e-320"]
NASTY_WORDS += ["", "x", '"', "#", "é" * 300, "\x00", "\x1b[2J", "1,5", "0x10", "1_0", "../a"]
TYPES = ["<u2", "<i4", "<i8", "<u8", "<f2", "<f4", "<f8", ">f4", "|u1", "|i1", "|b1", "<c8", "<U4"]
PATHS = [
    "C:\\data\\{0}",
    "/home/x/data/{0}",
    "\\\\server\\share\\{0}",
    "..\\{0}",
    ".\\{0}",
    "./{0}",
]
PATHS += ["file:///{0}", "data:image/png;base64,AAAA", "{0}\x00", "{0}/", "~/{0}", "/dev/zero"]
PATHS += ["/proc/self/mem", "{0}.PNG", "a/" * 300 + "{0}", "x" * 5000, "../{0}", "//{0}", " {0} "]


@dataclass(frozen=True)
class Binary:
    """A file of bytes.

    Attributes:
        counts: Where counts and lengths stand: (first byte, struct's format) of each.
        parts: Where parts begin, ascending.
    """

    data: bytes
    counts: tuple = ()
    parts: tuple = ()


def with_bytes(rng, data):
    """Some bytes exchanged, turned or gone, wherever they are."""
    data = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        if not data:
            break
        place = rng.integers(len(data))
        kind = rng.integers(4)
        if kind == 0:
            data[place] = rng.integers(256)
        elif kind == 1:
            data[place] ^= 1 << rng.integers(8)
        elif kind == 2:
            del data[place : place + int(rng.integers(1, 100))]
        else:  # where zip has its list of entries
            data[-1 - rng.integers(min(len(data), 1500))] = rng.choice([0, 255, 127, 1])
    return bytes(data)


def with_structure(rng, whole: Binary, other: bytes = b"") -> tuple[bytes, str]:
    """A count that is wrong, or parts that are cut, doubled, exchanged, of another file."""
    data, parts = bytearray(whole.data), [0, *whole.parts, len(whole.data)]
    kind = rng.integers(8)
    if kind <= 2 and whole.counts:
        for _ in range(rng.integers(1, 3)):
            # The first ones say most: how many entries there are.
            place, form = whole.counts[int(len(whole.counts) * rng.random() ** 3)]
            value = _wrong(rng, struct.unpack_from(form, data, place)[0], struct.calcsize(form))
            data[place : place + struct.calcsize(form)] = _packed(form, value)
        return bytes(data), f"count at {place} is {value}"
    first, last = np.sort(rng.choice(len(parts), 2, replace=len(parts) < 2))
    first, last = parts[first], parts[last]
    if kind == 3:
        cut = max(0, last + int(rng.integers(-1, 2)))
        return bytes(data[:cut]), f"cut at {cut} of {len(data)}"
    if kind == 4:
        return bytes(data[:first] + data[last:]), f"without {first}..{last}"
    if kind == 5:
        times = int(rng.choice([2, 3, 100]))
        return bytes(data[:first] + data[first:last] * times + data[last:]), f"{times} times a part"
    if kind == 6 and other:
        place = int(rng.integers(len(other) + 1))
        return bytes(data[:last] + other[place:]), f"spliced at {last}"
    return with_bytes(rng, data), "bytes"


def _wrong(rng, value, size):
    """Another value for a count of that many bytes."""
    top = 256**size
    some = [0, value + 1, value - 1, top - 1, top // 2, top // 2 - 1, 2 * value, value // 2, 10**6]
    some += [value * 1000, int(rng.integers(0, 300)), 2**28 + value, 2**20, 2**40]
    return int(some[rng.integers(len(some))]) % top


def _packed(form, value):
    size = struct.calcsize(form)
    return int(value).to_bytes(size, "big" if form[0] == ">" else "little")


def with_text(rng, text: str) -> tuple[bytes, str]:
    """A text of lines: some words or lines are exchanged, or the file's form is another."""
    lines = text.splitlines()
    what = []
    for _ in range(rng.integers(1, 4)):
        kind, at = int(rng.integers(9)), int(rng.integers(max(len(lines), 1)))
        if not lines:
            break
        words = lines[at].split(" ")
        word = int(rng.integers(len(words)))
        if kind <= 2:
            words[word] = NASTY_WORDS[rng.integers(len(NASTY_WORDS))]
        elif kind == 3:
            del words[word:]
        elif kind == 4:
            words = words * int(rng.choice([2, 50]))
        lines[at] = " ".join(words)
        if kind == 5:
            del lines[at]
        elif kind == 6:
            lines.insert(at, lines[rng.integers(len(lines))])
        elif kind == 7:
            lines.insert(at, "# " + lines[at])
        elif kind == 8:
            del lines[at:]
        what.append(f"line {at} by {kind}")
    data = ("\r\n" if rng.random() < 0.1 else "\n").join(lines).encode("utf-8", "surrogatepass")
    form = int(rng.integers(12))
    if form == 0:
        data = b"\xef\xbb\xbf" + data
    elif form == 1:
        data = data.decode().encode("utf-16")
    elif form == 2:
        data = with_bytes(rng, data)
    elif form == 3 and len(data):
        data = data[: rng.integers(len(data))]
    return data, ", ".join(what)


def with_values(rng, value):
    """JSON with some values exchanged, removed, added, repeated, or of another type."""
    value = copy.deepcopy(value)
    for _ in range(rng.integers(1, 4)):
        place = value
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = keys[rng.integers(len(keys))]
            if isinstance(place[key], (dict, list)) and place[key] and rng.random() < 0.8:
                place = place[key]
                continue
            _damage(rng, place, key, keys)
            break
    return value


def _damage(rng, place, key, keys):
    """Change one entry of a list or a dict in place."""
    kind, old = int(rng.integers(11)), place[key]
    number = isinstance(old, int | float) and not isinstance(old, bool) and abs(old) < 2**60
    if kind <= 1:
        del place[key]
    elif kind == 2 and number:
        place[key] = [-old, old + 1, old - 1, old * 1000, 1e-9 * old, old + 0.5][rng.integers(6)]
    elif kind == 3:
        place[key] = [str(old), [old], {"a": old}, [old] * 50, old is None][rng.integers(5)]
    elif kind == 4:
        place[key] = copy.deepcopy(place[keys[rng.integers(len(keys))]])
    elif kind == 5 and isinstance(place, list):
        place[key:key] = [old] * int(rng.choice([1, 2, 300]))
    elif kind == 6 and isinstance(place, dict):
        name = keys[rng.integers(len(keys))]
        place[name if rng.random() < 0.5 else str(key)[1:]] = place.pop(key)
    elif kind == 7 and isinstance(old, str):
        place[key] = PATHS[rng.integers(len(PATHS))].format(old)
    else:
        place[key] = copy.deepcopy(NASTY[rng.integers(len(NASTY))])


def json_bytes(rng, value) -> tuple[bytes, str]:
    """The text of JSON: of other values, or other bytes, or nested deeply, or told twice."""
    kind = int(rng.integers(12))
    text = json.dumps(value)
    if kind == 0:
        return with_bytes(rng, text.encode()), "bytes of JSON"
    if kind == 1:
        depth = int(rng.choice([200, 5000, 200_000]))
        return text.replace("[", "[" * depth, 1).encode(), f"{depth} brackets"
    if kind == 2:
        return text[: rng.integers(len(text))].encode(), "JSON cut off"
    if kind == 3:
        return b"\xef\xbb\xbf" + text.encode(), "a byte order mark"
    if kind == 4:
        return json.dumps(value, indent=1).replace("\n", "\r\n").encode("utf-16"), "UTF-16"
    return json.dumps(with_values(rng, value)).encode(), "values of JSON"


def with_arrays(rng, arrays):
    """Arrays of an .npz: other values, lengths and types."""
    arrays = dict(arrays)
    for _ in range(rng.integers(1, 3)):
        name = list(arrays)[rng.integers(len(arrays))]
        array, kind = arrays[name].copy(), rng.integers(8)
        if kind <= 1 and array.size:
            value = NASTY_NUMBERS[rng.integers(len(NASTY_NUMBERS))]
            with np.errstate(all="ignore"):
                array.reshape(-1)[rng.integers(array.size)] = np.array(value).astype(array.dtype)
        elif kind == 2:
            array = array[: rng.integers(len(array) + 1)]
        elif kind == 3:
            array = np.concatenate([array] * int(rng.integers(2, 5)))
        elif kind == 4:
            array = rng.permutation(array)
        elif kind == 5:
            array = np.zeros(array.shape, TYPES[rng.integers(len(TYPES))])
        elif kind == 6 and len(arrays) > 1:
            del arrays[name]
            continue
        elif array.dtype.kind != "U":  # of a mutation before
            with np.errstate(all="ignore"):
                array = array * array.dtype.type(rng.choice([0, 2, 7]))
        arrays[name] = array
    return packed(rng, arrays)


def packed(rng, arrays) -> bytes:
    stream = io.BytesIO()
    (np.savez_compressed if rng.random() < 0.3 else np.savez)(stream, **arrays)
    return stream.getvalue()
