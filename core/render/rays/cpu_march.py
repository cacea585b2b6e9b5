"""The march of many rays on a CPU, by one thread.

Shapes: R rays, K slots per ray, T tets.
"""

import warp as wp

from .entries import Entries
from .marching import FILL_SLOTS, MIDDLE, Rays, Samples, march_ray
from .pose import Geometry

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.func
def march_some(
    geometry: Geometry,
    entries: Entries,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    rays: Rays,
    alive: wp.array(dtype=int),
    first: int,  # of `alive`
    count: int,  # rays
    step: float,  # Δ
    slot_count: int,  # K
    densities: wp.array(dtype=float),  # [64 T] expected σ of sub-tets
    transmittance: wp.array(dtype=float),  # [R]
    stop: float,  # transmittance below which a ray ends
    samples: Samples,  # out: [count · K]
    counts: wp.array(dtype=int),  # [count] out: samples of each ray
):
    """`march_ray` for alive[first], ..., to where each is expected to end."""
    i = int(0)
    while i < count:
        ray = alive[first + i]
        counts[i] = march_ray(
            geometry,
            entries,
            occupancy,
            rays,
            ray,
            step,
            MIDDLE,
            FILL_SLOTS,
            i * slot_count,
            1,
            slot_count,
            samples,
            densities,
            wp.log(transmittance[ray] / stop),
        )
        i += 1
