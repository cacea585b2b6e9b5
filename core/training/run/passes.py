"""The march of a batch: entries, one pass that counts samples, and one that writes them.

Slots for all samples that a ray may have would take a gigabyte, so the second pass repeats the
first.  Both use the ray's entries from one search of the boundary.

Shapes: R rays, N samples, T tets.
"""

import warp as wp

from ...render import (
    COUNT,
    WRITE,
    Geometry,
    Rays,
    Samples,
    find_entries,
    march_ray,
)
from ..data.raybank import NO_LIMIT

MAX_RAY_SAMPLES = wp.constant(2048)  # beyond, a ray is cut off; √3/Δ and one a tet are far fewer
BLOCK_SIZE = 128  # threads; in larger blocks more of them wait for the longest ray

wp.set_module_options({"enable_backward": False, "max_unroll": 2, "block_dim": BLOCK_SIZE})


@wp.kernel
def entries_kernel(geometry: Geometry, rays: Rays):
    """Find the entries of the rays in use; Pose.refresh_face_boxes comes before."""
    i = wp.tid()
    if rays.tet[i] > -2:
        find_entries(geometry, rays.origins[i], rays.directions[i], i, rays.entries, False)


@wp.kernel
def march_pass_kernel(
    geometry: Geometry,
    rays: Rays,
    seed: wp.array(dtype=int),  # [1]
    purpose: int,  # COUNT or WRITE
    limits: wp.array(dtype=int),  # [R] COUNT: samples at most; NO_LIMIT is none
    ends: wp.array(dtype=int),  # [R] WRITE: inclusive scan of counts
    samples: Samples,  # [N] WRITE: out
    counts: wp.array(dtype=int),  # [R] COUNT: out; WRITE: in
):
    """Count or write the samples of each ray; WRITE with the same seed repeats COUNT."""
    i = wp.tid()
    first = int(0)
    limit = int(MAX_RAY_SAMPLES)
    if limits[i] < NO_LIMIT:
        limit = limits[i]
    if purpose == WRITE:
        first = ends[i] - counts[i]
        limit = counts[i]
    rays.entries.next[i] = 0
    count = march_ray(geometry, rays, i, samples, first, 1, limit, seed=seed[0], purpose=purpose)
    if purpose == COUNT:
        counts[i] = count
