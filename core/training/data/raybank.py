"""All training pixels as rays on one device, drawn at random.

Rays are in model space; the similarity `world_to_model` maps the data's cameras to it.  One
kernel draws pixels, makes their rays and reads their colors.  Its seed is an array on the device,
so the host never waits.

Shapes: P pixels of N views, R rays.
"""

from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import warp as wp

from ...render import Camera, DeviceCamera, camera_ray, device_camera, in_space
from .datasets import Dataset, check_pixel_count

DRAW = wp.constant(1 << 30)  # so that a ray's pixel and its jitter have different random numbers
# What a bank's limits have for a pixel: a number of samples, or one of these.
EMPTY = wp.constant(0)  # transparent, and its ray met nothing occupied when it was last drawn
NO_LIMIT = wp.constant(255)
# Pixels are drawn by rejection sampling.
MOST_TRIES = wp.constant(10)  # pixels that are drawn for a ray, until one is taken
EMPTY_ACCEPTANCE = wp.constant(0.1)  # probability that an empty one is taken

wp.set_module_options({"enable_backward": False})


@wp.struct
class Bank:
    """The photographs, for kernels."""

    pixels: wp.array(dtype=wp.vec4ub)  # [P] straight alpha
    first_pixels: wp.array(dtype=int)  # [N + 1]
    cameras: wp.array(dtype=DeviceCamera)  # [N] in model space
    pool: wp.array(dtype=int)  # pixels to draw from; [0]: from all


@wp.struct
class Drawn:
    """Rays and the colors of their pixels; means over them divide by the sum of `tries`."""

    origins: wp.array(dtype=wp.vec3)  # [R] in model space
    directions: wp.array(dtype=wp.vec3)  # [R] unit
    rgba: wp.array(dtype=wp.vec4)  # [R] straight alpha, 0..1
    background: wp.array(dtype=wp.vec3)  # [R] a random color for each ray, 0..1
    views: wp.array(dtype=int)  # [R]
    pixels: wp.array(dtype=int)  # [R]
    limits: wp.array(dtype=int)  # [R] of its samples; NO_LIMIT: any number
    tries: wp.array(dtype=float)  # [R] pixels drawn until this one was taken, itself included
    first: int  # number of ray 0; a ray's random numbers depend on its number


def empty_drawn(count: int, device) -> Drawn:
    """Space for rays, which have no limits yet."""
    drawn = Drawn()
    drawn.origins = wp.empty(count, dtype=wp.vec3, device=device)
    drawn.directions = wp.empty(count, dtype=wp.vec3, device=device)
    drawn.rgba = wp.zeros(count, dtype=wp.vec4, device=device)
    drawn.background = wp.zeros(count, dtype=wp.vec3, device=device)
    drawn.views = wp.zeros(count, dtype=int, device=device)
    drawn.pixels = wp.zeros(count, dtype=int, device=device)
    drawn.limits = wp.full(count, int(NO_LIMIT), dtype=int, device=device)
    drawn.tries = wp.ones(count, dtype=float, device=device)
    return drawn


@wp.func
def view_of(first_pixels: wp.array(dtype=int), pixel: int):
    """The view that a pixel belongs to, by bisection."""
    low = int(0)
    high = int(first_pixels.shape[0] - 1)
    while high - low > 1:
        middle = (low + high) / 2
        if first_pixels[middle] <= pixel:
            low = middle
        else:
            high = middle
    return low


@wp.func
def ray_of(bank: Bank, pixel: int):
    """A pixel's view, and the origin and direction of its ray."""
    view = view_of(bank.first_pixels, pixel)
    camera = bank.cameras[view]
    place = pixel - bank.first_pixels[view]
    width = camera.lens.width
    origin, direction = camera_ray(camera, place % width, place / width)
    return view, origin, direction


@wp.kernel
def draw_kernel(
    bank: Bank,
    chosen: wp.array(dtype=int),  # [R] pixels, or None: random ones
    limits_of: wp.array(dtype=wp.uint8),  # [P], or None: none has a limit
    seed: wp.array(dtype=int),  # [1]
    drawn: Drawn,  # out
):
    i = wp.tid()
    random = wp.rand_init(seed[0], DRAW + drawn.first + i)
    pixel_count = bank.pixels.shape[0]
    if bank.pool.shape[0] > 0:
        pixel_count = bank.pool.shape[0]
    pixel = int(0)
    limit = int(NO_LIMIT)
    tried = int(0)
    if chosen.shape[0] > 0:
        pixel = chosen[i]
        tried = 1
    while tried == 0 or (limit == EMPTY and tried < MOST_TRIES):
        pixel = int(wp.randu(random) % wp.uint32(pixel_count))
        if bank.pool.shape[0] > 0:
            pixel = bank.pool[pixel]
        tried += 1
        limit = NO_LIMIT
        if limits_of.shape[0] > 0:
            limit = int(limits_of[pixel])
            if limit == EMPTY and wp.randf(random) < EMPTY_ACCEPTANCE:
                limit = NO_LIMIT
    drawn.pixels[i] = pixel
    drawn.limits[i] = wp.where(limit == EMPTY, NO_LIMIT, limit)
    drawn.tries[i] = float(tried)
    view, origin, direction = ray_of(bank, pixel)
    drawn.origins[i] = origin
    drawn.directions[i] = direction
    drawn.views[i] = view
    c = bank.pixels[pixel]
    drawn.background[i] = wp.vec3(wp.randf(random), wp.randf(random), wp.randf(random))
    drawn.rgba[i] = wp.vec4(float(c[0]), float(c[1]), float(c[2]), float(c[3])) / 255.0


@wp.kernel
def meets_kernel(bank: Bank, low: wp.vec3, high: wp.vec3, meets: wp.array(dtype=wp.uint8)):
    """Whether each pixel's ray meets a box."""
    pixel = wp.tid()
    _view, origin, direction = ray_of(bank, pixel)
    enter = float(0.0)
    leave = float(1.0e30)
    for axis in range(3):
        if wp.abs(direction[axis]) > 1.0e-9:
            a = (low[axis] - origin[axis]) / direction[axis]
            b = (high[axis] - origin[axis]) / direction[axis]
            enter = wp.max(enter, wp.min(a, b))
            leave = wp.min(leave, wp.max(a, b))
        elif origin[axis] < low[axis] or origin[axis] > high[axis]:
            leave = -1.0
    meets[pixel] = wp.uint8(wp.where(enter < leave, 1, 0))


class RayBank:
    """Draws pixels of a data set; DatasetError if these are more than an array can index."""

    def __init__(self, dataset: Dataset, world_to_model, device):
        check_pixel_count([(lens.width, lens.height) for lens in dataset.lenses])
        self.device = wp.get_device(device)
        poses = in_space(dataset.poses, world_to_model)
        cameras = [
            device_camera(Camera(pose, lens))
            for pose, lens in zip(poses, dataset.lenses, strict=True)
        ]
        self.bank = Bank()
        with wp.ScopedDevice(self.device):
            # On a CPU the kernels read the data set's own array: it may be most of the memory.
            self.bank.pixels = wp.array(dataset.pixels, dtype=wp.vec4ub, copy=False)
            self.bank.first_pixels = wp.array(dataset.first_pixels.astype(np.int32), dtype=int)
            self.bank.cameras = wp.array(cameras, dtype=DeviceCamera)
            self.bank.pool = wp.empty(0, dtype=int)

    def draw_from(self, box=None, shares=None, others=0.0, untold=None):
        """Draw only some pixels from now on; all, if none of these is left.

        Args:
            box: Those whose rays meet it.  [2, 3]
            shares: Of each view's pixels, that are drawn from; chosen at random.  [N]
            others: So many of the drawn ones, at most, are other rays than the box's; at random.
            untold: Pixels that are not drawn.  [P] bool
        """
        if box is None and shares is None and untold is None:
            return
        chosen = np.ones(self.pixel_count, bool)
        if box is not None:
            low, high = wp.vec3(*map(float, box[0])), wp.vec3(*map(float, box[1]))
            meets = wp.zeros(self.pixel_count, dtype=wp.uint8, device=self.device)
            inputs = [self.bank, low, high]
            wp.launch(meets_kernel, self.pixel_count, inputs, [meets], device=self.device)
            chosen = meets.numpy() > 0
        met = max(np.count_nonzero(chosen), 1)
        aside = others / (1.0 - others) * met / max(self.pixel_count - met, 1)
        rng, is_any = np.random.default_rng(0), False
        for view, (start, end) in enumerate(pairwise(self.bank.first_pixels.numpy())):
            meets = chosen[start:end]
            chances = np.where(meets, 1.0, aside) * (1.0 if shares is None else shares[view])
            drawn = rng.random(end - start) < chances
            if untold is not None:
                drawn &= ~untold[start:end]
            is_any |= bool((drawn & meets).any())
            meets[:] = drawn
        pixels = np.flatnonzero(chosen if is_any else []).astype(np.int32)
        self.bank.pool = wp.array(pixels, dtype=int, device=self.device)

    @contextmanager
    def holding_aside(self, views):
        """Context in which pixels of these views are not drawn at random.

        It gives those of them that are drawn otherwise.  [n] int32
        """
        before, first = self.bank.pool, self.bank.first_pixels.numpy()
        pixels = before.numpy() if len(before) else np.arange(self.pixel_count, dtype=np.int32)
        aside = np.zeros(self.pixel_count, bool)
        for view in views:
            aside[first[view] : first[view + 1]] = True
        is_held = aside[pixels]
        held = pixels[is_held]
        self.bank.pool = wp.array(pixels[~is_held], dtype=int, device=self.device)
        del pixels, aside, is_held
        try:
            yield held
        finally:
            wp.synchronize_device(self.device)  # batches that are marched ahead draw from it
            self.bank.pool = before

    @property
    def pixel_count(self) -> int:
        return len(self.bank.pixels)

    @property
    def drawn_pixel_count(self) -> int:
        """Of the pixels that are drawn from."""
        return len(self.bank.pool) or self.pixel_count

    def draw(self, seed, drawn: Drawn, chosen=None, limits=None):
        """Fill with random rays; the same seed (int [1] on the device) and limits draw the same.

        Args:
            chosen: Pixels to take instead, numbered view by view, row by row.  [R] int
            limits: How many samples each pixel's ray may have; of no effect on those that are
                chosen.  Those that are EMPTY are drawn less often.  None: any number.  [P] uint8
        """
        wp.launch(
            draw_kernel,
            dim=len(drawn.origins),
            inputs=[self.bank, chosen, limits, seed],
            outputs=[drawn],
            device=self.device,
        )
