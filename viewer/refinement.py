"""Pictures in strips of rows, so that the window answers while they are rendered.

At rest the full resolution comes strip by strip, and then images shifted by parts of a pixel,
of which the mean is shown.
"""

from dataclasses import dataclass, field

from ..core.render import RunningMean, shifted
from .upload import ImageTexture

STRIP_SECONDS = 0.045  # rendering a strip
SMALLEST_STRIP = 4  # rows
SAMPLE_COUNT = 16  # images whose mean is shown in the end


def finer(factor: float) -> float:
    """The factor to refine to: the full one, by way of another if it is far off."""
    return 4.0 * factor if 4.0 * factor < 0.6 else 1.0


def size_at(factor: float, width: int, height: int) -> tuple[int, int]:
    """The size in pixels at a factor, at least 8 × 8."""
    return max(8, round(width * factor)), max(8, round(height * factor))


@dataclass
class Picture:
    """An image of the field, perhaps not all of its rows yet."""

    height: int
    factor: float = 1.0  # its size relative to the window's
    texture: ImageTexture | None = None  # that its rows are put into
    cheaper: dict = field(default_factory=dict)  # what it saves on, for RenderOptions
    images: list = field(default_factory=list)  # the renderer's, from top to bottom
    next_row: int = 0
    seconds_per_row: float | None = None

    @property
    def done(self) -> bool:
        return self.next_row >= self.height

    def strip(self) -> tuple[int, int]:
        """The next rows that take about STRIP_SECONDS: the first, and the one after the last."""
        rows = SMALLEST_STRIP
        if self.seconds_per_row is not None:
            rows = max(rows, int(STRIP_SECONDS / max(self.seconds_per_row, 1e-9)))
        return self.next_row, min(self.next_row + rows, self.height)

    def add(self, image, seconds: float) -> None:
        """Take the rows that follow, an Image of core/render, and how long they took."""
        rows = image.color.shape[0]
        self.images.append(image)
        self.next_row += rows
        self.seconds_per_row = seconds / rows


class Sampling:
    """The mean of a full image and shifted ones."""

    def __init__(self, picture: Picture, device):
        """Begin with a whole picture at the full resolution."""
        self.count = 0  # whole images in the mean
        self.color = None  # the mean, if it is of several images.  [H, W] vec4ub
        self._mean = RunningMean(*picture.texture.size, device)
        self._picture = picture  # that is being rendered, or the last one
        self._add_images()

    def step(self, camera, render) -> bool:
        """Render a strip; whether an image is complete and `color` new.

        Args:
            render: Called with a Picture and a camera; renders the strip that follows.
        """
        if self._picture.done:
            seconds_per_row = self._picture.seconds_per_row
            self._picture = Picture(camera.height, seconds_per_row=seconds_per_row)
        render(self._picture, shifted(camera, self.count))
        if not self._picture.done:
            return False
        self._add_images()
        self.color = self._mean.color(self.count)
        return True

    def _add_images(self):
        row = 0
        for image in self._picture.images:
            self._mean.add(image, row)
            row += image.color.shape[0]
        self.count += 1
