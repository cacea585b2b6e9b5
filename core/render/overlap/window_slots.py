"""Tangled rays on CUDA: windows from front to back, in rounds that do not wait for the host.

The buffers of the wavefront (rounds/wavefront.py) hold all rays of an image, plain and tangled
ones.  In a round, a plain ray walks.  A tangled ray renders one window, an interval of t that meets
at most as many pieces, counted over all tets, as the ray has slots.  The pieces' ends cut a window
into intervals; in each, the media of the pieces that cover it add up (core/definition/image.py,
line 4).  bins.py lists the tets that a ray may meet, nearest first, so the search for the next
window's pieces goes on where this one ended.  A ray is done when its transmittance falls below the
limit `stop` or no tet is left.  If even its shortest window has too many pieces, the ray is
*crowded*, and merging.py renders it.

windows.py does the same on a CPU, a thread's rays at a time.

Shapes: R rays, T tets, S slots.
"""

import warp as wp

from ...base.wide import store_wide
from ..rays.pose import Geometry, Pose
from ..rays.traversal import interval_in_tet
from ..rounds.atomics import add_up, claim
from ..rounds.ray_color import Sums, rest_direction, store_sums, with_slot
from ..rounds.slot_march import march_known
from ..rounds.slots import (
    BLOCK_SIZE,
    CROWDED,
    LEAST_SLOTS,
    MOST_SLOTS,
    PARITY,
    PER_RAY,
    SAMPLES,
    STRIDE,
    STUCK,
    TAKEN,
    Buffers,
    composite_slots,
    has_ray_colors,
    keep_or_finish,
    list_ray,
    ray_with_slots,
)
from ..rounds.tiles import pixel_of, pixel_threads
from ..rounds.wavefront import Wavefront, Way
from .bins import ALL_BITS, BIN_COUNT, BITS, Bins, TetBins, bin_of, lowest_bit
from .pieces import FAR, OUTSIDE, SHORTEST, next_piece, pieces_behind
from .search import CROSSINGS, is_inside_two_shells, may_meet

DARK = wp.constant(1.0e-9)  # a smaller extinction is none
PLAIN_RAY = wp.constant(-1)  # instead of a place in the tets of its bin
CROWDED_RAY = wp.constant(-2)
floats_of_slots = wp.types.vector(MOST_SLOTS, wp.float32)
ints_of_slots = wp.types.vector(MOST_SLOTS, wp.int32)

# Approximate divisions, as in a walk.
wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


@wp.struct
class Windows:
    """Of tangled rays, beside the wavefront's buffers."""

    places: wp.array(dtype=int)  # [R] in the order of tets, or PLAIN_RAY, CROWDED_RAY
    highs: wp.array(dtype=float)  # [S] t where pieces end
    order: wp.array(dtype=int)  # [S] which of a ray's slots has the piece that begins next
    crowded: wp.array(dtype=int)  # [R] those rays


@wp.func
def meets_tangled_tet(
    geometry: Geometry, bins: Bins, own: int, origin: wp.vec3, direction: wp.vec3
):
    """Whether a ray of a bin meets a tet that is inverted or nearly flat."""
    found = bool(False)
    bin_count = bins.layout[BIN_COUNT]
    word = int(0)
    while word < bins.tangled.shape[0] and not found:
        bits = bins.tangled[word] & bins.bits[word * bin_count + own]
        while bits != wp.uint64(0) and not found:
            tet = bins.tets[word * BITS + lowest_bit(bits)]
            found = may_meet(geometry, tet, origin, direction)
            bits &= bits - wp.uint64(1)
        word += 1
    return found


@wp.kernel
def sort_listed_kernel(
    geometry: Geometry,
    bins: Bins,
    counts: wp.array(dtype=int),  # [2] see Overlap
    width: int,
    row_count: int,
    buffers: Buffers,
    windows: Windows,
):
    """List the rays of an image, and bring the tangled ones to the first tet of their bin."""
    column, row = pixel_of(wp.tid(), width)
    if column >= width or row >= row_count:
        return
    ray = row * width + column
    origin = buffers.rays.origins[ray]
    direction = buffers.rays.directions[ray]
    # A ray that meets no face may meet tets beyond the boundary, as many inverted as not.
    meets_face = buffers.rays.entries.count[ray] != 0
    tangled = meets_tangled_tet(geometry, bins, bin_of(bins, ray), origin, direction)
    if not tangled and meets_face and counts[wp.static(CROSSINGS)] > 0:
        tangled = is_inside_two_shells(geometry, origin, direction)
    if tangled:
        buffers.rays.entries.count[ray] = (
            0  # it does not use any, so search_slots_kernel leaves it out
        )
        buffers.rays.t[ray] = 0.0
        buffers.pixels.color[ray] = wp.vec3()
        buffers.pixels.depth[ray] = 0.0
        buffers.pixels.transmittance[ray] = 1.0
    windows.places[ray] = wp.where(tangled, 0, PLAIN_RAY)
    if tangled or meets_face:
        list_ray(buffers, ray)


@wp.func
def march_window(
    geometry: Geometry,
    bins: Bins,
    buffers: Buffers,
    windows: Windows,
    i: int,
    ray: int,
):
    """Fill the slots of the listed ray i with the pieces that it meets next; returns how many.

    The next window begins where the first piece does that has no room.
    """
    step = geometry.step
    state = buffers.state
    stride = state[STRIDE]
    most = state[PER_RAY]
    origin = buffers.rays.origins[ray]
    direction = buffers.rays.directions[ray]
    own = bin_of(bins, ray)  # bin
    bin_count = bins.layout[BIN_COUNT]
    start = buffers.rays.t[ray]
    end = float(FAR)
    count = int(0)
    begins = floats_of_slots()  # of the pieces, in order
    slots = ints_of_slots()  # theirs
    place = int(windows.places[ray])  # of the first tet that is not behind the window
    behind = bool(True)
    word = place / BITS
    last_word = bins.solid.shape[0] - 1
    bits = bins.solid[word] & bins.bits[word * bin_count + own]
    bits &= ALL_BITS << wp.uint64(place % BITS)
    going = bool(True)
    while going:
        while bits == wp.uint64(0) and word < last_word:
            word += 1
            bits = bins.solid[word] & bins.bits[word * bin_count + own]
        n = wp.max(word * BITS + lowest_bit(bits), 0)
        tet = bins.tets[n]
        going = bits != wp.uint64(0) and not bins.nears[n] >= end
        if going:
            bits &= bits - wp.uint64(1)
            alpha, slope, near, t_in, t_out = interval_in_tet(geometry, tet, origin, direction)
            meets = t_out > t_in and t_out > start
            behind = behind and not meets
            if behind:
                place = n + 1
            piece = int(0)
            piece_count = int(0)
            speed = float(1.0)
            fade = float(1.0)
            rest_length = float(0.0)
            if meets and t_in < end:
                speed, fade, rest_length, piece_count, piece = pieces_behind(
                    geometry, tet, slope, t_in, t_out, start
                )
            while piece < piece_count:
                piece, begin, until, bary = next_piece(
                    piece,
                    piece_count,
                    geometry.occupancy[tet],
                    alpha,
                    slope,
                    near,
                    t_in,
                    speed,
                    rest_length,
                    step,
                    start,
                    end,
                )
                if begin >= end:
                    piece = piece_count
                elif piece < piece_count:
                    k = int(count)
                    slot = int(count)
                    if count == most:  # one of them has no room
                        latest = begins[most - 1]
                        end = wp.max(begin, latest)
                        k = wp.where(begin < latest, most - 1, most)
                        slot = slots[most - 1]
                    if k < most:
                        while k > 0 and begins[wp.max(k - 1, 0)] > begin:
                            begins[k] = begins[k - 1]
                            slots[k] = slots[k - 1]
                            k -= 1
                        begins[k] = begin
                        slots[k] = slot
                        s = i + slot * stride
                        buffers.slots.tet[s] = tet
                        store_wide(buffers.slots.bary, s, bary)
                        buffers.slots.length[s] = fade * speed
                        buffers.slots.t[s] = begin
                        windows.highs[s] = until
                        count = wp.min(count + 1, most)
                piece += 1
    k = int(0)
    while k < count:
        windows.order[i + k * stride] = slots[k]
        k += 1
    if end - start < SHORTEST * wp.max(start, 1.0):
        count = 0
        end = start
        if most < MOST_SLOTS:  # it waits here
            add_up(state, STUCK, 1)
        else:
            place = CROWDED_RAY
    windows.places[ray] = place
    buffers.rays.t[ray] = end
    buffers.rays.tet[ray] = wp.where(end < FAR, 0, OUTSIDE)
    return count


@wp.kernel
def march_windows_kernel(
    geometry: Geometry,
    buffers: Buffers,
    windows: Windows,
    bins: Bins,
):
    """Fill the slots of each listed ray: a walk, or the next window."""
    i = wp.tid()
    state = buffers.state
    if i >= state[STRIDE]:
        return
    if i >= state[TAKEN]:
        buffers.counts[i] = 0
        return
    ray = buffers.lists[state[PARITY], i]
    if windows.places[ray] == PLAIN_RAY:
        march_known(geometry, buffers, i, ray)
    else:
        count = march_window(geometry, bins, buffers, windows, i, ray)
        buffers.counts[i] = count


@wp.func
def composite_window(stop: float, buffers: Buffers, windows: Windows, i: int, ray: int):
    """Merge the pieces in the slots of the listed ray i, in order of where they begin.

    Returns:
        Its transmittance, color and depth up to the end of the window.
    """
    stride = buffers.state[STRIDE]
    count = buffers.counts[i]
    end = buffers.rays.t[ray]
    pixels = buffers.pixels
    transmittance = pixels.transmittance[ray]
    color = pixels.color[ray]
    total_t = pixels.depth[ray]
    t = float(-FAR)
    first = int(0)  # the pieces before it have ended
    begun = int(0)  # pieces that begin at t or before
    next = float(FAR)  # where the next one begins
    if count > 0:
        next = buffers.slots.t[i + windows.order[i] * stride]
    summed = has_ray_colors(buffers)
    before = transmittance
    going = bool(next < end)
    while going:
        # What overlaps the interval from t to the next end of a piece.
        kappa = float(0.0)
        emission = wp.vec3()
        until = wp.min(next, end)
        k = int(first)
        while k < begun:
            n = i + windows.order[i + k * stride] * stride
            high = windows.highs[n]
            if high > t:
                medium = buffers.sigma[n] * buffers.slots.length[n]
                kappa += medium
                if not summed:
                    emission += medium * buffers.rgb[n]
                until = wp.min(until, high)
            elif k == first:
                first += 1
            k += 1
        if kappa > DARK:
            remaining = wp.exp(-kappa * (until - t))
            w = transmittance * (1.0 - remaining)
            color += (w / kappa) * emission
            k = first
            while summed and k < begun:
                n = i + windows.order[i + k * stride] * stride
                if windows.highs[n] > t:
                    medium = buffers.sigma[n] * buffers.slots.length[n]
                    buffers.weights[n] = buffers.weights[n] + (w / kappa) * medium
                k += 1
            total_t += w * 0.5 * (t + until)
            transmittance *= remaining
        going = until > t and until < end and transmittance >= stop
        t = until
        while going and next <= t:
            if summed:
                buffers.weights[i + windows.order[i + begun * stride] * stride] = 0.0
            begun += 1
            next = FAR
            if begun < count:
                next = buffers.slots.t[i + windows.order[i + begun * stride] * stride]
    if summed and transmittance < before:
        direction = buffers.rays.directions[ray]
        s = Sums()
        k = int(0)
        while k < begun:
            n = i + windows.order[i + k * stride] * stride
            if buffers.weights[n] > 0.0:
                turned = rest_direction(buffers.rotations, buffers.slots.tet[n], direction)
                s = with_slot(s, buffers.weights[n], buffers.h, n, turned)
            k += 1
        store_sums(s, before == 1.0, ray, buffers.sums)
    return transmittance, color, total_t


@wp.kernel
def composite_windows_kernel(stop: float, buffers: Buffers, windows: Windows, _bins: Bins):
    i = wp.tid()
    state = buffers.state
    ray = ray_with_slots(buffers, i)
    if ray < 0:
        return
    place = windows.places[ray]
    if place == CROWDED_RAY:
        windows.crowded[claim(state, CROWDED)] = ray
        return
    add_up(state, SAMPLES, buffers.counts[i])
    if place == PLAIN_RAY:
        transmittance, color, total_t = composite_slots(stop, buffers, i, ray)
    else:
        transmittance, color, total_t = composite_window(stop, buffers, windows, i, ray)
    keep_or_finish(stop, buffers, ray, transmittance, color, total_t)


class WindowSlots:
    """Renders images of a wavefront in poses that overlap themselves."""

    def __init__(self, pose: Pose, wavefront: Wavefront, options):
        """Allocate everything; `options` are the field's."""
        wavefront.add_slots(options)
        self._pose, self._wavefront = pose, wavefront
        capacity, device = wavefront.capacity, pose.device
        self._bins = TetBins(pose, wavefront.buffers, capacity)
        self._windows = windows = Windows()
        with wp.ScopedDevice(device):
            windows.places = wp.empty(capacity, dtype=int)
            windows.highs = wp.empty(len(wavefront.buffers.sigma), dtype=float)
            windows.order = wp.empty(len(wavefront.buffers.sigma), dtype=int)
            windows.crowded = wp.empty(capacity, dtype=int)
        kernels = march_windows_kernel, composite_windows_kernel
        self._way = Way(*kernels, LEAST_SLOTS, MOST_SLOTS, (windows, self._bins.bins))

    def render(self, counts, width: int, height: int, options, stage):
        """Render the image that the wavefront has begun, and not started.

        Args:
            counts: Overlap's, on the device.

        Returns:
            The crowded rays, whose pixels are wrong, and the number of samples.
        """
        pose, wavefront, windows = self._pose, self._wavefront, self._windows
        buffers = wavefront.buffers
        # For another size of blocks than the module's, Warp would compile all of it once more.
        where = {"device": pose.device, "block_dim": BLOCK_SIZE}
        with stage("overlap"):
            self._bins.make(width, height)
            buffers.state.zero_()
            inputs = [pose.geometry, self._bins.bins, counts, width, height, buffers, windows]
            wp.launch(sort_listed_kernel, pixel_threads(width, height), inputs, **where)
        wavefront.start(options, stage, self._way)
        sample_count, crowded_count, _ = wavefront.finish(options, stage, self._way)
        return windows.crowded[:crowded_count], sample_count
