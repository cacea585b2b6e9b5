"""The march of many rays on a CPU, by one thread: rays side by side in the lanes of vectors.

`march_ray` defines the result.  For most rays of a camera, raster.py finds the entries; the few
others search for theirs, and `march_ray` itself marches them.

Shapes: R rays, K slots per ray, T tets.
"""

from functools import cache
from itertools import permutations, product
from pathlib import Path

import numpy as np
import warp as wp

from ...base.native import LANES_H, native_source
from ...definition.subdivision import child_path
from ...field import SUBTET_COUNT
from .marching import FEWEST_AT_ONCE, MOST_PIECES, Rays, Round, march_ray
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
        paths[place] = child_path(bary, levels=2)[0]
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
            "PATHS": ", ".join(map(str, lattice_paths())),
        },
    )
)
def march_native(
    geometry: Geometry,
    rays: Rays,
    round: Round,
    transmittance: wp.array(dtype=float),
    stop: float,
): ...


@wp.func
def march_some(
    geometry: Geometry,
    rays: Rays,
    round: Round,  # samples and counts are out
    transmittance: wp.array(dtype=float),  # [R]
    stop: float,  # transmittance below which a ray ends
):
    """`march_ray` for the rays of a round, to where each is expected to end."""
    searching = rays.entries.count.shape[0] == 0
    if not searching:
        march_native(geometry, rays, round, transmittance, stop)
    k = round.slot_count
    i = int(0)
    while i < round.ray_count:
        if searching or round.counts[i] < 0:
            ray = round.alive[round.first + i]
            depth = wp.log(transmittance[ray] / stop)
            round.counts[i] = march_ray(
                geometry, rays, ray, round.samples, i * k, 1, k, depth_left=depth
            )
        i += 1
