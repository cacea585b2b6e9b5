"""The march of many rays on a CPU, by one thread: rays side by side in the lanes of vectors.

`march_ray` defines the result.  Few rays of a camera have to search for their entries (raster.py);
those are marched by `march_ray` itself.

Shapes: R rays, K slots per ray, T tets.
"""

from functools import cache
from itertools import permutations, product
from pathlib import Path

import numpy as np
import warp as wp

from ...base.native import LANES_H, native_source
from ...field import SUBTET_COUNT, subtets_of
from .entries import Entries
from .marching import (
    FEWEST_AT_ONCE,
    FILL_SLOTS,
    MIDDLE,
    MOST_PIECES,
    Rays,
    Samples,
    march_ray,
)
from .pose import Geometry
from .traversal import ENTRY_SLACK, MAX_TETS, SMALLEST_ADVANCE

SIDE = 4  # cubes of the lattice along an edge of a tet, whose halves are the sub-tets
ORDERS = 8  # of a point's fractions in its cube: three comparisons


@cache
def lattice_paths():
    """The sub-tet of each cube c of the lattice and order of fractions f in it.

    [64 · 8] int32; the place is (16 c2 + 4 c1 + c0) · 8 + [f0 >= f1] + 2 [f0 >= f2] + 4 [f1 >= f2].
    Places of no point of a tet hold 0.
    """
    paths = np.zeros(SIDE**3 * ORDERS, np.int32)
    for cell, ranks in product(product(range(SIDE), repeat=3), permutations((0.2, 0.5, 0.8))):
        x = (np.array(cell) + ranks) / SIDE
        if not x[0] >= x[1] >= x[2]:
            continue
        order = (ranks[0] > ranks[1]) + 2 * (ranks[0] > ranks[2]) + 4 * (ranks[1] > ranks[2])
        bary = np.array([[1.0 - x[0], x[0] - x[1], x[1] - x[2], x[2]]])
        place = ((cell[2] * SIDE + cell[1]) * SIDE + cell[0]) * ORDERS + order
        paths[place] = subtets_of(bary)[0]
    return paths


@wp.func_native(
    native_source(
        Path(__file__).parent / "cpu_march.cpp",
        [LANES_H],
        {
            "ENTRY_SLACK": f"{float(ENTRY_SLACK)}f",
            "MAX_TETS": int(MAX_TETS),
            "MOST_PIECES": f"{float(MOST_PIECES)}f",
            "FEWEST_AT_ONCE": f"{float(FEWEST_AT_ONCE)}f",
            "SMALLEST_ADVANCE": f"{float(SMALLEST_ADVANCE)}f",
            "SUBTET_COUNT": SUBTET_COUNT,
        },
    )
)
def march_native(
    geometry: Geometry,
    entries: Entries,
    occupancy: wp.array(dtype=wp.uint64),
    rays: Rays,
    alive: wp.array(dtype=int),
    first: int,
    ray_count: int,
    step: float,
    slot_count: int,
    paths: wp.array(dtype=int),
    densities: wp.array(dtype=float),
    transmittance: wp.array(dtype=float),
    stop: float,
    samples: Samples,
    counts: wp.array(dtype=int),
): ...


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
    paths: wp.array(dtype=int),  # `lattice_paths`
    densities: wp.array(dtype=float),  # [64 T] expected σ of sub-tets
    transmittance: wp.array(dtype=float),  # [R]
    stop: float,  # transmittance below which a ray ends
    samples: Samples,  # out: [count · K]
    counts: wp.array(dtype=int),  # [count] out: samples of each ray
):
    """`march_ray` for alive[first], ..., to where each is expected to end."""
    searching = entries.count.shape[0] == 0
    if not searching:
        march_native(
            geometry,
            entries,
            occupancy,
            rays,
            alive,
            first,
            count,
            step,
            slot_count,
            paths,
            densities,
            transmittance,
            stop,
            samples,
            counts,
        )
    i = int(0)
    while i < count:
        if searching or counts[i] < 0:
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
                True,
            )
        i += 1
