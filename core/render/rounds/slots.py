"""The data that the kernels of wavefront.py share, and most of these kernels.

wavefront.py describes a round.  The progress of an image is a few integers on the device, the
state; the constants below name their places.  There are two lists of rays: in each round, kernels
read one and write the other, then the lists are swapped.

Shapes: R rays, S slots, L levels, T tets.
"""

import numpy as np
import warp as wp

from ...base.wide import load_wide, store_wide_half, vec4h
from ...field import CONSTANT_BASIS, Tables, basis_of, encoded_half
from ...geometry import lattice_point
from ..rays.camera import DeviceCamera, camera_ray
from ..rays.entries import UNKNOWN, empty_entries, find_entries
from ..rays.marching import Rays, Samples, empty_rays, empty_samples
from ..rays.pose import Geometry
from .atomics import add_up, claim
from .compositing import Pixels, empty_pixels, to_bytes
from .ray_color import Sums, fours_of, rest_direction, store_sums, with_slot
from .tiles import pixel_of

LEAST_SLOTS, MOST_SLOTS = wp.constant(8), wp.constant(32)  # per ray and round, K
ALIGNMENT = wp.constant(64)  # of the stride
# Places in the state, integers on the device.
PARITY = wp.constant(0)  # which list is read
LISTED = wp.constant(1)  # rays in it
NEXT_LISTED = wp.constant(2)  # rays in the other one, so far
TAKEN = wp.constant(3)  # rays that have slots in this round
STRIDE = wp.constant(4)
PER_RAY = wp.constant(5)  # K
TOTAL = wp.constant(6)  # stride · K
ROUNDS = wp.constant(7)  # that had rays
SAMPLES = wp.constant(8)  # evaluated
CROWDED = wp.constant(9)  # rays that need another path, see overlap/window_slots.py
STUCK = wp.constant(10)  # rays that could not go on for want of slots, in the last round
FEWEST = wp.constant(11)  # slots per ray from now on, because many were stuck
PAINTED = wp.constant(12)  # rays that get colors, see ray_color.py
# If rays are traced without rounds (tracing.py):
NEXT_RAY = wp.constant(13)  # of those that are listed
SEARCHING = wp.constant(14)  # rays that search, listed apart
NEXT_SEARCHING = wp.constant(15)  # of these
STATE_SIZE = 16
LISTED_APART = wp.constant(0)  # the list that is read, so free: PARITY is 0 before the first round
MANY_STUCK = wp.constant(40)  # one in so many rays
BLOCK_SIZE = 128  # threads; in larger blocks more of them wait for the longest ray

# Approximate divisions take a fifth of the time, and half precision hides their error.
# The viewer compiles the module ahead, for the block size that the wavefront launches.
wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


@wp.struct
class Buffers:
    """An image in progress."""

    camera: wp.array(dtype=DeviceCamera)  # [1] that of the rays
    rays: Rays  # [R]
    pixels: Pixels  # [R]
    state: wp.array(dtype=int)  # [STATE_SIZE]
    lists: wp.array2d(dtype=int)  # [2, R]
    # What rounds need, empty before add_slots; so are basis, h and weights:
    slots: Samples  # [S]
    counts: wp.array(dtype=int)  # [S / LEAST_SLOTS] samples of each listed ray
    features: wp.array(dtype=vec4h)  # [S · L], unless a kernel finds and uses them at once
    sigma: wp.array(dtype=float)  # [S]
    # Where samples have colors:
    basis: wp.array(dtype=vec4h)  # [4 S] spherical harmonics
    rgb: wp.array(dtype=wp.vec3)  # [S]; with one color a ray [R], as means
    # Where rays have colors (ray_color.py):
    h: wp.array(dtype=vec4h)  # [4 S]
    weights: wp.array(dtype=float)  # [S] of tangled rays
    sums: wp.array(dtype=wp.vec4)  # [5 R] those of the pixels
    painted: wp.array(dtype=int)  # [R] those that have any opacity
    means: wp.array(dtype=vec4h)  # [8 R] theirs, without gaps
    rotations: wp.array(dtype=wp.mat33)  # [T] Q
    # Of the image:
    background: wp.array(dtype=wp.vec3)  # [1]
    color: wp.array(dtype=wp.vec4ub)  # [R] of finished rays
    depth: wp.array(dtype=float)  # [R] of finished rays


def empty_buffers(ray_count: int, options, shading) -> Buffers:
    """Room for so many rays of a field with `options`, whose Shading that is; see `add_slots`."""
    buffers, deferred, device = Buffers(), options.deferred, shading.device
    buffers.rays = empty_rays(ray_count, device)
    buffers.rays.entries = empty_entries(ray_count, device)
    buffers.pixels = empty_pixels(ray_count, device, deferred)
    painted_count = ray_count if deferred else 0
    with wp.ScopedDevice(device):
        buffers.camera = wp.zeros(1, dtype=DeviceCamera)
        buffers.state = wp.zeros(STATE_SIZE, dtype=int)
        buffers.lists = wp.empty((2, ray_count), dtype=int)
        buffers.rotations = shading.rotations
        buffers.sums = fours_of(buffers.pixels.sums)
        buffers.painted = wp.empty(painted_count, dtype=int)
        buffers.means = wp.zeros(8 * painted_count, dtype=vec4h)
        buffers.rgb = wp.empty(painted_count, dtype=wp.vec3)
        buffers.background = wp.zeros(1, dtype=wp.vec3)
        buffers.color = wp.empty(ray_count, dtype=wp.vec4ub)
        buffers.depth = wp.empty(ray_count, dtype=float)
    return buffers


def add_slots(buffers: Buffers, slot_count: int, options, device: wp.DeviceLike):
    """Give buffers room for so many slots, which rounds need."""
    deferred = options.deferred
    buffers.slots = empty_samples(slot_count, device)
    feature_count = 0 if deferred and device.is_cuda else slot_count * options.level_count
    with wp.ScopedDevice(device):
        buffers.counts = wp.empty(slot_count // LEAST_SLOTS, dtype=int)
        buffers.features = wp.zeros(feature_count, dtype=vec4h)
        buffers.sigma = wp.empty(slot_count, dtype=float)
        if deferred:
            buffers.h = wp.empty(4 * slot_count, dtype=vec4h)
            buffers.weights = wp.empty(slot_count, dtype=float)
        else:
            basis = np.tile(np.array(CONSTANT_BASIS, np.float16), (slot_count, 1))
            buffers.basis = wp.array(basis.reshape(-1, 4), dtype=vec4h)
            buffers.rgb = wp.empty(slot_count, dtype=wp.vec3)


@wp.func
def has_ray_colors(buffers: Buffers):
    return buffers.painted.shape[0] > 0


@wp.func
def list_ray(buffers: Buffers, ray: int):
    """Put a ray into the list of the next round."""
    state = buffers.state
    buffers.lists[1 - state[PARITY], claim(state, NEXT_LISTED)] = ray


@wp.func
def finish_ray(buffers: Buffers, ray: int, color: wp.vec3, opacity: float, depth: float):
    """Write the pixel of a ray; its color is over the background."""
    buffers.color[ray] = to_bytes(color, opacity)
    buffers.depth[ray] = wp.where(opacity < 0.5, wp.inf, depth)


@wp.kernel
def begin_kernel(geometry: Geometry, first_row: int, row_count: int, apart: int, buffers: Buffers):
    """Make the rays of the image, find their entries, and list those that meet the mesh.

    Rays are numbered as their pixels, row by row.  With apart = 1 those that search for their
    entries have the other list.
    """
    camera = buffers.camera[0]
    width = camera.lens.width
    column, row = pixel_of(wp.tid(), width)
    if column >= width or row >= row_count:
        return
    ray = row * width + column
    origin, direction = camera_ray(camera, column, first_row + row)
    rays = buffers.rays
    rays.origins[ray] = origin
    rays.directions[ray] = direction
    buffers.pixels.transmittance[ray] = 1.0
    found = find_entries(geometry, origin, direction, ray, rays.entries, True)
    if found == 0:
        finish_ray(buffers, ray, buffers.background[0], 0.0, 0.0)
        return
    rays.t[ray] = 0.0
    rays.tet[ray] = -1
    rays.entry_face[ray] = -1
    rays.piece[ray] = 0
    buffers.pixels.color[ray] = wp.vec3()
    buffers.pixels.depth[ray] = 0.0
    if apart != 0 and found == UNKNOWN:
        buffers.lists[LISTED_APART, claim(buffers.state, SEARCHING)] = ray
    else:
        list_ray(buffers, ray)


@wp.kernel
def advance_kernel(slot_count: int, least: int, most: int, state: wp.array(dtype=int)):
    """Swap the lists, and divide the slots among the rays of the one to read.

    Each of them gets from `least` to `most`.  A ray that needs more than there are waits until
    few are left, but where many do, all get more.
    """
    fewest = wp.max(least, state[FEWEST])
    if MANY_STUCK * state[STUCK] > state[TAKEN]:
        fewest = wp.min(2 * state[PER_RAY], most)
        state[FEWEST] = fewest
    state[STUCK] = 0
    listed = state[NEXT_LISTED]
    state[PARITY] = 1 - state[PARITY]
    state[LISTED] = listed
    state[NEXT_LISTED] = 0
    taken = wp.min(listed, slot_count / fewest / ALIGNMENT * ALIGNMENT)
    stride = (taken + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT
    # Half of the room fills a GPU, and wastes few samples behind a surface.
    per_ray = wp.clamp(slot_count / 2 / wp.max(stride, 1), fewest, most)
    state[TAKEN] = taken
    state[STRIDE] = stride
    state[PER_RAY] = per_ray
    state[TOTAL] = stride * per_ray
    if listed > 0:
        state[ROUNDS] = state[ROUNDS] + 1


@wp.kernel
def encode_slots_kernel(
    tables: Tables,
    table: wp.array(dtype=vec4h),  # [entries]
    nodes: wp.array(dtype=vec4h),  # node_table of the dense levels
    rotations: wp.array(dtype=wp.mat33),  # [T] Q
    level_count: int,
    used_level_count: int,  # the finer ones count as zero
    constant_direction: int,  # 1: the color does not depend on the direction
    buffers: Buffers,
):
    n = wp.tid()
    state = buffers.state
    if n >= state[TOTAL]:
        return
    stride = state[STRIDE]
    i = n % stride
    if n / stride >= buffers.counts[i]:
        return
    tet = buffers.slots.tet[n]
    x = lattice_point(load_wide(buffers.slots.bary, n))
    products = tables.products[tet]
    level = int(0)
    while level < used_level_count:
        f = encoded_half(tables, table, nodes, level, tet, x, products)
        store_wide_half(buffers.features, n * level_count + level, f)
        level += 1
    while level < level_count:
        store_wide_half(buffers.features, n * level_count + level, wp.vec4())
        level += 1
    if constant_direction == 0 and not has_ray_colors(buffers):
        direction = buffers.rays.directions[buffers.lists[state[PARITY], i]]
        b = basis_of(wp.transpose(rotations[tet]) * direction)
        store_wide_half(buffers.basis, 4 * n, wp.vec4(b[0], b[1], b[2], b[3]))
        store_wide_half(buffers.basis, 4 * n + 1, wp.vec4(b[4], b[5], b[6], b[7]))
        store_wide_half(buffers.basis, 4 * n + 2, wp.vec4(b[8], b[9], b[10], b[11]))
        store_wide_half(buffers.basis, 4 * n + 3, wp.vec4(b[12], b[13], b[14], b[15]))


@wp.func
def composite_slots(stop: float, buffers: Buffers, i: int, ray: int):
    """`accumulate_kernel` on the slots of the listed ray i.

    Returns:
        Its transmittance, color and depth up to where the slots end.
    """
    stride = buffers.state[STRIDE]
    slots = buffers.slots
    transmittance = buffers.pixels.transmittance[ray]
    before = transmittance
    c = buffers.pixels.color[ray]
    total_t = buffers.pixels.depth[ray]
    summed = has_ray_colors(buffers)
    direction = wp.vec3()
    if summed:
        direction = buffers.rays.directions[ray]
    s = Sums()
    turned = wp.vec3()  # in the last slot's tet
    tet = int(-1)
    n = int(i)
    last = i + buffers.counts[i] * stride
    while n < last and transmittance >= stop:
        remaining = wp.exp(-buffers.sigma[n] * slots.length[n])
        w = transmittance * (1.0 - remaining)
        if summed:
            if slots.tet[n] != tet:
                tet = slots.tet[n]
                turned = rest_direction(buffers.rotations, tet, direction)
            s = with_slot(s, w, buffers.h, n, turned)
        else:
            c += w * buffers.rgb[n]
        total_t += w * slots.t[n]
        transmittance *= remaining
        n += stride
    if summed and n > i:
        store_sums(s, before == 1.0, ray, buffers.sums)
    return transmittance, c, total_t


@wp.func
def keep_or_finish(
    stop: float, buffers: Buffers, ray: int, transmittance: float, color: wp.vec3, total_t: float
):
    """List a ray for the next round, or end it."""
    if transmittance >= stop and buffers.rays.tet[ray] > -2:
        buffers.pixels.transmittance[ray] = transmittance
        buffers.pixels.color[ray] = color
        buffers.pixels.depth[ray] = total_t
        list_ray(buffers, ray)
    else:
        end_ray(stop, buffers, ray, transmittance, color, total_t)


@wp.func
def end_ray(
    stop: float, buffers: Buffers, ray: int, transmittance: float, color: wp.vec3, total_t: float
):
    """Write the pixel of a ray: `resolve_kernel`, with closing = 1."""
    opacity = 1.0 - transmittance
    depth = total_t / wp.max(opacity, 1.0e-6)
    if has_ray_colors(buffers) and opacity > 0.0:  # it is painted when all rays have ended
        buffers.pixels.transmittance[ray] = transmittance
        buffers.depth[ray] = wp.where(transmittance > 0.5 and transmittance >= stop, wp.inf, depth)
        return
    c = color
    if transmittance < stop:
        c = color / opacity
        opacity = 1.0
    finish_ray(buffers, ray, c + (1.0 - opacity) * buffers.background[0], opacity, depth)


@wp.func
def ray_with_slots(buffers: Buffers, i: int):
    """The i-th listed ray, if it has slots in this round.  Else -1; a ray without waits."""
    state = buffers.state
    ray = int(-1)
    if i < state[LISTED]:
        ray = buffers.lists[state[PARITY], i]
        if i >= state[TAKEN]:
            list_ray(buffers, ray)
            ray = -1
    return ray


@wp.kernel
def composite_slots_kernel(stop: float, buffers: Buffers):
    i = wp.tid()
    ray = ray_with_slots(buffers, i)
    if ray < 0:
        return
    add_up(buffers.state, SAMPLES, buffers.counts[i])
    transmittance, color, total_t = composite_slots(stop, buffers, i, ray)
    keep_or_finish(stop, buffers, ray, transmittance, color, total_t)
