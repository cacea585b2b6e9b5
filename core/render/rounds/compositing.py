"""Samples to pixels: the volume-rendering sum (DeformRF, Eq. 1).

Piece i of a ray has color c_i and optical depth τ_i = σ_i·length_i.  Here length_i is the piece's
length in rest space, multiplied by the fade s of its tet (see rays/pose.py):

    T_i = exp(-Σ_{j<i} τ_j)        transmittance before piece i
    w_i = T_i (1 - exp(-τ_i))      weight
    C = Σ w_i c_i,  opacity = Σ w_i,  depth = Σ w_i t_i / Σ w_i

Distortion loss (Mip-NeRF 360, Barron et al. 2022, Eq. 15) of one ray, with the pieces'
middles t_i and extents δ_i:

    D = Σ_ij w_i w_j |t_i - t_j| + ⅓ Σ_i w_i² δ_i

Shapes: R rays, N packed samples; ray r has the samples ends[r] - counts[r] .. ends[r] - 1.
"""

from typing import Any

import warp as wp

from ...field import GEOMETRY_FEATURES
from ..rays.marching import RaySamples

# What a ray sums where it has one color, see ../deferred.py: h, the rest direction, and a number
# that stays 0: rows of whole 16 bytes.
ray_sums = wp.types.vector(length=GEOMETRY_FEATURES + 4, dtype=wp.float32)

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.struct
class Pixels:
    """Running sums of rays in progress.  [R] each"""

    color: wp.array(dtype=wp.vec3)
    depth: wp.array(dtype=float)  # Σ w t
    transmittance: wp.array(dtype=float)
    tet: wp.array(dtype=int)  # where transmittance passes ½, -1 before
    sample_count: wp.array(dtype=int)  # that were evaluated
    sums: wp.array(dtype=ray_sums)  # [R]; empty where samples have colors


def empty_pixels(count: int, device, deferred=False) -> Pixels:
    """Pixels of rays that have not begun; `deferred`: with one color a ray."""
    pixels = Pixels()
    pixels.sums = wp.zeros(count if deferred else 0, dtype=ray_sums, device=device)
    pixels.color = wp.zeros(count, dtype=wp.vec3, device=device)
    pixels.depth = wp.zeros(count, dtype=float, device=device)
    pixels.transmittance = wp.full(count, 1.0, dtype=float, device=device)
    pixels.tet = wp.full(count, -1, dtype=int, device=device)
    pixels.sample_count = wp.zeros(count, dtype=int, device=device)
    return pixels


@wp.kernel
def accumulate_kernel(
    sigma: wp.array(dtype=float),  # [N]
    values: wp.array(dtype=Any),  # [N] colors, or what rays sum instead
    found: RaySamples,
    ray_tet: wp.array(dtype=int),  # [R] -2 where the ray has left the mesh for good
    stop: float,  # transmittance below which a ray ends
    closing: int,  # 1: behind its end a ray looks as before it; 0: black
    pixels: Pixels,
    sums: wp.array(dtype=Any),  # [R] of the values: the pixels' color, or their sums
    still_alive: wp.array(dtype=int),  # [threads] out
    still_alive_count: wp.array(dtype=int),  # [1] out
):
    """Add one round of samples to the pixels, and list the rays that go on."""
    i = wp.tid()
    ray = found.ids[i]
    samples = found.samples
    transmittance = pixels.transmittance[ray]
    c = sums[ray]
    depth = pixels.depth[ray]
    pixels.sample_count[ray] = pixels.sample_count[ray] + found.counts[i]
    n = found.ends[i] - found.counts[i]
    while n < found.ends[i] and transmittance >= stop:
        remaining = wp.exp(-sigma[n] * samples.length[n])
        w = transmittance * (1.0 - remaining)
        c += w * values[n]
        depth += w * samples.t[n]
        if transmittance >= 0.5 and transmittance * remaining < 0.5:
            pixels.tet[ray] = samples.tet[n]
        transmittance *= remaining
        n += 1
    ended = transmittance < stop
    if ended and closing == 1:
        c /= 1.0 - transmittance
        depth /= 1.0 - transmittance
        transmittance = 0.0
    pixels.transmittance[ray] = transmittance
    sums[ray] = c
    pixels.depth[ray] = depth
    if not ended and ray_tet[ray] > -2:
        still_alive[wp.atomic_add(still_alive_count, 0, 1)] = ray


for _vector in (wp.vec3, ray_sums):
    wp.overload(accumulate_kernel, {k: wp.array(dtype=_vector) for k in ("values", "sums")})


@wp.kernel
def resolve_kernel(
    pixels: Pixels,
    ids: wp.array(dtype=int),  # ray of each thread; if empty, thread i has ray i
    background: wp.vec3,
    color: wp.array(dtype=wp.vec4ub),  # [R] out: over the background, a = opacity
    depth: wp.array(dtype=float),  # [R] out: inf where opacity < 0.5
):
    ray = wp.tid()
    if ids.shape[0] > 0:
        ray = ids[ray]
    t = pixels.transmittance[ray]
    c = pixels.color[ray] + t * background
    color[ray] = to_bytes(c, 1.0 - t)
    depth[ray] = wp.where(t > 0.5, wp.inf, pixels.depth[ray] / wp.max(1.0 - t, 1.0e-6))


@wp.func
def to_byte(x: float):
    return wp.uint8(wp.clamp(x, 0.0, 1.0) * 255.0 + 0.5)


@wp.func
def to_bytes(color: wp.vec3, opacity: float):
    return wp.vec4ub(to_byte(color[0]), to_byte(color[1]), to_byte(color[2]), to_byte(opacity))


def resolve(pixels: Pixels, background, color, depth, ids=None) -> None:
    """Write color and depth of the rays `ids`, by default of all that `color` holds."""
    count = len(color if ids is None else ids)
    if ids is None:
        ids = wp.empty(0, dtype=int, device=color.device)
    inputs = [pixels, ids, wp.vec3(*background)]
    wp.launch(resolve_kernel, count, inputs=inputs, outputs=[color, depth], device=color.device)
