"""What is the object, where the camera stood still while it turned, or where there are masks.

Mapping follows what most features show.  Before a still background, that is the background, and all
cameras of a ring come out at one place.  So the features of what stands still are dropped, and the
cameras are those of a camera that walks around the object.
"""

from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from PIL import Image

from ...core.training import read_mask, shrunk_size
from .carving import LOOSE, View, agreeing, carve, levels, voted, votes
from .features import object_mask
from .mapping import Mapped
from .mattes import BACKGROUND, MATTE_SIDE, UNKNOWN, mattes_of
from .photos import read_photo
from .still import find_rings
from .work import Work

HALF = 0.5  # of the photographs have to be in rings
TURNS = 0.002  # of a photograph's pixels are the object's, in the median of a ring


@dataclass(frozen=True)
class FoundMasks:
    """Masks that were made, and the object's box.

    Attributes:
        masks: By the photograph's number: how much of each pixel is the object's.  [h, w] uint8
        box: In the world of the cameras.  [2, 3]
        made: Whether they are by the user's program, mended; else by rings or the user's masks.
        overruled: Photographs, by number, of whose matte only the others' votes are left.
    """

    masks: dict
    box: np.ndarray
    made: bool = False
    overruled: tuple[int, ...] = ()


def find_turning(work: Work, begin) -> list[tuple[int, ...]]:
    """Rings of photographs in which the object turns; none if the camera did not stand still.

    Their mattes are in the work folder, unless the user has given masks.

    Args:
        begin: Phases.phase.
    """
    rings = find_rings(work, begin)
    if sum(map(len, rings)) < HALF * len(work.photos):
        return []
    if not work.masks:
        keep_mattes(work, rings, begin)
    shown = [
        np.median([(object_mask(work, n, size_of(work, n)) > 0).mean() for n in ring])
        for ring in rings
    ]
    turn = [ring for ring, share in zip(rings, shown, strict=True) if share >= TURNS]
    for number in {n for ring in rings for n in ring} - {n for ring in turn for n in ring}:
        work.matte_path(number).unlink(missing_ok=True)  # it shows nothing
    return turn


def size_of(work: Work, number: int):
    """Width and height of a photograph's matte."""
    return shrunk_size(work.photos[number].size, min(MATTE_SIDE, work.image_size))


def keep_mattes(work: Work, rings, begin):
    """Write the mattes of all photographs of rings that have none yet."""
    total = sum(map(len, rings))
    with begin("Finding what turns", total) as advance:
        before = 0
        for ring in rings:
            if any(work.matte(number) is None for number in ring):
                size = size_of(work, ring[0])

                def read(number, size=size):
                    image = read_photo(work.photos[number], max(size))
                    return image if image.shape[1::-1] == size else resized(image, size)

                def tell(done, before=before):
                    advance(before + done)

                for number, matte in mattes_of(read, ring, tell):
                    work.keep_matte(number, matte)
            before += len(ring)
            advance(before)


def resized(image, size):
    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))


def find_masks(work: Work, mapped: Mapped, begin) -> FoundMasks | None:
    """The masks of all photographs by the votes of all, in the world of `mapped`; None without any.

    Of masks that the user has given only the box is used.  Where what a program takes for the
    object is not one thing in space, mattes of rings serve.
    """
    found = voted_masks(work, mapped, begin)
    if found is None and work.program:
        found = voted_masks(replace(work, program=""), mapped, begin)
    return found


def voted_masks(work: Work, mapped: Mapped, begin) -> FoundMasks | None:
    """As `find_masks`, by one kind of mattes alone."""
    views = [view_of(work, mapped, row) for row in range(len(mapped.numbers))]
    has_vote = np.array([view.matte is not None for view in views])
    points = mapped.points.points
    if work.has_masks:  # all that the photographs show may have been followed
        points = points[votes(compress(views, has_vote), points, LOOSE)[0]]
    with begin("Voting on masks", levels() + len(views)) as advance:
        if work.program:
            has_vote = agreeing(views, points)
            views = [v if has else unknown(v) for v, has in zip(views, has_vote, strict=True)]
        voting = list(compress(views, has_vote))
        hull = carve(voting, points, advance) if voting else None
        if hull is None:
            return None
        masks = {}
        for row, view in enumerate(views) if not work.masks else ():
            masks[int(mapped.numbers[row])] = voted(view, hull)
            advance(levels() + row + 1)
    overruled = mapped.numbers[~has_vote].tolist() if work.program else ()
    return FoundMasks(masks, hull.box, bool(work.program), tuple(overruled))


def view_of(work: Work, mapped: Mapped, row: int) -> View:
    """A photograph that has a camera, with its matte, or with the user's mask as such."""
    number = int(mapped.numbers[row])
    matte = work.matte(number, made=bool(work.program))
    size = size_of(work, number) if matte is None else matte.shape[::-1]
    lens = mapped.lenses[row].copy()
    scale = np.array(size) / lens[5:]
    lens[[0, 1]] *= scale
    lens[[2, 3]] *= scale
    lens[5:] = size
    if work.masks:
        mask = read_mask(work.masks[number], *size, work.photos[number].is_turned)
        matte = np.where(mask > 127, np.uint8(255), np.uint8(BACKGROUND))
    return View(mapped.poses[row], lens, matte)


def unknown(view: View) -> View:
    return replace(view, matte=np.full_like(view.matte, UNKNOWN))


def said_of(rings) -> str:
    """What was found, as a sentence for the user."""
    count = sum(map(len, rings))
    where = "one ring" if len(rings) == 1 else f"{len(rings)} rings"
    return f"The camera stood still: {count} photographs of a turntable in {where}"
