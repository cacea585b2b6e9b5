"""Tangled rays on CUDA: windows from front to back, in rounds that do not wait for the host.

The buffers of the wavefront (rounds/wavefront.py) hold all rays of an image.  The plain ones are
listed and rendered first, without the tangled ones, which may walk in circles; then these are
listed.  In a round each of them has one window of t, with so many pieces of all tets as it has
slots, and `composite_windows_kernel` merges what overlaps: line 4 of the definition, between each
two neighboring ends of pieces.  A ray is done when it gets dark or leaves the mesh's box.  Where
even the shortest window has too many pieces for the most slots, the ray is *crowded*: merging.py
renders it.

windows.py does the same on a CPU, a thread's rays at a time.

Shapes: R rays, V vertices, T tets, S slots.
"""

import warp as wp

from ..rays import Geometry, Pose
from ..rounds import (
    BLOCK_SIZE,
    CROWDED,
    LISTED,
    PARITY,
    PER_RAY,
    SAMPLES,
    STRIDE,
    STUCK,
    TAKEN,
    Buffers,
    Wavefront,
    Way,
    add_up,
    claim,
    finish_ray,
    list_ray,
    pixel_of,
    pixel_threads,
)
from .pieces import first_pieces, interval_in_box
from .search import TangledTets, is_tangled

LEAST_SLOTS, MOST_SLOTS = wp.constant(4), wp.constant(32)  # per ray and round
GROWTH = wp.constant(2.0)  # the next window is looked for within that many lengths of this one
LEAST_STEPS = wp.constant(5.0)  # and within that many Δ
SHORTEST = wp.constant(1.0e-6)  # of t, or of the unit of space if that is more
DARK = wp.constant(1.0e-9)  # a smaller extinction is none
CROWDED_RAY = wp.constant(-1.0)  # instead of a length
PLAIN_RAY = wp.constant(-2.0)
OUTSIDE = wp.constant(-2)  # as a ray's tet: it has left the mesh for good
FAR = wp.constant(1.0e30)

wp.set_module_options({"enable_backward": False, "max_unroll": 2, "block_dim": BLOCK_SIZE})


@wp.struct
class Windows:
    """Of tangled rays, beside the wavefront's buffers."""

    boxes: wp.uint64  # id of the BVH of all tets
    bounds: wp.array(dtype=wp.vec3)  # [2] of all vertices
    lengths: wp.array(dtype=float)  # [R] of the next window at most, or CROWDED_RAY, PLAIN_RAY
    highs: wp.array(dtype=float)  # [S] t where pieces end in their window
    crowded: wp.array(dtype=int)  # [R] those rays


@wp.kernel
def bounds_kernel(vertices: wp.array(dtype=wp.vec3), bounds: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    wp.atomic_min(bounds, 0, vertices[i])
    wp.atomic_max(bounds, 1, vertices[i])


@wp.kernel
def sort_rays_kernel(
    geometry: Geometry,
    tangled: TangledTets,
    width: int,
    row_count: int,
    buffers: Buffers,
    windows: Windows,
):
    """List the plain rays of an image, and bring the tangled ones to the mesh's box."""
    column, row = pixel_of(wp.tid(), width)
    if column >= width or row >= row_count:
        return
    ray = row * width + column
    windows.lengths[ray] = PLAIN_RAY
    # A ray that meets no face may meet tets beyond the boundary, as many inverted as not.
    if tangled.boxes == wp.uint64(0) and buffers.entries.count[ray] == 0:
        return
    origin = buffers.rays.origins[ray]
    direction = buffers.rays.directions[ray]
    if not is_tangled(geometry, tangled, origin, direction):
        if buffers.entries.count[ray] != 0:
            list_ray(buffers, ray)
        return
    t_in, _out = interval_in_box(windows.bounds[0], windows.bounds[1], origin, direction)
    buffers.rays.t[ray] = t_in
    windows.lengths[ray] = 0.0
    buffers.pixels.color[ray] = wp.vec3()
    buffers.pixels.depth[ray] = 0.0
    buffers.pixels.transmittance[ray] = 1.0


@wp.kernel
def list_tangled_kernel(width: int, row_count: int, buffers: Buffers, windows: Windows):
    """List the rays that `sort_rays_kernel` kept."""
    column, row = pixel_of(wp.tid(), width)
    if column < width and row < row_count:
        ray = row * width + column
        if windows.lengths[ray] != PLAIN_RAY:
            list_ray(buffers, ray)


@wp.kernel
def march_windows_kernel(
    geometry: Geometry,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    step: float,  # Δ
    buffers: Buffers,
    windows: Windows,
):
    """Fill the slots of each listed ray with its next window that isn't empty."""
    i = wp.tid()
    state = buffers.state
    stride = state[STRIDE]
    if i >= stride:
        return
    buffers.counts[i] = 0
    if i >= state[TAKEN]:
        return
    ray = buffers.lists[state[PARITY], i]
    origin = buffers.rays.origins[ray]
    direction = buffers.rays.directions[ray]
    _in, last = interval_in_box(windows.bounds[0], windows.bounds[1], origin, direction)
    most = state[PER_RAY]
    start = float(buffers.rays.t[ray])
    length = wp.max(windows.lengths[ray], LEAST_STEPS * step)
    end = float(start)
    found = int(0)
    stuck = bool(False)
    while found == 0 and end < last and not stuck:
        start = end
        limit = wp.min(start + length, last)
        found, first, end = first_pieces(
            geometry,
            occupancy,
            windows.boxes,
            origin,
            direction,
            step,
            start,
            limit,
            i,
            stride,
            most,
            buffers.slots,
            windows.highs,
        )
        stuck = end < limit and end - start < SHORTEST * wp.max(start, 1.0)
        if stuck:
            found = 0
            end = start
        elif found == 0:
            length = FAR  # to the other side of a gap
        elif found == most:
            length = GROWTH * (end - first)
        else:
            length *= GROWTH
    if stuck and most < MOST_SLOTS:  # it waits here
        add_up(state, STUCK, 1)
    elif stuck:
        length = CROWDED_RAY
    windows.lengths[ray] = length
    buffers.rays.t[ray] = end
    buffers.rays.tet[ray] = wp.where(end < last, 0, OUTSIDE)
    buffers.counts[i] = found


@wp.kernel
def composite_windows_kernel(stop: float, buffers: Buffers, windows: Windows):
    """Merge the pieces of each listed ray's window into its pixel."""
    i = wp.tid()
    state = buffers.state
    if i >= state[LISTED]:
        return
    ray = buffers.lists[state[PARITY], i]
    if i >= state[TAKEN]:
        list_ray(buffers, ray)
        return
    if windows.lengths[ray] < 0.0:
        windows.crowded[claim(state, CROWDED)] = ray
        return
    stride = state[STRIDE]
    count = buffers.counts[i]
    add_up(state, SAMPLES, count)
    pixels = buffers.pixels
    transmittance = pixels.transmittance[ray]
    color = pixels.color[ray]
    total_t = pixels.depth[ray]
    t = float(-FAR)
    going = int(1)
    while going == 1:
        # What overlaps the interval from t to the next end of a piece.
        kappa = float(0.0)
        emission = wp.vec3()
        until = float(FAR)
        k = int(0)
        while k < count:
            n = i + k * stride
            low = buffers.slots.t[n]
            high = windows.highs[n]
            if low > t:
                until = wp.min(until, low)
            elif high > t:
                medium = buffers.sigma[n] * buffers.slots.length[n]
                kappa += medium
                emission += medium * buffers.rgb[n]
                until = wp.min(until, high)
            k += 1
        if kappa > DARK:
            remaining = wp.exp(-kappa * (until - t))
            w = transmittance * (1.0 - remaining)
            color += (w / kappa) * emission
            total_t += w * 0.5 * (t + until)
            transmittance *= remaining
        t = until
        if until == FAR or transmittance < stop:
            going = 0
    if transmittance >= stop and buffers.rays.tet[ray] != OUTSIDE:
        pixels.transmittance[ray] = transmittance
        pixels.color[ray] = color
        pixels.depth[ray] = total_t
        list_ray(buffers, ray)
        return
    opacity = 1.0 - transmittance
    total_t /= wp.max(opacity, 1.0e-6)
    if transmittance < stop:
        color /= opacity
        opacity = 1.0
    color += (1.0 - opacity) * buffers.background[0]
    finish_ray(buffers, ray, color, opacity, total_t)


class WindowSlots:
    """Renders images of a wavefront in poses that overlap themselves."""

    def __init__(self, pose: Pose, wavefront: Wavefront):
        self._pose, self._wavefront = pose, wavefront
        self._way = None
        capacity, device = wavefront.capacity, pose.device
        self._windows = windows = Windows()
        windows.boxes = wp.uint64(0)
        with wp.ScopedDevice(device):
            windows.bounds = wp.empty(2, dtype=wp.vec3)
            windows.lengths = wp.empty(capacity, dtype=float)
            windows.highs = wp.empty(len(wavefront.buffers.sigma), dtype=float)
            windows.crowded = wp.empty(capacity, dtype=int)

    def render(self, boxes, tangled: TangledTets, shape, options, stage):
        """Render the image that the wavefront has begun: its plain rays, then its tangled ones.

        Args:
            boxes: The BVH of all tets in the present pose.
            shape: Rows and columns of the image.

        Returns:
            The crowded rays, whose pixels are wrong, and the number of samples.
        """
        pose, wavefront, windows = self._pose, self._wavefront, self._windows
        if self._way is None or windows.boxes != boxes.id:
            windows.boxes = boxes.id
            more = march_windows_kernel, composite_windows_kernel, LEAST_SLOTS, MOST_SLOTS
            self._way = Way(*more, (windows,))
        buffers, size = wavefront.buffers, (shape[1], shape[0])
        threads = pixel_threads(*size)
        # For another size of blocks than the module's, Warp would compile all of it once more.
        where = {"device": pose.device, "block_dim": BLOCK_SIZE}
        with stage("overlap"):
            windows.bounds[:1].fill_(wp.vec3(FAR))
            windows.bounds[1:].fill_(wp.vec3(-FAR))
            wp.launch(bounds_kernel, len(pose.vertices), [pose.vertices, windows.bounds], **where)
            buffers.state.zero_()
            inputs = [pose.geometry, tangled, *size, buffers, windows]
            wp.launch(sort_rays_kernel, threads, inputs, **where)
        sample_count = wavefront.render(options, stage)
        buffers.state.zero_()
        wp.launch(list_tangled_kernel, threads, [*size, buffers, windows], **where)
        state = wavefront.run(self._way, options, stage)
        return windows.crowded[: int(state[CROWDED])], sample_count + int(state[SAMPLES])
