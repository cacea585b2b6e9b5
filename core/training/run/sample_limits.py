"""Limit the samples of each training ray to those before it becomes opaque.

Most samples lie behind something opaque, and most pixels' rays pass the object by.  Their gradients
are not worth the time.  So each pixel remembers how many samples its ray needed when it was last
drawn, and its next ray ends a few samples later (early ray termination, Levoy 1990).  If a
transparent pixel's ray had no sample, the pixel is mostly skipped.  A ray that needs 255 samples or
more has no limit.

Matter moves while a field is trained.  If a ray reaches its limit and is not opaque, the step
ignores it, because it would train the field to be empty behind the limit, and its pixel loses the
limit.

Shapes: R rays, P pixels.
"""

import warp as wp

from ..data.raybank import EMPTY, NO_LIMIT, Drawn
from .batch import Batch

OPAQUE_TRANSMITTANCE = wp.constant(5.0e-3)  # that a ray lets through at most that is opaque
SPARE_SHARE, SPARE = wp.constant(0.25), wp.constant(4.0)  # samples beside the visible ones
NOTHING = wp.constant(-1)  # was learned about the pixel of a ray

wp.set_module_options({"enable_backward": False})


@wp.kernel
def judge_kernel(
    drawn: Drawn,
    counts: wp.array(dtype=int),  # [R]
    opacity: wp.array(dtype=float),  # [R]
    visible: wp.array(dtype=int),  # [R]
    skips_empty: bool,
    fits: wp.array(dtype=float),  # [R] in, out: 0 for rays that used their limit up too early
    learned: wp.array(dtype=int),  # [R] out: limits, or NOTHING
):
    i = wp.tid()
    learned[i] = NOTHING
    if fits[i] > 0.0:
        limit = int(NO_LIMIT)
        if counts[i] == 0:
            # A pixel that shows something has an error, so it is not passed over.
            if skips_empty and drawn.rgba[i][3] == 0.0:
                limit = int(EMPTY)
        elif 1.0 - opacity[i] <= OPAQUE_TRANSMITTANCE:
            needed = (1.0 + SPARE_SHARE) * float(visible[i]) + SPARE
            limit = int(wp.min(needed, float(NO_LIMIT)))
        elif drawn.limits[i] < NO_LIMIT and counts[i] >= drawn.limits[i]:
            fits[i] = 0.0
        learned[i] = limit


@wp.kernel
def keep_kernel(
    pixels: wp.array(dtype=int),  # [R]
    learned: wp.array(dtype=int),  # [R]
    of_pixels: wp.array(dtype=wp.uint8),  # [P] out
):
    i = wp.tid()
    if learned[i] != NOTHING:
        of_pixels[pixels[i]] = wp.uint8(learned[i])


class SampleLimits:
    """How many samples the rays of a bank's pixels may have, learned while they are drawn.

    Attributes:
        of_pixels: A number of samples, or EMPTY or NO_LIMIT of data/raybank.py.  [P] uint8

    Args:
        skips_empty: Whether transparent pixels whose rays meet no matter are drawn less often.
    """

    def __init__(self, pixel_count: int, skips_empty: bool, device):
        self.of_pixels = wp.full(pixel_count, int(NO_LIMIT), dtype=wp.uint8, device=device)
        self._skips_empty = skips_empty

    def forget(self):
        """Begin anew: the field has other weights."""
        self.of_pixels.fill_(int(NO_LIMIT))

    def load(self, of_pixels):
        """Take the limits of an interrupted run; None: that run had none.

        Raises:
            ValueError: They are not those of so many pixels.
        """
        if of_pixels is None:
            return
        mine = wp.to_torch(self.of_pixels)
        if of_pixels.shape != mine.shape or of_pixels.dtype != mine.dtype:
            raise ValueError(f"limits of shape {tuple(of_pixels.shape)} for {len(mine)} pixels")
        mine.copy_(of_pixels)

    def judge(self, batch: Batch, opacity, visible):
        """Leave rays of a rendered batch out that used their limits up too early: their `fits`.

        What it teaches waits in `batch.learned` until `keep`.

        Args:
            opacity, visible: See training_field.RenderedRays.  torch [R]
        """
        wp.launch(
            judge_kernel,
            dim=batch.ray_count,
            inputs=[
                batch.drawn,
                batch.counts,
                wp.from_torch(opacity.detach()),
                wp.from_torch(visible),
                self._skips_empty,
            ],
            outputs=[wp.from_torch(batch.fits), batch.learned],
            device=batch.device,
        )

    def keep(self, batch: Batch):
        """Take what a judged batch taught, at the end of its step.

        A step that is interrupted is repeated.
        """
        wp.launch(
            keep_kernel,
            dim=batch.ray_count,
            inputs=[batch.drawn.pixels, batch.learned],
            outputs=[self.of_pixels],
            device=batch.device,
        )
