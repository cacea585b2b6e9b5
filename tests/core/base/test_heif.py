"""Where a HEIF file says that its picture lies; what lies is refused before memory is taken."""

import struct
import time

import numpy as np
import pytest
from heif_files import MIRROR, ROTATE, box, full, heic
from peak_memory import peak_memory

from deformrf.core.base.heif import HeifError, is_heif, read_heif
from deformrf.core.base.images import MOST_PIXELS

PIXELS = np.random.default_rng(2).integers(0, 256, (40, 56, 3), np.uint8)
NOTHING = 2**20  # bytes that reading a header may take


def clap(*numbers):
    return b"clap", struct.pack(">8I", *(n % 2**32 for n in numbers))


def read(tmp_path, data):
    path = tmp_path / "a.heic"
    path.write_bytes(data)
    return read_heif(path, MOST_PIXELS)


def refused(tmp_path, data, words):
    """That a file is refused with these words, soon and without memory."""
    path = tmp_path / "a.heic"
    path.write_bytes(data)

    def read():
        with pytest.raises(HeifError, match=words):
            read_heif(path, MOST_PIXELS)

    began = time.process_time()
    read()
    assert time.process_time() - began < 5.0
    assert peak_memory(read) < NOTHING + 4 * len(data)


def test_a_grid_is_found_as_it_was_written(tmp_path):
    heif = read(tmp_path, heic(PIXELS, 32, exif=b"II*\0"))
    assert is_heif(tmp_path / "a.heic")
    assert heif.size == heif.stored == (56, 40) and heif.tile == (32, 32) and heif.columns == 2
    assert len(heif.places) == 4 and heif.exif == b"II*\0" and heif.colors == (13, 6, True)
    data = (tmp_path / "a.heic").read_bytes()
    ends = [0]
    for ((offset, length),) in heif.places:
        assert int.from_bytes(data[offset : offset + 4], "big") == length - 4  # one NAL unit
        assert offset >= ends[-1]
        ends.append(offset + length)


def test_turns_and_crops_are_done_in_the_order_of_the_file(tmp_path):
    turns = (clap(50, 1, 40, 1, 3, 1, 0, 1), (ROTATE, b"\1"), (MIRROR, b"\0"))
    heif = read(tmp_path, heic(PIXELS, turns=turns))
    assert heif.turns == (("crop", 6, 0, 56, 40), ("rotate", 1), ("mirror", 0))
    assert heif.stored == (56, 40) and heif.size == (40, 50)
    # An odd size of an encoder that knows even ones: the crop's middle is half a pixel off.
    heif = read(tmp_path, heic(PIXELS, turns=(clap(55, 1, 39, 1, -1, 2, -1, 2),)))
    assert heif.turns == (("crop", 0, 0, 55, 39),) and heif.size == (55, 39)


@pytest.mark.parametrize(
    "lies, words",
    [
        ({"size": (10**9, 10**9)}, "1000000000x1000000000 pixels, and at most 100 million"),
        ({"size": (2**32 - 8, 4)}, "4294967288x4 pixels"),
        ({"size": (0, 0)}, "is damaged"),
        ({"size": (4, 4), "place": (0, 2**17)}, "ends too early, or is damaged"),
        ({"place": (2**31, 2**31)}, "ends too early"),
        ({"place": (0, 0)}, "ends too early, or is damaged"),
        ({"kind": b"av01"}, "of the kind av01, and only HEVC is read"),
        ({"kind": b"\x1b[2J"}, "it is damaged"),
        ({"turns": [(ROTATE, b"\1")] * 9}, "is damaged"),
        ({"turns": [(ROTATE, b"")]}, "is damaged"),
        ({"turns": [clap(50, 0, 40, 1, 0, 1, 0, 1)]}, "is damaged"),
        ({"turns": [clap(10**9, 1, 40, 1, 0, 1, 0, 1)]}, "is damaged"),
        ({"turns": [clap(-1, 1, -1, 1, 0, 1, 0, 1)]}, "is damaged"),
        ({"turns": [clap(50, 1, 40, 1, -4, 1, 0, 1)]}, "is damaged"),
    ],
)
def test_a_picture_that_lies_is_refused(tmp_path, lies, words):
    refused(tmp_path, heic(PIXELS, **lies), words)


def grid(rows, columns, width, height):
    return struct.pack(">BBBBHH", 0, 0, rows - 1, columns - 1, width, height)


@pytest.mark.parametrize(
    "lies, words",
    [
        ({"grid": grid(256, 256, 60000, 60000)}, "is damaged"),
        ({"grid": grid(2, 2, 60000, 60000)}, "60000x60000 pixels"),
        ({"grid": grid(2, 2, 65, 40)}, "is damaged"),  # wider than its tiles
        ({"grid": grid(2, 2, 32, 40)}, "is damaged"),  # not as wide as to need them
        ({"grid": grid(2, 2, 0, 40)}, "is damaged"),
        ({"grid": b"\0\0"}, "is damaged"),
        ({"grid": bytes(100)}, "is damaged"),
        ({"grid": struct.pack(">BBBBII", 0, 1, 1, 1, 2**32 - 1, 2**32 - 1)}, "4294967295x"),
        ({"tiles": [1, 2, 3]}, "is damaged"),
        ({"tiles": [1, 1, 1, 1]}, "is damaged"),
        ({"tiles": [1, 2, 3, 100]}, "of the kind grid, and only HEVC"),  # of itself
        ({"tiles": [1, 2, 3, 77]}, "is damaged"),
        ({"size": (2**16, 2**16)}, "is damaged|pixels"),
    ],
)
def test_a_grid_that_lies_is_refused(tmp_path, lies, words):
    refused(tmp_path, heic(PIXELS, 32, **lies), words)


def test_a_part_that_ends_nowhere_is_refused(tmp_path):
    data = heic(PIXELS)
    begin = data.index(b"meta") - 4
    length = int.from_bytes(data[begin : begin + 4], "big")
    for lie in (1, 7, length - 1, length + 1, 2**32 - 1):
        lied = data[:begin] + struct.pack(">I", lie) + data[begin + 4 :]
        refused(tmp_path, lied, "damaged|no still picture|too early")
    far = struct.pack(">I4sQ", 1, b"free", 2**64 - 1)
    refused(tmp_path, data[:begin] + far, "too early")
    refused(tmp_path, data[:begin] + struct.pack(">I4s", 8, b"free") * 30_000, "20000 parts")
    refused(tmp_path, data[:begin], "no still picture")


def test_counts_that_nothing_follows_are_refused(tmp_path):
    """Places of parts that take no bytes; more properties or items than there are."""
    data = heic(PIXELS)
    sizes, begin = data.index(b"\x44\x00", data.index(b"iloc")), data.index(b"ipma") + 8
    free = data[:sizes] + b"\0" + data[sizes + 1 :]
    refused(tmp_path, free, "is damaged")
    refused(tmp_path, data[:sizes] + b"\x40" + data[sizes + 1 :], "is damaged")
    refused(tmp_path, data[:begin] + b"\xff" * 4 + data[begin + 4 :], "is damaged")
    place = data.index(b"\0\1\x03\1\2\3", begin)  # item 1 has properties 1, 2, 3
    refused(tmp_path, data[: place + 5] + b"\x7f" + data[place + 6 :], "is damaged")


def test_a_file_that_is_cut_anywhere_is_refused(tmp_path):
    data = heic(PIXELS, 32, exif=b"II*\0")
    for end in range(24, len(data) - 20, max(len(data) // 300, 1)):  # EXIF lies at the end
        refused(tmp_path, data[:end], "too early|damaged|no still picture")


def test_what_would_change_the_picture_is_refused(tmp_path):
    """Transparency in another item, and properties that a reader has to know."""
    alpha = full(b"auxC", b"urn:mpeg:hevc:2015:auxid:1\0")
    iref = full(b"iref", box(b"auxl", struct.pack(">HHH", 9, 1, 1)))
    lied = heic(PIXELS, known=(alpha,), listed={9: [4]}, references=(iref[12:],))
    refused(tmp_path, lied, "has transparency")
    refused(tmp_path, heic(PIXELS, turns=((b"evil", b"\1"),), needed=True), "is not known")
    assert read(tmp_path, heic(PIXELS, turns=((b"rloc", b"\1"),))).turns == ()


def test_damaged_exif_decide_nothing(tmp_path):
    data = heic(PIXELS, exif=b"II*\0")
    begin = data.index(b"Exif\0\0") - 4
    assert read(tmp_path, data[:begin] + b"\xff" * 4 + data[begin + 4 :]).exif == b""


def test_other_files_are_no_heif(tmp_path):
    path = tmp_path / "a"
    for data in (
        b"",
        b"\0\0\0\x18ftyp",
        b"\0\0\0\x18ftypisom\0\0\0\0mp42",
        b"\x89PNG\r\n\x1a\n" * 9,
    ):
        path.write_bytes(data)
        assert not is_heif(path)
    path.write_bytes(b"\0\0\0\x18ftypXXXX\0\0\0\0mif1heic")
    assert is_heif(path)
