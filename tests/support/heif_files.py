"""HEIC files of pixels, honest ones and others: HEVC by x265 in PyAV, boxes by hand."""

import struct
from fractions import Fraction

import av
import numpy as np
import pytest

ROTATE, MIRROR = b"irot", b"imir"
PARAMETER_SETS = (32, 33, 34)  # kinds of NAL units: VPS, SPS, PPS


def box(kind: bytes, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack(">I", 8 + len(content)) + kind + content


def full(kind: bytes, *parts: bytes, version=0, flags=0) -> bytes:
    return box(kind, struct.pack(">I", version << 24 | flags), *parts)


def coded(pixels, depth=8, span="full"):
    """hvcC's content and the coded bytes of pixels [h, w, 3] uint8, of even width and height.

    Args:
        span: The range that HEVC itself states; the pixels are in the full one.
    """
    if "libx265" not in av.codecs_available:
        pytest.skip("FFmpeg has no x265 here")
    height, width = pixels.shape[:2]
    encoder = av.CodecContext.create("libx265", "w")
    encoder.width, encoder.height, encoder.time_base = width, height, Fraction(1)
    encoder.pix_fmt = "yuv420p" if depth == 8 else "yuv420p10le"
    said = f"log-level=none:info=0:qp=6:keyint=1:pools=none:frame-threads=1:range={span}"
    encoder.options = {"x265-params": said, "preset": "ultrafast"}
    frame = av.VideoFrame.from_ndarray(planes(pixels, depth), encoder.pix_fmt)
    data = b"".join(bytes(p) for p in [*encoder.encode(frame), *encoder.encode(None)])
    units = [u.lstrip(b"\0") for u in data.replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1")]
    units = [u for u in units if u]
    sets = [[u for u in units if u[0] >> 1 & 63 == kind] for kind in PARAMETER_SETS]
    profile = sets[1][0].replace(b"\0\0\3", b"\0\0")[3:15]
    shape = bytes([0xF0, 0, 0xFC, 0xFD, 0xF8 | depth - 8, 0xF8 | depth - 8, 0, 0, 0x0F])
    config = b"\1" + profile + shape + b"\3"
    for kind, found in zip(PARAMETER_SETS, sets, strict=True):
        config += struct.pack(">BHH", 0x80 | kind, 1, len(found[0])) + found[0]
    pictures = [u for u in units if u[0] >> 1 & 63 < 32]
    return config, b"".join(struct.pack(">I", len(u)) + u for u in pictures)


def planes(pixels, depth):
    """Y', Cb and Cr by BT.601 in the full range, one after another; colors at half the size."""
    red, green, blue = np.moveaxis(pixels.astype(float), -1, 0)
    y = 0.299 * red + 0.587 * green + 0.114 * blue
    height, width = y.shape
    small = [
        c.reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3))
        for c in ((blue - y) / 1.772, (red - y) / 1.402)
    ]
    most, middle = 2**depth - 1, 2 ** (depth - 1)
    values = [y * most / 255, *(c * most / 255 + middle for c in small)]
    whole = np.concatenate([np.round(np.clip(v, 0, most)).ravel() for v in values])
    return whole.reshape(-1, width).astype(np.uint8 if depth == 8 else np.uint16)


def cut(pixels, side):
    """Square tiles of pixels, row by row, and the columns; the last ones repeat the edge."""
    height, width = pixels.shape[:2]
    padded = np.pad(pixels, ((0, -height % side), (0, -width % side), (0, 0)), "edge")
    rows, columns = padded.shape[0] // side, padded.shape[1] // side
    tiles = padded.reshape(rows, side, columns, side, 3).swapaxes(1, 2)
    return list(tiles.reshape(-1, side, side, 3)), columns


def heic(
    pixels, side=None, turns=(), exif=None, colors=(1, 13, 6, 0x80), depth=8, span="full", **lies
) -> bytes:
    """A file with the pixels; a grid if there is the side of tiles.

    Args:
        turns: Pairs of a property's kind and content, for the picture.
        exif: EXIF data, from TIFF's header on.
        colors: nclx's: primaries, transfer function, matrix, range; None for no such box.
        lies: Instead of what is right: `size` (ispe of what is coded), `grid` (content of the
            item), `tiles` (items that the grid refers to), `kind` (of coded items), `place`
            (offset and length of the first item), `brand`, `known`, `listed` and
            `references` (further properties, which items have them, further boxes of iref),
            `needed` (turns are properties that a reader has to know).
    """
    parts, columns = (cut(pixels, side)) if side else ([pixels], 1)
    coded_parts = [coded(part, depth, span) for part in parts]
    size = lies.get("size", parts[0].shape[1::-1])
    height, width = pixels.shape[:2]
    count = len(parts)
    items = [(n + 1, lies.get("kind", b"hvc1"), data) for n, (_, data) in enumerate(coded_parts)]
    known = [
        full(b"ispe", struct.pack(">II", *size)),
        box(b"hvcC", coded_parts[0][0]),
        *(box(kind, content) for kind, content in turns),
    ]
    essential = 0x80 * lies.get("needed", False)
    of_shown = [essential | n for n in range(3, 3 + len(turns))]  # places begin with 1
    if colors:
        known.append(box(b"colr", b"nclx" + struct.pack(">HHHB", *colors)))
        of_shown.append(len(known))
    listed, references, shown = {n: [1, 2] for n in range(1, count + 1)}, [], 1
    if side:
        shown = 100
        rows = count // columns
        grid = lies.get("grid", struct.pack(">BBBBHH", 0, 0, rows - 1, columns - 1, width, height))
        items.append((shown, b"grid", grid))
        tiles = lies.get("tiles", list(range(1, count + 1)))
        references.append(box(b"dimg", struct.pack(f">HH{len(tiles)}H", shown, len(tiles), *tiles)))
        known.append(full(b"ispe", struct.pack(">II", width, height)))
        listed[shown] = [len(known)]
    listed[shown] += of_shown
    if exif is not None:
        items.append((200, b"Exif", struct.pack(">I", 6) + b"Exif\0\0" + exif))
        references.append(box(b"cdsc", struct.pack(">HHH", 200, 1, shown)))
    known += lies.get("known", ())
    listed |= lies.get("listed", {})
    references += lies.get("references", ())
    others = {name: lies[name] for name in ("place", "brand") if name in lies}
    return assembled(items, shown, known, listed, references, **others)


def assembled(items, shown, known, listed, references, place=None, brand=b"heic"):
    """The boxes of a file: ftyp, meta, mdat."""
    head = box(b"ftyp", brand, bytes(4), b"mif1" if brand == b"heic" else brand)
    infe = [
        full(b"infe", struct.pack(">HH", number, 0), kind, b"\0", version=2)
        for number, kind, _ in items
    ]
    ipma = [struct.pack(f">HB{len(p)}B", n, len(p), *p) for n, p in listed.items()]

    def meta(begin):
        iloc, at = [], begin
        for number, _, data in items:
            offset, length = place if place and number == 1 else (at, len(data))
            iloc.append(struct.pack(">HHHII", number, 0, 1, offset, length))
            at += len(data)
        return full(
            b"meta",
            full(b"hdlr", bytes(4), b"pict", bytes(13)),
            full(b"pitm", struct.pack(">H", shown)),
            full(b"iinf", struct.pack(">H", len(infe)), *infe),
            full(b"iref", *references),
            box(b"iprp", box(b"ipco", *known), full(b"ipma", struct.pack(">I", len(ipma)), *ipma)),
            full(b"iloc", b"\x44\x00", struct.pack(">H", len(iloc)), *iloc),
        )

    begin = len(head) + len(meta(0)) + 8
    return head + meta(begin) + box(b"mdat", *(data for *_, data in items))
