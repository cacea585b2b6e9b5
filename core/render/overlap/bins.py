"""List the tets that the rays of an image may meet, nearest first, for tangled rays on CUDA.

The image is cut into *bins*, squares of pixels.  Each has a bit for each tet, set where the bounds
of the tet in the image and those of the bin's rays overlap.  The bits are in order of the tets'
least distance from the camera, so that a ray that takes them one after the other finds its pieces
nearly sorted, and may end at the first tet that is too far away.  No ray searches a tree, and the
rays of a warp take the same tets together.

Bounds are in the plane at distance 1 in front of the camera, or, if its rays are parallel, in the
plane through it.  They are taken from the rays themselves, so that lenses need no projection here.

Shapes: R rays, T tets, W = ceil(T / 64) words, B bins.
"""

import warp as wp

from ...base.recorded import Recorded
from ..rays.camera import DeviceCamera
from ..rays.pose import Geometry, Pose
from ..rounds.slots import BLOCK_SIZE, Buffers
from .search import is_tangled_tet

LEAST_EDGE = 8  # of a bin [pixels]
MOST_BYTES = 1 << 26  # of all bits
BITS = wp.constant(64)
# Places in the layout of Bins.
WIDTH = wp.constant(0)  # of the image [pixels]
HEIGHT = wp.constant(1)
EDGE = wp.constant(2)  # of a bin [pixels]
ACROSS = wp.constant(3)  # bins in a row of them
BIN_COUNT = wp.constant(4)
ALL_BITS = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
ROUNDING = wp.constant(1.0e-6)  # of the largest coordinate
CLOSE = wp.constant(1.0e-3)  # a tet this close to the camera may be anywhere in the image
NEAR_PLANE = wp.constant(1.0e-4)  # what is further away than CLOSE is behind it, if in the image
STEEP = wp.constant(3.0)  # a ray with a larger coordinate may meet every tet
EVERYWHERE = wp.constant(wp.vec4(-1.0e30, -1.0e30, 1.0e30, 1.0e30))
NOWHERE = wp.constant(wp.vec4(1.0e30, 1.0e30, -1.0e30, -1.0e30))

wp.set_module_options({"enable_backward": False, "max_unroll": 2, "block_dim": BLOCK_SIZE})


@wp.struct
class Bins:
    """The tets of each bin of an image."""

    layout: wp.array(dtype=int)  # [5] see above; in memory, so that recorded launches follow it
    tets: wp.array(dtype=int)  # [2 T] in order of `nears`; the second half is for the sort
    nears: wp.array(dtype=float)  # [2 T] the least t of any ray that meets the tet
    outlines: wp.array(dtype=wp.vec4)  # [T] bounds x, y, X, Y of each tet
    corners: wp.array(dtype=wp.vec2)  # [4 T] in the image
    margins: wp.array(dtype=float)  # [T] that corners may be off by; -1: some are behind the camera
    bounds: wp.array(dtype=wp.vec4)  # [B] likewise of the rays of each bin
    bits: wp.array(dtype=wp.uint64)  # [W B] of bin b is word w at w B + b
    solid: wp.array(dtype=wp.uint64)  # [W] tets that can hold density
    tangled: wp.array(dtype=wp.uint64)  # [W] tets that are inverted or nearly flat


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ffsll((long long)bits) - 1;
#else
    return bits ? __builtin_ctzll(bits) : -1;
#endif
""")
def lowest_bit(bits: wp.uint64) -> int: ...


@wp.func
def bin_of(bins: Bins, ray: int):
    """The bin of a ray."""
    width = bins.layout[WIDTH]
    edge = bins.layout[EDGE]
    return (ray / width / edge) * bins.layout[ACROSS] + (ray % width) / edge


@wp.func
def joined(bounds: wp.vec4, p: wp.vec2):
    return wp.vec4(
        wp.min(bounds[0], p[0]),
        wp.min(bounds[1], p[1]),
        wp.max(bounds[2], p[0]),
        wp.max(bounds[3], p[1]),
    )


@wp.func
def widened(bounds: wp.vec4, margin: float):
    return bounds + wp.vec4(-margin, -margin, margin, margin)


@wp.func
def in_camera(camera: DeviceCamera, d: wp.vec3):
    """A vector's components to the right, up, and forward."""
    pose = camera.camera_to_world
    return wp.vec3(
        d[0] * pose[0, 0] + d[1] * pose[1, 0] + d[2] * pose[2, 0],
        d[0] * pose[0, 1] + d[1] * pose[1, 1] + d[2] * pose[2, 1],
        -(d[0] * pose[0, 2] + d[1] * pose[1, 2] + d[2] * pose[2, 2]),
    )


@wp.func
def largest(point: wp.vec3):
    return wp.max(wp.max(wp.abs(point[0]), wp.abs(point[1])), wp.abs(point[2]))


@wp.kernel
def outlines_kernel(
    geometry: Geometry,
    tets: wp.array(dtype=wp.vec4i),  # [T]
    buffers: Buffers,
    bins: Bins,
):
    """The bounds of each tet in the image, and its least distance.

    They are too large rather than too small, by what float32 may be wrong.
    """
    i = wp.tid()
    camera = buffers.camera[0]
    pose = camera.camera_to_world
    position = wp.vec3(pose[0, 3], pose[1, 3], pose[2, 3])
    corners = tets[i]
    outline = NOWHERE
    low = wp.vec3(1.0e30, 1.0e30, 1.0e30)
    high = -low
    size = largest(position)
    least = float(1.0e30)  # depth of a point that counts
    whole = bool(True)  # all of it is in front of the near plane
    total = float(0.0)  # of all coordinates: wp.min and wp.max drop what is not a number
    near = float(1.0e30)
    j = int(0)
    while j < 4:
        p = geometry.vertices[corners[j]]
        size = wp.max(size, largest(p))
        total += p[0] + p[1] + p[2]
        low = wp.min(low, p)
        high = wp.max(high, p)
        a = in_camera(camera, p - position)
        near = wp.min(near, a[2])
        at = wp.vec2(a[0], a[1])
        if camera.parallel == 0:
            at /= a[2]
        bins.corners[4 * i + j] = at
        if camera.parallel != 0:
            outline = joined(outline, at)
        elif a[2] >= NEAR_PLANE:
            outline = joined(outline, at)
            least = wp.min(least, a[2])
            k = int(0)
            while k < 4:  # edges that go behind the near plane
                b = in_camera(camera, geometry.vertices[corners[k]] - position)
                if b[2] < NEAR_PLANE:
                    c = b + (NEAR_PLANE - b[2]) / (a[2] - b[2]) * (a - b)
                    outline = joined(outline, wp.vec2(c[0], c[1]) / NEAR_PLANE)
                    least = NEAR_PLANE
                k += 1
        else:
            whole = False
        j += 1
    error = ROUNDING * size
    margin = float(error)
    if camera.parallel == 0:
        margin = (1.0 + STEEP) * error / least
        near = wp.length(wp.max(wp.max(low - position, position - high), wp.vec3()))
    outline = widened(outline, margin)
    if not wp.isfinite(total) or (camera.parallel == 0 and not near > CLOSE + error):
        outline = EVERYWHERE
        whole = False
    bins.outlines[i] = outline
    bins.margins[i] = wp.where(whole, margin, -1.0)
    bins.nears[i] = near - error
    bins.tets[i] = i


@wp.kernel
def bounds_kernel(buffers: Buffers, bins: Bins):
    """The bounds of the rays of each bin."""
    i = wp.tid()
    if i >= bins.layout[BIN_COUNT]:
        return
    width = bins.layout[WIDTH]
    height = bins.layout[HEIGHT]
    camera = buffers.camera[0]
    pose = camera.camera_to_world
    position = wp.vec3(pose[0, 3], pose[1, 3], pose[2, 3])
    edge = bins.layout[EDGE]
    first_row = (i / bins.layout[ACROSS]) * edge
    first_column = (i % bins.layout[ACROSS]) * edge
    found = NOWHERE
    row = int(first_row)
    while row < wp.min(first_row + edge, height):
        column = int(first_column)
        while column < wp.min(first_column + edge, width):
            ray = row * width + column
            origin = buffers.rays.origins[ray]
            if camera.parallel != 0:
                a = in_camera(camera, origin - position)
                found = joined(found, wp.vec2(a[0], a[1]))
            else:
                a = in_camera(camera, buffers.rays.directions[ray])
                found = joined(found, wp.vec2(a[0], a[1]) / a[2])
                if not a[2] * STEEP > wp.max(wp.abs(a[0]), wp.abs(a[1])):
                    found = EVERYWHERE
            column += 1
        row += 1
    scale = float(STEEP)
    if camera.parallel != 0:
        low = wp.vec3(found[0], found[1], 0.0)
        high = wp.vec3(found[2], found[3], 0.0)
        scale = largest(position) + wp.max(largest(low), largest(high))
    bins.bounds[i] = widened(found, ROUNDING * scale)


@wp.func
def is_apart(bins: Bins, tet: int, low: wp.vec2, high: wp.vec2):
    """Whether a rectangle lies beyond an edge of a tet's outline, a triangle or quadrangle."""
    center = 0.5 * (low + high)
    half = 0.5 * (high - low) + wp.vec2(1.0, 1.0) * bins.margins[tet]
    apart = bool(False)
    edge = int(0)
    while edge < 6 and not apart:
        # Corners i and j of the edge, and the two others.
        i = wp.where(edge < 3, 0, wp.where(edge < 5, 1, 2))
        j = wp.where(edge < 3, edge + 1, wp.where(edge < 5, edge - 1, 3))
        k = wp.where(edge == 0, 2, wp.where(edge < 3, 1, 0))
        p = bins.corners[4 * tet + i]
        along = bins.corners[4 * tet + j] - p
        normal = wp.vec2(-along[1], along[0])
        a = wp.dot(normal, bins.corners[4 * tet + k] - p)
        b = wp.dot(normal, bins.corners[4 * tet + 6 - i - j - k] - p)
        side = wp.dot(normal, center - p)
        reach = wp.abs(normal[0]) * half[0] + wp.abs(normal[1]) * half[1]
        # Of an edge inside the outline, the other corners are on different sides.
        apart = wp.min(a, b) >= 0.0 and side + reach < 0.0
        apart = apart or (wp.max(a, b) <= 0.0 and side - reach > 0.0)
        edge += 1
    return apart


@wp.kernel
def bits_kernel(
    geometry: Geometry,
    tet_count: int,
    bins: Bins,
):
    """The bits of one bin and word; `bins.tets` are sorted."""
    i = wp.tid()
    bin_count = bins.layout[BIN_COUNT]
    word = i / bin_count
    if word >= bins.solid.shape[0]:
        return
    mine = bins.bounds[i % bin_count]
    is_first = i % bin_count == 0
    bits = wp.uint64(0)
    solid = wp.uint64(0)
    tangled = wp.uint64(0)
    j = int(0)
    while j < BITS and word * BITS + j < tet_count:
        tet = bins.tets[word * BITS + j]
        bit = wp.uint64(1) << wp.uint64(j)
        outline = bins.outlines[tet]
        apart = outline[2] < mine[0] or mine[2] < outline[0]
        apart = apart or outline[3] < mine[1] or mine[3] < outline[1]
        if not apart and bins.margins[tet] >= 0.0:
            apart = is_apart(bins, tet, wp.vec2(mine[0], mine[1]), wp.vec2(mine[2], mine[3]))
        if not apart:
            bits |= bit
        if is_first:
            if geometry.occupancy[tet] != wp.uint64(0) and geometry.shapes[2 * tet + 1][2] > 0.0:
                solid |= bit
            if is_tangled_tet(geometry, tet):
                tangled |= bit
        j += 1
    bins.bits[i] = bits
    if is_first:
        bins.solid[word] = solid
        bins.tangled[word] = tangled


class TetBins:
    """Makes the Bins of images, in `bins`."""

    def __init__(self, pose: Pose, buffers: Buffers, capacity: int):
        """`buffers` hold the rays, up to `capacity` of them."""
        self._pose, self._buffers = pose, buffers
        self._making, self._layout = Recorded(pose.device), None
        tet_count = len(pose.tets)
        self._words = -(-tet_count // int(BITS))
        # A quarter more than of a square image; longer ones may have larger bins.
        most = min(1.25 * capacity / LEAST_EDGE**2, MOST_BYTES / (8 * self._words))
        self._most = max(int(most), 1)
        self.bins = bins = Bins()
        with wp.ScopedDevice(pose.device):
            bins.layout = wp.empty(5, dtype=int)
            bins.tets = wp.empty(2 * tet_count, dtype=int)
            bins.nears = wp.empty(2 * tet_count, dtype=float)
            bins.outlines = wp.empty(tet_count, dtype=wp.vec4)
            bins.corners = wp.empty(4 * tet_count, dtype=wp.vec2)
            bins.margins = wp.empty(tet_count, dtype=float)
            bins.bounds = wp.empty(self._most, dtype=wp.vec4)
            bins.bits = wp.empty(self._most * self._words, dtype=wp.uint64)
            bins.solid = wp.empty(self._words, dtype=wp.uint64)
            bins.tangled = wp.empty(self._words, dtype=wp.uint64)

    def make(self, width: int, height: int) -> None:
        """Fill `bins` for an image whose rays and camera are in the buffers."""
        edge = LEAST_EDGE
        across, down = -(-width // edge), -(-height // edge)
        while across * down > self._most:
            edge *= 2
            across, down = -(-width // edge), -(-height // edge)
        layout = width, height, edge, across, across * down
        if self._layout != layout:
            self.bins.layout.assign(layout)
            self._layout = layout
        self._making(self._launch)

    def _launch(self):
        pose, bins, buffers, tet_count = self._pose, self.bins, self._buffers, len(self._pose.tets)
        where = {"device": pose.device, "block_dim": BLOCK_SIZE}
        wp.launch(outlines_kernel, tet_count, [pose.geometry, pose.tets, buffers, bins], **where)
        wp.utils.radix_sort_pairs(bins.nears, bins.tets, tet_count)
        wp.launch(bounds_kernel, self._most, [buffers, bins], **where)
        inputs = [pose.geometry, tet_count, bins]
        wp.launch(bits_kernel, self._most * self._words, inputs, **where)
