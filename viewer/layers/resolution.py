"""How many pixels are rendered: as many as there is time for while things move, all at rest.

While things move, the factors are powers of √½ of the window's size, so that one step halves or
doubles the pixels, and with them about the time.  On a CPU, rays go through every n-th pixel
across and down, and what is between them is taken from the picture before (Upsampling).  Fewer rays
cost some decibels (docs/design/017), so before there are fewer they take longer steps and leave out
levels finer than a pixel, which costs less of the quality.  With few rays most of the time goes
into the pixels between them, so in the end the picture has half of the window's width and height.
After a change the time has to leave a
band around the target before the next one, or the picture would flicker between two.

At rest finer pictures are rendered in strips of rows, so that the window answers meanwhile, up
to the full resolution; and then images shifted by fractions of a pixel, of which the mean is shown.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...core.field import below_pixel
from ...core.render import RunningMean, shifted
from .upload import ImageTexture, SharedImage

FACTORS = tuple(0.5 ** (0.5 * step) for step in range(7))  # 1 .. 0.125
TOO_SLOW, LATE = 1.25, 1.05  # of the target: what leads to less at once, and if it goes on
FITS = 0.9  # of the target: what more may be expected to take
IN_A_ROW = 3  # frames that are late, or have time to spare
RENEWAL = 0.25  # of a mean, by one frame
FORGETTING = 0.9993  # of a rung's time, by each frame: a fifth in 300
SMALLEST_SHARE = 0.4  # of a frame that rendering gets, whatever else takes time
HALF = 2, 1  # a ray for every second pixel, on a CPU; then there are fewer
STRIDES = ((2, 2), (3, 2), (3, 3), (4, 3), (4, 4))
SMALL = 0.5  # of the window's width and height: pictures on the slowest machines, and their strides
SMALL_STRIDES = ((2, 2), (3, 2), (3, 3), (4, 3), (4, 4))
PIXEL_COST = 0.05  # of a pixel without a ray, relative to one with a ray: it is filled and uploaded
STRIP_SECONDS = 0.045  # rendering a strip
SMALLEST_STRIP = 4  # rows
SAMPLE_COUNT = 16  # images whose mean is shown in the end


@dataclass(frozen=True)
class Rung:
    """A quality setting for rendering while things move."""

    factor: float  # of the window's width and height
    step_factor: float = 1.0  # RenderOptions.step_factor
    spared_levels: int = 0  # so many levels may be left out, if they are finer than a pixel
    cost: float = 1.0  # about the time, relative to the whole image in full quality
    stride: tuple[int, int] | None = None  # of rays, if the pixels between them can be upsampled
    scale: float = 1.0  # then: the picture's width and height, relative to the window's

    def savings(self, edges, pixel: float) -> dict:
        """What it saves on besides pixels, as arguments of RenderOptions.

        Args: the model's `level_edges` [L], and the width of a pixel where the object is.
        """
        saved = {} if self.step_factor == 1.0 else {"step_factor": self.step_factor}
        spared = min(int(below_pixel(edges, pixel).sum()), self.spared_levels, len(edges) - 1)
        return {**saved, "level_count": len(edges) - spared} if spared else saved


# What the settings save and lose on two CPU cores, at 0.35 of 1200 × 800 of the bundled model:
# 0.86 of the time at 49 dB, 0.73 at 45 dB, 0.70 at 44 dB.  Two levels less would be 38 dB.
CHEAPER = ((1.4, 0, 0.86), (2.0, 0, 0.73), (2.0, 1, 0.70))


def _strided(stride, step_factor=1.0, spared_levels=0, share=1.0, scale=1.0):
    rays, pixels = scale**2 / (stride[0] * stride[1]), scale**2
    cost = share * rays + PIXEL_COST * pixels
    return Rung(rays**0.5, step_factor, spared_levels, cost, stride, scale)


LADDER = tuple(Rung(factor, cost=factor * factor) for factor in FACTORS)
CPU_LADDER = (
    Rung(1.0),
    _strided(HALF),
    _strided(STRIDES[0]),
    *(_strided(STRIDES[0], *saving) for saving in CHEAPER),
    *(_strided(stride, *CHEAPER[-1]) for stride in STRIDES[1:]),
    *(_strided(stride, *CHEAPER[-1], SMALL) for stride in SMALL_STRIDES),
)


@dataclass
class MovingResolution:
    """Chooses the rung from the measured times of the frames drawn while things move."""

    target_seconds: float
    ladder: tuple[Rung, ...] = LADDER
    step: int = 3
    _late: int = 0
    _early: int = 0
    _slow: bool = False  # the last frame was
    _seen: dict = field(default_factory=dict)  # mean seconds of the last frames, by step

    @property
    def rung(self) -> Rung:
        return self.ladder[self.step]

    def aim(self, target_fps: float, other_seconds: float) -> None:
        """Leave rendering what everything else leaves of a frame, at so many frames a second."""
        self.target_seconds = max(1.0 / target_fps - other_seconds, SMALLEST_SHARE / target_fps)

    def measured(self, seconds: float) -> None:
        """Take account of one frame that was rendered as the present rung says.

        The second one in a row that is too slow leads down, by as many rungs as are needed; three
        late ones in a row lead down by one, and three with time to spare lead up by one.
        """
        self._seen = {step: FORGETTING * taken for step, taken in self._seen.items()}
        before = self._seen.get(self.step, seconds)
        self._seen[self.step] = before + RENEWAL * (seconds - before)
        slow = seconds > TOO_SLOW * self.target_seconds
        if slow and self._slow:
            while seconds > TOO_SLOW * self.target_seconds and self.step < len(self.ladder) - 1:
                seconds *= self.ladder[self.step + 1].cost / self.rung.cost
                self._go(1)
        self._slow = slow
        is_late = seconds > LATE * self.target_seconds and self.step < len(self.ladder) - 1
        self._late = self._late + 1 if is_late else 0
        # The rung above takes longer in proportion to its cost, or less: a part of the time is the
        # same for all.  What it took when it was tried tells, less and less; one that was never
        # tried is worth a trial.
        most = seconds * self.ladder[self.step - 1].cost / self.rung.cost
        expected = min(max(self._seen.get(self.step - 1, 0.0), seconds), most)
        is_early = self.step > 0 and expected < FITS * self.target_seconds
        self._early = self._early + 1 if is_early else 0
        if self._late == IN_A_ROW:
            self._go(1)
        elif self._early == IN_A_ROW:
            self._go(-1)

    def _go(self, rungs: int) -> None:
        self.step += rungs
        self._late = self._early = 0


def finer(factor: float) -> float:
    """The factor to refine to: twice the pixels a side, or all of them if that is not far."""
    return 2.0 * factor if 2.0 * factor < 0.75 else 1.0


@dataclass
class Picture:
    """An image of the field, perhaps not all of its rows yet."""

    height: int
    factor: float = 1.0  # its size relative to the window's
    texture: ImageTexture | SharedImage | None = None  # that its rows are put into
    cheaper: dict = field(default_factory=dict)  # what it saves on, for RenderOptions
    images: list = field(default_factory=list)  # the renderer's, from top to bottom
    next_row: int = 0
    done: bool = False  # it has all rows
    seconds_per_row: float | None = None
    part: tuple[slice, slice] | None = None  # if upsampled: rows and columns with the object

    @cached_property
    def depth(self):
        """The depths of a whole picture, on the host.  [height, w]"""
        return np.concatenate([image.depth_array() for image in self.images])

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
        self.done = self.next_row >= self.height
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

        `render` is called with a Picture and a camera, and adds the strip that follows.
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
