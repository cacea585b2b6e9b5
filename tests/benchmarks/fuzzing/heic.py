"""HEIC photographs: boxes that are cut and counted wrong, and coded bytes that are damaged."""

import numpy as np
from heif_files import MIRROR, ROTATE, heic
from PIL import Image

from deformrf.core.base.images import ImageError
from deformrf.wings.capture import photos

from .damage import Binary, with_bytes, with_structure

FOLDERS = {b"meta": 4, b"iinf": 6, b"iref": 4, b"iprp": 0, b"ipco": 0}  # bytes before boxes


def boxes(data, first=0, last=None):
    """Where the boxes begin, all in all."""
    last = len(data) if last is None else last
    while first + 8 <= last:
        size, name = int.from_bytes(data[first : first + 4], "big"), data[first + 4 : first + 8]
        if size < 8:
            return
        yield first
        if name in FOLDERS:
            yield from boxes(data, first + 8 + FOLDERS[name], min(first + size, last))
        first += size


def whole_of(pixels, side, turns):
    exif = Image.Exif()
    exif[0x0110], exif[0x0112] = "Phone", 6
    data = heic(pixels, side, turns, exif=exif.tobytes()[6:])
    places = tuple(boxes(data))
    end = data.index(b"mdat")
    counts = [(at, ">I") for at in places]
    counts += [(at, ">H") for at in range(24, end, 2)] + [(at, ">I") for at in range(24, end, 3)]
    return Binary(data, tuple(counts), places)


class HeicHeaders:
    """Sizes, turns and cameras of pictures and grids; nothing is decoded."""

    errors = (ImageError,)

    def __init__(self, folder):
        noise = np.random.default_rng(0).integers(0, 256, (96, 80, 3), np.uint8)
        turns = ((ROTATE, b"\1"), (MIRROR, b"\0"))
        self.wholes = [whole_of(noise, side, turns) for side in (None, 32, 64)]

    def original(self, folder):
        (folder / "a.heic").write_bytes(self.wholes[1].data)

    def mutate(self, rng, folder):
        whole, other = (self.wholes[rng.integers(len(self.wholes))] for _ in range(2))
        data, what = with_structure(rng, whole, other.data)
        if rng.random() < 0.3:
            data, what = with_bytes(rng, data), what + ", bytes"
        (folder / "a.heic").write_bytes(data)
        return what

    def read(self, folder):
        return photos.photo_of(folder / "a.heic")


class Heic(HeicHeaders):
    """The same with their pixels."""

    def read(self, folder):
        return photos.read_photo(super().read(folder), 64)
