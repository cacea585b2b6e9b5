"""Images in strips of rows, so that the window answers while they are rendered.

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
class Strips:
    """Cuts an image of `height` rows into strips that each take about `budget_seconds`."""

    height: int
    budget_seconds: float = STRIP_SECONDS
    next_row: int = 0
    seconds_per_row: float | None = None

    @property
    def done(self) -> bool:
        return self.next_row >= self.height

    def following(self) -> tuple[int, int]:
        """The next strip: its first row and the row after its last."""
        rows = SMALLEST_STRIP
        if self.seconds_per_row is not None:
            rows = max(rows, int(self.budget_seconds / max(self.seconds_per_row, 1e-9)))
        return self.next_row, min(self.next_row + rows, self.height)

    def rendered(self, rows: tuple[int, int], seconds: float) -> None:
        """Take account of a strip that is finished."""
        self.next_row = rows[1]
        self.seconds_per_row = seconds / (rows[1] - rows[0])


@dataclass
class Picture:
    """An image of the field in a texture, perhaps not all of its rows yet."""

    texture: ImageTexture | None
    factor: float  # its size relative to the window's
    strips: Strips
    cheaper: dict = field(default_factory=dict)  # what it saves on, for RenderOptions
    images: list = field(default_factory=list)  # the renderer's, from top to bottom


class Sampling:
    """The mean of a full image and shifted ones."""

    def __init__(self, picture: Picture, device):
        """Begin with a whole picture at the full resolution."""
        self.count = 1  # whole images in the mean
        self.color = None  # the mean, if it is of several images.  [H, W] vec4ub
        self._mean = RunningMean(*picture.texture.size, device)
        self._strips = picture.strips  # of the image that is being rendered, or the last one
        row = 0
        for image in picture.images:
            self._mean.add(image, row)
            row += image.color.shape[0]

    def step(self, camera, render_rows) -> bool:
        """Render a strip; whether an image is complete and `color` new.

        Args:
            render_rows: Called with Strips and a camera; renders the strip that follows, and
                returns its first row and its Image.
        """
        if self._strips.done:
            seconds_per_row = self._strips.seconds_per_row
            self._strips = Strips(camera.height, seconds_per_row=seconds_per_row)
        first_row, image = render_rows(self._strips, shifted(camera, self.count))
        self._mean.add(image, first_row)
        if not self._strips.done:
            return False
        self.count += 1
        self.color = self._mean.color(self.count)
        return True
