"""What stands still behind an object that turns, learned where masks don't tell it from the object.

A camera that stood still saw the same background behind each pixel, and an object that turned
before it.  So let c be the color that the model renders for a pixel p of such a ring of views, and
o its opacity.  Where the mask is *untold* (data/masks.py), the loss compares the photograph with

    c + (1 − o) B(p),    B(p) = b(p) + SCALE θ(p)

B is the ring's *plate*, as films call a picture of the set without its actors, and b what views
show at p whose masks tell it as background, or else the mean of all.  Opacity where no mask tells
follows from what moves along with the object and what does not; a shadow that lies there in each
view belongs to the plate.

Shapes: R rays, N views, K places of plates, U pixels that have one.
"""

from zlib import crc32

import numpy as np
import torch

from ..data.datasets import Dataset
from ..data.masks import UNTOLD

SCALE = 0.1  # as in exposure.py
SIDE = 1024  # longer side of a plate at most [places]
HINT = 1e-3  # weight of a view that may show the object, against one that shows background


class LearnedPlates(torch.nn.Module):
    """The plates of all rings, where a mask is untold.

    Attributes:
        offsets: θ.  [K, 3]

    Args:
        pixels: Those that have a plate, in order.  [U] int
        places: The place of each of these.  [U] int
        colors: b.  [K, 3]
        device: torch's.
    """

    def __init__(self, pixels, places, colors, device):
        super().__init__()
        self.offsets = torch.nn.Parameter(torch.zeros(len(colors), 3, device=device))
        self._colors = torch.as_tensor(colors, dtype=torch.float32, device=device)
        self._pixels = torch.as_tensor(pixels, dtype=torch.int32, device=device)
        self._places = torch.as_tensor(places, dtype=torch.int32, device=device)

    def forward(self, pixels):
        """The colors behind pixels [R, 3], and 1 where these are untold, else 0 [R]."""
        rows = torch.searchsorted(self._pixels, pixels, out_int32=True)
        rows = rows.clamp(max=len(self._pixels) - 1)
        untold = self._pixels.index_select(0, rows) == pixels
        places = self._places.index_select(0, rows)
        return (self._colors + SCALE * self.offsets).index_select(0, places), untold.float()

    def reach(self) -> np.ndarray:
        """Pixels that have a plate, in order.  [U] int32"""
        return self._pixels.cpu().numpy()

    def fingerprint(self) -> int:
        """A number that is another one where pixels have other places."""
        return crc32(self._places.cpu().numpy(), crc32(self.reach()))


def learned_plates(dataset: Dataset, device) -> LearnedPlates | None:
    """Plates to be learned for a data set; None if no pixel needs one.  `device` is torch's."""
    untold = untold_pixels(dataset)
    if untold is None or dataset.rings is None:
        return None
    found, count = [], 0
    for ring in np.unique(dataset.rings[dataset.rings >= 0]):
        views = np.flatnonzero(dataset.rings == ring)
        if len({size_of(dataset, view) for view in views}) == 1:
            found.append(plate_of(dataset, views, untold, count))
            count += len(found[-1][-1])
    if not count:
        return None
    pixels, places, colors = map(np.concatenate, zip(*found, strict=True))
    order = np.argsort(pixels)
    return LearnedPlates(pixels[order], places[order], colors, device)


def plate_of(dataset: Dataset, views, untold, count: int):
    """The untold pixels of a ring [U], their places from `count` on [U], these colors [K, 3]."""
    width, height = size_of(dataset, views[0])
    step = -(-max(width, height) // SIDE)
    across = -(-width // step)
    cells = (np.arange(height)[:, None] // step * across + np.arange(width) // step).ravel()
    total, weight, needed = np.zeros((cells[-1] + 1, 3)), *np.zeros((2, cells[-1] + 1))
    spans = [slice(*dataset.first_pixels[view : view + 2]) for view in views]
    for span in spans:
        rgba = dataset.pixels[span]
        shares = np.where(rgba[:, 3] == 0, 1.0, np.where(untold[span], HINT, 0.0))
        for channel in range(3):
            total[:, channel] += np.bincount(cells, shares * rgba[:, channel], len(total))
        weight += np.bincount(cells, shares, len(total))
        needed += np.bincount(cells, untold[span], len(total))
    used = np.flatnonzero(needed)
    numbers = np.full(len(total), -1, np.int32)
    numbers[used] = count + np.arange(len(used))
    pixels = [span.start + np.flatnonzero(untold[span]) for span in spans]
    places = [numbers[cells[untold[span]]] for span in spans]
    return np.concatenate(pixels), np.concatenate(places), total[used] / weight[used, None] / 255.0


def size_of(dataset: Dataset, view: int):
    lens = dataset.lenses[view]
    return lens.width, lens.height


def untold_pixels(dataset: Dataset):
    """Pixels of which their masks don't tell whether they show the object; None if there are none.

    [P] bool
    """
    if not dataset.masked:
        return None
    untold = dataset.pixels[:, 3] == UNTOLD
    return untold if untold.any() else None
