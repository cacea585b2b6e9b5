"""Sub-pixel samples at rest: shifted images in strips, and the mean of the whole ones."""

from ..core.render import RunningMean, shifted
from .resolution import STRIP_SECONDS, Strips

SAMPLE_COUNT = 16  # images whose mean is shown in the end


class Sampling:
    """The mean of a full image and shifted ones.

    Attributes:
        count: Whole images in the mean.
        color: The mean, None while it is the first image itself.  [H, W] vec4ub
    """

    def __init__(self, images, camera, device, row_seconds: float | None):
        """Take the first image, in strips from top to bottom, and how long a row took."""
        self.count = 1
        self.color = None
        self._mean = RunningMean(camera.width, camera.height, device)
        self._row_seconds = row_seconds
        self._strips = None  # of the next image, None between two
        row = 0
        for image in images:
            self._mean.add(image, row)
            row += image.color.shape[0]

    def step(self, camera, render_strip) -> bool:
        """Render a strip; whether an image is complete and `color` new.

        Args:
            render_strip: Called with Strips and a camera; returns the first row of the next
                strip and its Image.
        """
        if self._strips is None:
            self._strips = Strips(camera.height, STRIP_SECONDS, 0, self._row_seconds)
        first_row, image = render_strip(self._strips, shifted(camera, self.count))
        self._mean.add(image, first_row)
        if not self._strips.done:
            return False
        self._row_seconds, self._strips = self._strips.seconds_per_row, None
        self.count += 1
        self.color = self._mean.color(self.count)
        return True
