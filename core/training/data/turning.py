"""Decide for a data set whether EXIF rotation is applied to its photographs.

COLMAP and instant-ngp find cameras for the pixels as they are stored, and ignore EXIF; other
programs rotate the images first.  If EXIF turns a photograph by 90° (orientation 5 to 8), width and
height show which was done: rotation is applied only if the camera file gives the size of the
rotated image.  The decision holds for all photographs of the data set, also for those whose size
does not show it.
"""

from collections.abc import Callable
from functools import cached_property

from ...base.images import ImageError, open_image, orientation, stored_size
from .posed_images import PosedImage, have_one_shape


class Turning:
    """What the photographs of one data set tell together; they are looked at when first needed.

    Attributes:
        guessed: Path and orientation of photographs that none tells about: they are taken as they
            are stored.

    Args:
        images: Called without arguments, returns the PosedImages of all splits.
    """

    def __init__(self, images: Callable):
        self._images = images
        self.guessed = {}

    @cached_property
    def votes(self) -> tuple[list, list]:
        """Paths of photographs whose stated size is that of the stored, of the turned image."""
        as_stored, as_turned = [], []
        for path, stated in {image.path: image.stated_size for image in self._images()}.items():
            if stated is None:
                continue
            try:
                with open_image(path) as file:
                    number, stored = orientation(file), stored_size(file)
            except ImageError:  # whoever needs this photograph says so
                continue
            is_stored = have_one_shape(stored, stated)
            is_turned = have_one_shape(stored[::-1], stated)
            if number >= 5 and is_stored != is_turned:
                (as_turned if is_turned else as_stored).append(path)
        return as_stored, as_turned

    def applies(self, image, number: int) -> bool:
        """Whether a photograph's camera is that of the image as EXIF turns it.

        Args:
            number: Its orientation, 2 to 8.

        Raises:
            ImageError: Photographs contradict each other, or nothing tells.
        """
        stored, turned = self.votes
        if stored and turned:
            raise ImageError(
                f"the data set's files state the size of {turned[0]} as its EXIF orientation turns "
                f"it, but that of {stored[0]} as it is stored ({len(turned)} and {len(stored)} "
                f"photographs): store all upright, or remove their orientations"
            )
        if stored or turned:
            return bool(turned)
        if image.stated_size is None:
            raise ImageError(
                f"{image.path} has EXIF orientation {number}, and the data set's files state no "
                f"size that tells whether its camera is that of the turned image: store it "
                f"upright, or remove the orientation"
            )
        self.guessed[image.path] = number
        return False

    def said(self) -> tuple[str, ...]:
        """A sentence about what was guessed."""
        if not self.guessed:
            return ()
        path, number = next(iter(self.guessed.items()))
        return (
            f"the EXIF orientations of {len(self.guessed)} photographs (first {path}, {number}) "
            f"are not applied, as in COLMAP: no image size in the camera file tells whether to "
            f"apply them",
        )


def is_turned(image: PosedImage, file) -> bool:
    """Whether the camera is that of the image as its EXIF orientation turns it.

    The data set says so, or the sizes that it states tell.

    Raises:
        ImageError: Nothing tells, or sizes contradict each other.
    """
    number = orientation(file)
    if number == 1 or image.upright:
        return number > 1
    turning = image.turning or Turning(lambda: [image])
    return turning.applies(image, number)
