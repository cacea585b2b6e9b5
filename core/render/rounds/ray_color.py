"""One color a ray, in the wavefront: samples are added to a ray's sums; ended rays get colors.

../deferred.py does the same for rounds that the host waits for.  While a ray has no opacity, its
sums are not initialized, and must not be read.

Shapes: R rays, S slots, T tets.
"""

import warp as wp

from ...base.wide import load_wide, load_wide_half, store_wide, store_wide_half, vec4h
from ...field import CONSTANT_BASIS, basis_of, basis_vector
from .atomics import claim
from .compositing import ray_sums, to_bytes
from .cpu import SMALLEST

BLOCK_SIZE = 128  # as in slots.py
FOURS = wp.constant(len(ray_sums()) // 4)  # of a ray's sums

wp.set_module_options(
    {"enable_backward": False, "max_unroll": 2, "fast_math": True, "block_dim": BLOCK_SIZE}
)


def fours_of(sums):
    """An array of ray_sums [R] as one of vec4 [5 R]."""
    if not len(sums):
        return wp.empty(0, dtype=wp.vec4, device=sums.device)
    count = len(sums) * int(FOURS)
    return wp.array(
        ptr=sums.ptr, dtype=wp.vec4, shape=count, device=sums.device, capacity=sums.capacity
    )


@wp.struct
class Sums:
    """A ray's sums so far: h, four by four, and the rest direction."""

    a: wp.vec4
    b: wp.vec4
    c: wp.vec4
    d: wp.vec4
    direction: wp.vec3


@wp.func
def with_slot(s: Sums, w: float, h: wp.array(dtype=vec4h), n: int, direction: wp.vec3):
    """The sums with those of slot n, whose weight is w."""
    s.a += w * load_wide_half(h, 4 * n)
    s.b += w * load_wide_half(h, 4 * n + 1)
    s.c += w * load_wide_half(h, 4 * n + 2)
    s.d += w * load_wide_half(h, 4 * n + 3)
    s.direction += w * direction
    return s


@wp.func
def store_sums(s: Sums, fresh: bool, ray: int, sums: wp.array(dtype=wp.vec4)):
    """Add to what a ray has summed before; `fresh`: nothing, memory may hold anything.

    A ray's sums are read by one thread alone, before it writes them, so the cache for what no
    kernel changes (load_wide) may hold them.
    """
    k = FOURS * ray
    e = wp.vec4(s.direction[0], s.direction[1], s.direction[2], 0.0)
    if not fresh:
        s.a += load_wide(sums, k)
        s.b += load_wide(sums, k + 1)
        s.c += load_wide(sums, k + 2)
        s.d += load_wide(sums, k + 3)
        e += load_wide(sums, k + 4)
    store_wide(sums, k, s.a)
    store_wide(sums, k + 1, s.b)
    store_wide(sums, k + 2, s.c)
    store_wide(sums, k + 3, s.d)
    store_wide(sums, k + 4, e)


@wp.func
def rest_direction(rotations: wp.array(dtype=wp.mat33), tet: int, direction: wp.vec3):
    return wp.transpose(rotations[tet]) * direction


@wp.kernel
def means_kernel(
    transmittance: wp.array(dtype=float),  # [R]
    sums: wp.array(dtype=wp.vec4),  # [5 R]
    constant_direction: int,  # 1: the color does not depend on the direction
    count: wp.array(dtype=int),  # [1] 0 before; out: rays with any opacity
    painted: wp.array(dtype=int),  # [R] out: these rays
    x: wp.array(dtype=vec4h),  # [8 R] out: of each, mean h, then Y of the mean direction
):
    """List the rays that get a color, with what it follows from: the network meets no others."""
    ray = wp.tid()
    opacity = 1.0 - transmittance[ray]
    if opacity <= 0.0:
        return
    place = claim(count, 0)
    painted[place] = ray
    scale = 1.0 / wp.max(opacity, wp.static(SMALLEST))
    k = int(0)
    while k < 4:
        store_wide_half(x, 8 * place + k, scale * load_wide(sums, FOURS * ray + k))
        k += 1
    b = basis_vector()
    b[0] = wp.static(CONSTANT_BASIS[0])
    if constant_direction == 0:
        e = load_wide(sums, FOURS * ray + 4)
        direction = wp.vec3(e[0], e[1], e[2])
        b = basis_of(direction / wp.max(wp.length(direction), wp.static(SMALLEST)))
    store_wide_half(x, 8 * place + 4, wp.vec4(b[0], b[1], b[2], b[3]))
    store_wide_half(x, 8 * place + 5, wp.vec4(b[4], b[5], b[6], b[7]))
    store_wide_half(x, 8 * place + 6, wp.vec4(b[8], b[9], b[10], b[11]))
    store_wide_half(x, 8 * place + 7, wp.vec4(b[12], b[13], b[14], b[15]))


@wp.kernel
def paint_kernel(
    transmittance: wp.array(dtype=float),  # [R]
    count: wp.array(dtype=int),  # [1] as means_kernel's
    painted: wp.array(dtype=int),  # [R] likewise
    rgb: wp.array(dtype=wp.vec3),  # [R] of these
    stop: float,  # a ray with a smaller transmittance is opaque
    background: wp.array(dtype=wp.vec3),  # [1]
    color: wp.array(dtype=wp.vec4ub),  # [R] out, where there is any opacity
):
    place = wp.tid()
    if place >= count[0]:
        return
    ray = painted[place]
    opacity = 1.0 - transmittance[ray]
    if transmittance[ray] < stop:
        opacity = 1.0
    color[ray] = to_bytes(opacity * rgb[place] + (1.0 - opacity) * background[0], opacity)
