"""Tangled rays on CUDA: windows from front to back, in rounds that do not wait for the host.

The wavefront (rounds/wavefront.py) has rendered all rays as plain ones; its buffers hold them.
Tangled ones are listed anew.  In a round each of them has one window of t, with so many pieces of
all tets as it has slots, and `composite_windows_kernel` merges what overlaps: line 4 of the
definition, between each two neighboring ends of pieces.  A ray is done when it gets dark or
leaves the mesh's box.  Where even the shortest window has too many pieces, the ray is *crowded*:
merging.py renders it.

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
    TAKEN,
    Buffers,
    Wavefront,
    Way,
    add_up,
    claim,
    finish_ray,
    list_ray,
)
from .pieces import interval_in_box, pieces_between
from .search import TangledTets, is_tangled

LEAST_SLOTS, MOST_SLOTS = 16, 32  # per ray and round: what overlaps needs some
FIRST_STEPS = 4.0  # length of the first window [Δ]
GROWTH = wp.constant(2.0)
SHORTEST = wp.constant(1.0e-6)  # of t, or of the unit of space if that is more
DARK = wp.constant(1.0e-9)  # a smaller extinction is none
NO_WINDOW = wp.constant(-1.0)  # as a crowded ray's length
OUTSIDE = wp.constant(-2)  # as a ray's tet: it has left the mesh for good
FAR = wp.constant(1.0e30)

wp.set_module_options({"enable_backward": False, "max_unroll": 2, "block_dim": BLOCK_SIZE})


@wp.struct
class Windows:
    """Of tangled rays, beside the wavefront's buffers."""

    boxes: wp.uint64  # id of the BVH of all tets
    bounds: wp.array(dtype=wp.vec3)  # [2] of all vertices
    lengths: wp.array(dtype=float)  # [R] of the next window, or NO_WINDOW
    highs: wp.array(dtype=float)  # [S] t where pieces end in their window
    crowded: wp.array(dtype=int)  # [R] those rays


@wp.kernel
def bounds_kernel(vertices: wp.array(dtype=wp.vec3), bounds: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    wp.atomic_min(bounds, 0, vertices[i])
    wp.atomic_max(bounds, 1, vertices[i])


@wp.kernel
def list_tangled_kernel(
    geometry: Geometry,
    tangled: TangledTets,
    first_length: float,
    buffers: Buffers,
    windows: Windows,
):
    """Begin anew with the tangled ones among the rays of an image."""
    ray = wp.tid()
    # A ray that meets no face may meet tets beyond the boundary, as many inverted as not.
    if tangled.boxes == wp.uint64(0) and buffers.entries.count[ray] == 0:
        return
    origin = buffers.rays.origins[ray]
    direction = buffers.rays.directions[ray]
    if not is_tangled(geometry, tangled, origin, direction):
        return
    t_in, _out = interval_in_box(windows.bounds[0], windows.bounds[1], origin, direction)
    buffers.rays.t[ray] = t_in
    windows.lengths[ray] = first_length
    buffers.pixels.color[ray] = wp.vec3()
    buffers.pixels.depth[ray] = 0.0
    buffers.pixels.transmittance[ray] = 1.0
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
    start = buffers.rays.t[ray]
    length = windows.lengths[ray]
    end = float(start)
    found = int(0)
    looking = int(1)
    while looking == 1:
        end = wp.min(start + length, last)
        found = pieces_between(
            geometry,
            occupancy,
            windows.boxes,
            origin,
            direction,
            step,
            start,
            end,
            i,
            stride,
            most,
            buffers.slots,
            windows.highs,
        )
        looking = 0
        if found > most:
            length *= 0.5
            looking = 1
            if length < SHORTEST * wp.max(start, 1.0):
                length = NO_WINDOW
                found = 0
                looking = 0
        else:
            if found < most / 3:
                length *= GROWTH
            if found == 0 and end < last:
                start = end
                looking = 1
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
    """Renders the tangled rays of images that a wavefront has rendered."""

    def __init__(self, pose: Pose, wavefront: Wavefront, march_step: float):
        self._pose, self._wavefront, self._march_step = pose, wavefront, march_step
        self._way = None
        capacity, device = wavefront.capacity, pose.device
        self._windows = windows = Windows()
        windows.boxes = wp.uint64(0)
        with wp.ScopedDevice(device):
            windows.bounds = wp.empty(2, dtype=wp.vec3)
            windows.lengths = wp.empty(capacity, dtype=float)
            windows.highs = wp.empty(len(wavefront.buffers.sigma), dtype=float)
            windows.crowded = wp.empty(capacity, dtype=int)

    def render(self, boxes, tangled: TangledTets, count: int, options, stage):
        """Render those of the first `count` rays again that are tangled.

        Args:
            boxes: The BVH of all tets in the present pose.

        Returns:
            The crowded rays, whose pixels are wrong, and the number of samples.
        """
        pose, wavefront, windows = self._pose, self._wavefront, self._windows
        if self._way is None or windows.boxes != boxes.id:
            windows.boxes = boxes.id
            more = march_windows_kernel, composite_windows_kernel, LEAST_SLOTS, MOST_SLOTS
            self._way = Way(*more, (windows,))
        windows.bounds[:1].fill_(wp.vec3(FAR))
        windows.bounds[1:].fill_(wp.vec3(-FAR))
        device, buffers = pose.device, wavefront.buffers
        # For another size of blocks than the module's, Warp would compile all of it once more.
        where = {"device": device, "block_dim": BLOCK_SIZE}
        wp.launch(bounds_kernel, len(pose.vertices), [pose.vertices, windows.bounds], **where)
        buffers.state.zero_()
        length = FIRST_STEPS * self._march_step * options.step_factor
        inputs = [pose.geometry, tangled, length, buffers, windows]
        wp.launch(list_tangled_kernel, count, inputs, **where)
        state = wavefront.run(self._way, options, stage)
        return windows.crowded[: int(state[CROWDED])], int(state[SAMPLES])
