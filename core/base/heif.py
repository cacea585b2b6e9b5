"""Find in a HEIF file where its picture lies, how large it is, and how it is turned.

A telephone's .heic file is a tree of boxes (ISO/IEC 14496-12), each a length, a kind of four
letters and a content.  The box `meta` (ISO/IEC 23008-12) lists items:

    pitm  the number of the item that is shown: an HEVC picture (hvc1), or a grid of such
    iinf  the kind of each item;  iref  which items another one is made of, or describes
    iloc  where an item's bytes lie: in the file, or in the box `idat`
    iprp  properties of items: ispe, the size; hvcC, what the decoder has to know; clap, irot and
          imir, how the picture is cropped and turned, in that order of the list; colr, colors

The picture is as irot and imir turn it; the EXIF orientation says the same once more.

Nothing of the file is trusted: lengths, counts and places are compared with what is there before
anything is read, and no reference is followed further than from a grid to its tiles.  Nothing is
decoded here: core/base/heif_decoding.py does that.
"""

import os
from dataclasses import dataclass
from math import floor

from .reading import open_file

BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"}
MOST_BOXES = 20_000  # in one box
MOST_META = 16 * 2**20  # bytes
MOST_EXIF = 2**20  # bytes
MOST_TURNS = 8
# Coded bytes: hardly a picture takes more than its pixels do without compression.
BYTES_A_PIXEL, LEAST_BYTES = 4, 2**16
ALPHA = (b"urn:mpeg:hevc:2015:auxid:1\0", b"urn:mpeg:mpegB:cicp:systems:auxiliary:alpha\0")
KNOWN_KINDS = (
    "av01",
    "avc1",
    "jpeg",
    "j2k1",
    "vvc1",
    "unci",
    "mski",
    "grid",
    "iden",
    "iovl",
    "tmap",
)
NO_STILL = "it holds no still picture"


class HeifError(ValueError):
    """The file can't be read; the message is the reason, a part of a sentence.

    Attributes:
        advice: What to do.
    """

    def __init__(self, reason: str, advice: str = "store it as JPEG"):
        super().__init__(reason)
        self.advice = advice


@dataclass(frozen=True)
class Heif:
    """A picture in a file, and where it lies there.

    Attributes:
        size: Width and height as it is shown.
        stored: The same before it is cropped and turned: what the tiles make together.
        tile: Width and height of a tile; a picture that is no grid is one tile.
        columns: How many tiles are side by side; they are listed row by row.
        places: Of each tile, offset and length of its parts in the file.
        config: The content of hvcC, of all tiles.
        turns: What is done to what is stored, one after another: ("crop", left, top, right,
            bottom), ("rotate", quarter turns counterclockwise) or ("mirror", 0 exchanges top and
            bottom, 1 left and right).
        colors: Transfer function, matrix, and whether the range is full, as numbers of FFmpeg;
            None where HEVC itself has to say.
        exif: The EXIF data, from TIFF's header on; empty without any.
    """

    size: tuple[int, int]
    stored: tuple[int, int]
    tile: tuple[int, int]
    columns: int
    places: tuple[tuple[tuple[int, int], ...], ...]
    config: bytes
    turns: tuple[tuple, ...]
    colors: tuple[int, int, bool] | None
    exif: bytes


class Content:
    """Bytes that are read from their beginning on; a HeifError where they end too early.

    Attributes:
        at: Where the next byte lies in the file.
    """

    def __init__(self, data, at: int):
        self.data, self.at = memoryview(data), at

    def take(self, count: int) -> bytes:
        return bytes(self.part(count).data)

    def part(self, count: int) -> "Content":
        if count > len(self.data):
            raise HeifError("it is damaged")
        taken = Content(self.data[:count], self.at)
        self.data, self.at = self.data[count:], self.at + count
        return taken

    def number(self, count: int) -> int:
        return int.from_bytes(self.take(count), "big")

    def version(self) -> tuple[int, int]:
        """Version and flags, with which many boxes begin."""
        return self.number(1), self.number(3)

    def boxes(self):
        """Yield kind and content of each box."""
        for _ in range(MOST_BOXES):
            if not self.data:
                return
            length, kind, head = self.number(4), self.take(4), 8
            if length == 1:
                length, head = self.number(8), 16
            length = len(self.data) + head if length == 0 else length
            if length < head:
                raise HeifError("it is damaged")
            yield kind, self.part(length - head)
        raise HeifError(f"it has more than {MOST_BOXES} parts")


def is_heif(path) -> bool:
    """Whether a file begins as HEIF does, whatever its name.

    Raises:
        OSError: It can't be read.
    """
    with open_file(path) as stream:
        head = stream.read(64)
    if head[4:8] != b"ftyp":
        return False
    end = min(len(head), int.from_bytes(head[:4], "big"))
    return not BRANDS.isdisjoint([head[8:12], *(head[i : i + 4] for i in range(16, end, 4))])


def read_heif(path, most_pixels: int) -> Heif:
    """Read where a file's picture lies.

    Args:
        most_pixels: A picture of more is refused.

    Raises:
        HeifError: It is damaged, or has something that is not read.
        OSError: It can't be read at all.
    """
    with open_file(path) as stream:
        items = Items(meta_of(stream), os.fstat(stream.fileno()).st_size)
        shown = items.shown
        kind = items.kinds.get(shown)
        check_transparency(items, shown)
        tiles, columns, stored = [shown], 1, None
        if kind == b"grid":
            tiles, columns, stored = grid_of(items, shown, stream)
        tile, config = tile_of(items, tiles)
        stored = stored or tile
        if max(area(stored), area(tile)) > most_pixels:
            raise HeifError(
                f"it has {stored[0]}x{stored[1]} pixels, and at most {most_pixels >> 20} million "
                f"are read",
                "shrink it",
            )
        check_cover(stored, tile, columns, len(tiles))
        places = tuple(items.places_of(number) for number in tiles)
        count = sum(length for parts in places for _, length in parts)
        if count > BYTES_A_PIXEL * area(tile) * len(tiles) + LEAST_BYTES:
            raise HeifError("it is damaged")
        size, turns = turned(stored, items.properties_of(shown))
        colors = colors_of(items.properties_of(shown))
        exif = exif_of(items, shown, stream)
    return Heif(size, stored, tile, columns, places, config, turns, colors, exif)


def area(size) -> int:
    return size[0] * size[1]


def meta_of(stream) -> Content:
    """The content of the box `meta`, without reading what lies before it."""
    size, at = os.fstat(stream.fileno()).st_size, 0
    for _ in range(MOST_BOXES):
        stream.seek(at)
        head = Content(stream.read(16), at)
        if not head.data:
            raise HeifError(NO_STILL)
        length, kind = head.number(4), head.take(4)
        if length == 1:
            length = head.number(8)
        length = size - at if length == 0 else length
        begin = 8 if head.at - at == 8 else 16
        if not begin <= length <= size - at:
            raise HeifError("it ends too early, or is damaged")
        if kind == b"meta":
            if length > MOST_META:
                raise HeifError("it is damaged")
            stream.seek(at + begin)
            return Content(stream.read(length - begin), at + begin)
        at += length
    raise HeifError(f"it has more than {MOST_BOXES} parts")


class Items:
    """What the box `meta` says of items, by their numbers.

    Attributes:
        shown: The item that is shown.
        kinds: Of each item, four letters.
    """

    def __init__(self, meta: Content, size: int):
        meta.version()
        self._size, parts = size, {}
        for kind, content in meta.boxes():
            parts.setdefault(kind, content)
        missing = {b"pitm", b"iinf", b"iloc", b"iprp"} - set(parts)
        if missing:
            raise HeifError(NO_STILL)
        version, _ = parts[b"pitm"].version()
        self.shown = parts[b"pitm"].number(2 if version == 0 else 4)
        self.kinds = kinds_of(parts[b"iinf"])
        self._idat = parts.get(b"idat")
        self._references = references_of(parts.get(b"iref", Content(b"", 0)))
        self._properties = listed_properties(parts[b"iprp"])
        self._places = listed_places(parts[b"iloc"])

    def references(self, kind: bytes, number: int) -> list[int]:
        return self._references.get((kind, number), [])

    def referring(self, kind: bytes, number: int) -> list[int]:
        """The items with a reference to this one."""
        found = self._references.items()
        return [origin for (one, origin), targets in found if one == kind and number in targets]

    def properties_of(self, number: int) -> list[tuple[bytes, bytes]]:
        """Kind and content of an item's properties, in their order."""
        return self._properties.get(number, [])

    def places_of(self, number: int) -> tuple[tuple[int, int], ...]:
        """Offset and length in the file of each part of an item's bytes; all are there."""
        method, parts = self._places.get(number, (0, []))
        if method == 1 and self._idat is not None:
            begin, end = self._idat.at, self._idat.at + len(self._idat.data)
        elif method == 0:
            begin, end = 0, self._size
        else:
            raise HeifError("its picture lies where it is not read from")
        if not parts or any(length == 0 or begin + at + length > end for at, length in parts):
            raise HeifError("it ends too early, or is damaged")
        return tuple((begin + at, length) for at, length in parts)

    def read(self, stream, number: int, most: int) -> bytes:
        """The bytes of an item; a HeifError if there are more than `most`."""
        places = self.places_of(number)
        if sum(length for _, length in places) > most:
            raise HeifError("it is damaged")
        return b"".join(read_places(stream, places))


def read_places(stream, places):
    """Yield the bytes that lie in each place of a file."""
    for offset, length in places:
        stream.seek(offset)
        data = stream.read(length)
        if len(data) < length:
            raise HeifError("it ends too early")
        yield data


def kinds_of(iinf: Content) -> dict[int, bytes]:
    version, _ = iinf.version()
    iinf.number(2 if version == 0 else 4)  # how many; the boxes tell
    kinds = {}
    for _, entry in iinf.boxes():
        version, _ = entry.version()
        if version not in (2, 3):
            continue  # of MPEG-7 and the like
        number = entry.number(2 if version == 2 else 4)
        is_protected = entry.number(2)
        kinds[number] = b"protected" if is_protected else entry.take(4)
    return kinds


def references_of(iref: Content) -> dict[tuple[bytes, int], list[int]]:
    """The items to which an item refers, by kind of reference and item."""
    if not iref.data:
        return {}
    version, _ = iref.version()
    wide = 2 if version == 0 else 4
    found = {}
    for kind, content in iref.boxes():
        origin, count = content.number(wide), content.number(2)
        found[kind, origin] = [content.number(wide) for _ in range(count)]
    return found


def listed_properties(iprp: Content) -> dict[int, list[tuple[bytes, bytes]]]:
    """Kind and content of the properties of each item, in their order."""
    known, listed = [], {}
    parts = list(iprp.boxes())
    for kind, content in parts:
        if kind == b"ipco":
            known += [(one, bytes(inner.data)) for one, inner in content.boxes()]
    for kind, content in parts:
        if kind != b"ipma":
            continue
        version, flags = content.version()
        for _ in range(content.number(4)):
            number = content.number(2 if version == 0 else 4)
            places = [content.number(1 + (flags & 1)) for _ in range(content.number(1))]
            essential = 0x8000 if flags & 1 else 0x80
            for place in places:
                index = place & (essential - 1)
                if not index:
                    continue
                if index > len(known):
                    raise HeifError("it is damaged")
                listed.setdefault(number, []).append(
                    checked_property(*known[index - 1], bool(place & essential))
                )
    return listed


def checked_property(kind: bytes, content: bytes, is_essential: bool) -> tuple[bytes, bytes]:
    """The same; an empty kind for one of no meaning here, if the picture is right without it."""
    if kind in (b"ispe", b"hvcC", b"clap", b"irot", b"imir", b"colr", b"auxC"):
        return kind, content
    is_plain = not is_essential or kind in (b"pixi", b"pasp", b"av1C", b"lsel")
    return (b"" if is_plain else b"needed"), b""


def listed_places(iloc: Content) -> dict[int, tuple[int, list[tuple[int, int]]]]:
    """Of each item, how it is stored and the offset and length of its parts."""
    version, _ = iloc.version()
    both, others = iloc.number(1), iloc.number(1)
    wide = both >> 4, both & 15
    base_wide, index_wide = others >> 4, others & 15 if version else 0
    sizes = {*wide, base_wide, index_wide}
    if version > 2 or not sizes <= {0, 4, 8} or not wide[1]:  # parts of no bytes would have no end
        raise HeifError("it is damaged")
    found = {}
    for _ in range(iloc.number(2 if version < 2 else 4)):
        number = iloc.number(2 if version < 2 else 4)
        method = iloc.number(2) & 15 if version else 0
        if iloc.number(2):  # another file
            method = 15
        base, parts = iloc.number(base_wide), []
        for _ in range(iloc.number(2)):
            iloc.number(index_wide)
            offset, length = iloc.number(wide[0]), iloc.number(wide[1])
            parts.append((base + offset, length))
        found[number] = method, parts
    return found


def check_transparency(items: Items, shown: int) -> None:
    """HeifError if another item says how transparent the picture is."""
    for number in items.referring(b"auxl", shown):
        for kind, content in items.properties_of(number):
            if kind == b"auxC" and content[4:].startswith(ALPHA):
                raise HeifError("it has transparency", "store it as PNG")


def grid_of(items: Items, shown: int, stream):
    """The items of a grid row by row, its columns, and the size of the whole."""
    data = Content(items.read(stream, shown, 16), 0)
    _, flags, rows, columns = (data.number(1) for _ in range(4))
    wide = 4 if flags & 1 else 2
    size = data.number(wide), data.number(wide)
    tiles = items.references(b"dimg", shown)
    if not len(tiles) == len(set(tiles)) == (rows + 1) * (columns + 1):
        raise HeifError("it is damaged")
    return tiles, columns + 1, size


def tile_of(items: Items, tiles):
    """Size and configuration of tiles, which all have to have the same."""
    found = set()
    for number in tiles:
        kind, properties = items.kinds.get(number), items.properties_of(number)
        if kind != b"hvc1":
            name = (kind or b"").decode("latin-1")
            if name in KNOWN_KINDS:
                raise HeifError(f"its picture is of the kind {name}, and only HEVC is read")
            raise HeifError("it is damaged")
        by_kind = dict(reversed(properties))  # the first of each
        if not {b"ispe", b"hvcC"} <= set(by_kind):
            raise HeifError("it is damaged")
        if len(tiles) > 1 and {b"irot", b"imir", b"clap", b"needed"} & set(by_kind):
            raise HeifError("its tiles are turned one by one, which is not read")
        found.add((by_kind[b"ispe"], by_kind[b"hvcC"]))
    if len(found) != 1:
        raise HeifError("its tiles differ, which is not read")
    ((size, config),) = found
    size = Content(size, 0)
    size.version()
    return (size.number(4), size.number(4)), config


def check_cover(stored, tile, columns, count) -> None:
    """HeifError unless the picture reaches into the last column and row of tiles, not beyond."""
    for side, part, many in zip(stored, tile, (columns, count // columns), strict=True):
        if not (0 < side and (many - 1) * part < side <= many * part):
            raise HeifError("it is damaged")


def turned(size, properties):
    """The size as it is shown, and what is done to the picture; as Heif has them."""
    turns = []
    for kind, content in properties:
        content = Content(content, 0)
        if kind == b"needed":
            raise HeifError("it has to be changed in a way that is not known")
        if kind == b"clap":
            turns.append(("crop", *cropped(size, content)))
            _, left, top, right, bottom = turns[-1]
            size = right - left, bottom - top
        elif kind == b"irot":
            turns.append(("rotate", content.number(1) & 3))
            size = size[::-1] if turns[-1][1] % 2 else size
        elif kind == b"imir":
            turns.append(("mirror", content.number(1) & 1))
        if len(turns) > MOST_TURNS:
            raise HeifError("it is damaged")
    return size, tuple(turns)


def cropped(size, clap: Content):
    """left, top, right, bottom of a crop, which is given by its middle, in fractions."""
    from fractions import Fraction  # late: few files need it

    numbers = [clap.number(4) for _ in range(8)]
    for place in (4, 6):  # offsets may be negative
        numbers[place] -= 2**32 * (numbers[place] >> 31)
    if not all(numbers[1::2]):
        raise HeifError("it is damaged")
    wide, high, right, down = (Fraction(*numbers[i : i + 2]) for i in range(0, 8, 2))
    corners = []
    for side, kept, offset in zip(size, (round(wide), round(high)), (right, down), strict=True):
        first = floor(Fraction(side - kept, 2) + offset)
        if not (kept > 0 and 0 <= first and first + kept <= side):
            raise HeifError("it is damaged")
        corners.append((first, first + kept))
    (left, right), (top, bottom) = corners
    return left, top, right, bottom


def colors_of(properties):
    """Transfer function, matrix and range, if the file says them; None otherwise."""
    for kind, content in properties:
        if kind == b"colr" and content[:4] == b"nclx":
            content = Content(content[6:], 0)  # without primaries, as in other formats
            return content.number(2), content.number(2), content.number(1) >= 128
    return None


def exif_of(items: Items, shown: int, stream) -> bytes:
    """The EXIF data of the picture; empty if they are damaged, since they decide nothing."""
    for number in items.referring(b"cdsc", shown):
        if items.kinds.get(number) != b"Exif":
            continue
        try:
            data = Content(items.read(stream, number, MOST_EXIF), 0)
            data.take(data.number(4))  # before TIFF's header
        except HeifError:
            return b""
        return bytes(data.data)
    return b""
