"""Temporal upsampling, second half: a coarse picture and the image before become the image.

A coarse picture has some of the image's pixels (temporal.py).  At the places where its surfaces
were, it is compared with the image before; then each cell between four coarse pixels is filled.
A pixel's color is that of before, corrected by the mean of its neighbors' differences: light that
changes is followed, and what is wrong doesn't stay.  Where the differences are large, or a neighbor
was not seen, less of what lies between the neighbors is taken from before: a side that comes into
view, or an edge that is cut up, would be noise.

Of the four neighbors those in front form a layer, the others another.  A layer's motion says where
to look; if at least half of what is there is as far away as that layer was, the pixel is taken from
there, else the layer behind is tried, and in the end the coarse picture alone.  Where nothing has
moved, pixels stay what they were.

Only the part of the image with the object is worked on; the rest is background.

Shapes: [h, w] of a coarse picture, [H, W] of the image.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp

from ..base.native import native_source
from ..base.threads import shares_of, side_by_side
from .cpu_tiles import take
from .rays.camera import Camera
from .render import Image
from .temporal import PastView, Surfaces, phases, place_before, strided, surfaces

ROOM = 2  # coarse pixels around the object: its soft edges, and neighbors that are read
STEEPEST = 6.0  # a surface's rise in depth, in pixels per pixel, that is no edge
DOUBTFUL = 1.0 / 100.0  # doubt for a difference of a byte's unit: at 1 half of the detail is left
UNSEEN = 0.7  # doubt where the image before does not show the surface of a coarse pixel
ALIKE = 0.5  # pixels; layers whose motions differ by less move alike
LEAST_PIXELS = 1 << 15  # of the image, of a thread: some .7 ms
IMAGE_ROWS = 16  # that a thread fills before it takes others

VALUES = {"STEEPEST": STEEPEST, "ALIKE": ALIKE, "DOUBTFUL": DOUBTFUL, "UNSEEN": UNSEEN}

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


def _native(section):
    return native_source(Path(__file__).with_suffix(".cpp"), [], VALUES, section)


@wp.struct
class SeenImage:
    """An image for kernels."""

    color: wp.array2d(dtype=wp.vec4ub)  # alpha = opacity
    depth: wp.array2d(dtype=float)  # distance along the ray, inf where the opacity is below ½
    texel: float  # a pixel's width at distance 1, or of parallel rays anywhere
    parallel: int
    background: wp.vec3  # color where nothing is, 0..255


@wp.struct
class CoarseRays:
    """Which pixels of the image a coarse picture has; x and y."""

    stride: wp.vec2i
    phase: wp.vec2i
    size: wp.vec2i  # w, h


@wp.func_native(_native("differences"))
def compare_row(
    coarse: wp.array2d(dtype=wp.vec4ub),
    places: wp.array2d(dtype=wp.vec4),
    corner: wp.vec2i,
    before: SeenImage,
    row_of_part: int,
    differences: wp.array2d(dtype=wp.vec4),
): ...


@wp.func_native(_native("cells"))
def fill_cells(
    coarse: wp.array2d(dtype=wp.vec4ub),
    places: wp.array2d(dtype=wp.vec4),
    differences: wp.array2d(dtype=wp.vec4),
    rays: CoarseRays,
    corner: wp.vec2i,
    cell_row: int,
    first_cell: int,
    end_cell: int,
    moved: int,
    before: SeenImage,
    image: SeenImage,
): ...


@wp.kernel
def upsample_kernel(
    shown: Surfaces,  # of the coarse picture
    rays: CoarseRays,
    corner: wp.vec2i,  # column and row of the first pixel of the picture's part
    rows: wp.vec2i,  # of coarse pixels, the first one and the last one + 1; -1: above all of them
    columns: wp.vec2i,  # the same
    rows_at_once: int,
    next: wp.array(dtype=int),  # [1] of all threads: the next rows
    moved: int,  # whether anything has, since the image before
    before: SeenImage,
    places: wp.array2d(dtype=wp.vec4),  # room for the part
    differences: wp.array2d(dtype=wp.vec4),  # room: how much coarse pixels differ; inf if unknown
    image: SeenImage,  # out
):
    """The image's pixels from each coarse pixel on, up to the next ones, until all are taken."""
    first = rows[0] + rows_at_once * take(next)
    while first < rows[1]:
        end = wp.min(first + rows_at_once, rows[1])
        row = wp.max(first - corner[1], 0)  # of the part; all that these rows need
        while row < wp.min(end + 1 - corner[1], places.shape[0]):
            column = int(0)
            while column < places.shape[1]:
                places[row, column] = place_before(shown, corner[1] + row, corner[0] + column)
                column += 1
            compare_row(shown.color, places, corner, before, row, differences)
            row += 1
        row = int(first)
        while row < end:
            fill_cells(
                shown.color,
                places,
                differences,
                rays,
                corner,
                row,
                columns[0],
                columns[1],
                moved,
                before,
                image,
            )
            row += 1
        first = rows[0] + rows_at_once * take(next)


@dataclass(frozen=True)
class CoarsePicture:
    """A picture with a ray for every n-th pixel of an image."""

    shown: Surfaces  # [h, w]
    box: tuple[int, int, int, int]  # `object_box` of its colors
    stride: tuple[int, int]  # n, across and down
    phase: tuple[int, int]  # the image's pixel of the first ray: column, row
    moved: bool = True  # whether anything has moved since the image before


def object_box(colors) -> tuple[int, int, int, int] | None:
    """The part of a picture that is more than background, with ROOM around it.

    First and last + 1 rows, then columns; None if all is background.

    Args:
        colors: [h, w, 4] uint8
    """
    opaque = colors[..., 3] > 0
    box = []
    for axis in (1, 0):
        found = np.flatnonzero(opaque.any(axis=axis))
        if not len(found):
            return None
        count = opaque.shape[1 - axis]
        box += [max(int(found[0]) - ROOM, 0), min(int(found[-1]) + 1 + ROOM, count)]
    return tuple(box)


def add_coarse(picture, camera: Camera, background, view: PastView, before: Image, image: Image):
    """Fill the part of an image that a coarse picture's object is in.

    Args:
        camera: Of the whole image.
        view, before: What the image before was rendered of, and that image; it may have another
            size.
        image: Background alone.

    Returns:
        That part, two slices: rows and columns.
    """
    first, last, left, right = picture.box
    old = _for_kernels(before, view.camera, background)
    new = _for_kernels(image, camera, background)
    (height, width), rays = picture.shown.depth.shape, CoarseRays()
    rays.stride, rays.phase = wp.vec2i(*picture.stride), wp.vec2i(*picture.phase)
    rays.size, corner = wp.vec2i(width, height), wp.vec2i(left, first)
    room = [wp.empty((last - first, right - left), dtype=wp.vec4, device="cpu") for _ in range(2)]
    rows, columns = _cells(first, last, height), _cells(left, right, width)

    inputs = [picture.shown, rays, corner, wp.vec2i(*rows), wp.vec2i(*columns)]
    inputs += [max(IMAGE_ROWS // picture.stride[1], 1), wp.zeros(1, dtype=int, device="cpu")]
    inputs += [int(picture.moved), old, *room]
    cells = (rows[1] - rows[0]) * (columns[1] - columns[0])
    pixels = cells * picture.stride[0] * picture.stride[1]
    threads = len(shares_of(pixels, LEAST_PIXELS))

    def fill():
        wp.launch(upsample_kernel, 1, inputs, [new], device="cpu")

    side_by_side([fill] * threads)
    part = []
    for axis, (low, high) in enumerate((rows, columns)):
        n, start, size = picture.stride[1 - axis], picture.phase[1 - axis], image.depth.shape[axis]
        part.append(slice(max(start + n * low, 0), min(max(start + n * high, 0), size)))
    return tuple(part)


def _cells(first, last, count):
    """Which coarse pixels of a row or column have others of the box on both sides.

    First and last + 1; at the ends of the picture there need not be any beyond.
    """
    return first - (first == 0), last - (last < count)


def _for_kernels(image, camera, background):
    value = SeenImage()
    value.color, value.depth = image.color, image.depth
    value.texel, value.parallel = 1.0 / camera.focal, int(camera.parallel)
    value.background = wp.vec3(*np.round(255.0 * np.array(background)))
    return value


class Upsampling:
    """Renders coarse pictures, each through other pixels, and the images that they become."""

    def __init__(self):
        self._stride = 1, 1  # of the last picture's rays
        self._count = 0  # of pictures since one had nothing before it
        self._since_change = 0  # of those, since camera or vertices changed
        self._spare: _Target | None = None  # memory of the image before the last one
        self._last: _Target | None = None

    @property
    def whole(self) -> bool:
        """Whether each pixel has had a ray of its own since the last change."""
        return self._since_change >= len(phases(self._stride))

    def changed(self) -> None:
        """Camera or vertices have changed."""
        self._since_change = 0

    def render(self, renderer, camera: Camera, stride, options, view: PastView | None) -> Image:
        """The next coarse picture of a camera.

        Args:
            stride: Pixels between rays, across and down.
            options: RenderOptions with details.
            view: Of the image before, or None if nothing is taken from it.
        """
        self._count = 0 if view is None else self._count
        self._stride, self._phase = stride, phases(stride)[self._count % len(phases(stride))]
        return renderer.render(strided(camera, stride, self._phase), options)

    def upsampled(self, coarse: Image, renderer, camera, background, view, before):
        """The image that the coarse picture of `render` becomes; the next but one overwrites it.

        Args:
            background: Color where nothing is, 0..1.
            view, before: The PastView of the image before and that Image, or None.

        Returns:
            An Image, and its part with the object: two slices, rows and columns.
        """
        target = self._target((camera.height, camera.width), background)
        target.filled = slice(0, 0), slice(0, 0)
        box = object_box(coarse.color_array())
        if box is not None:
            if view is None:
                view = PastView(camera, renderer.pose.vertices)
                before = _Target(target.image.depth.shape, background).image
            rays = strided(camera, self._stride, self._phase)
            shown = surfaces(coarse, rays, renderer, view)
            moved = self._since_change == 0 or before.depth.shape != target.image.depth.shape
            picture = CoarsePicture(shown, box, self._stride, self._phase, moved)
            target.filled = add_coarse(picture, camera, background, view, before, target.image)
        self._spare, self._last = self._last, target
        self._count, self._since_change = self._count + 1, self._since_change + 1
        target.image.sample_count = coarse.sample_count
        return target.image, target.filled

    def _target(self, shape, background):
        """Memory for the next image, of background alone."""
        target, self._spare = self._spare, None
        if target is None or target.image.depth.shape != shape or target.background != background:
            return _Target(shape, background)
        target.clear()
        return target


class _Target:
    """An image of background, and the part of it that has been filled."""

    def __init__(self, shape, background):
        self.background = background
        self._pixel = np.array([*np.round(255.0 * np.array(background)), 0], np.uint8)
        color = wp.empty(shape, dtype=wp.vec4ub, device="cpu")
        self.image = Image(color, wp.empty(shape, dtype=float, device="cpu"), 0)
        self.filled = slice(None), slice(None)
        self.clear()

    def clear(self):
        words = self.image.color.numpy().view(np.uint32)[..., 0]  # NumPy fills these faster
        words[self.filled] = self._pixel.view(np.uint32)
        self.image.depth.numpy()[self.filled] = np.inf
