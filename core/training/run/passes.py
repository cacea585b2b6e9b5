"""The march of a batch: entries, one pass that counts samples, and one that writes them.

Slots for all that a ray may have would take a gigabyte, so the second pass repeats the first.  Both
have the ray's entries from one search of the boundary.  As in render/rounds/slot_march.py, the few
rays that have to search along the way go in launches of their own: without the search a kernel
takes fewer registers, and a GPU runs more rays at once.

Shapes: R rays, N samples, T tets.
"""

import warp as wp

from ...render import (
    ANY_DEPTH,
    COUNT,
    UNKNOWN,
    WRITE,
    Entries,
    Geometry,
    Rays,
    Samples,
    find_entries,
    march_ray,
)

FINISHED = wp.constant(-2)  # as the tet of a ray
MAX_RAY_SAMPLES = wp.constant(2048)  # beyond, a ray is cut off; √3/Δ and one a tet are far fewer
BLOCK_SIZE = 128  # threads; in larger blocks more of them wait for the longest ray

wp.set_module_options({"enable_backward": False, "max_unroll": 2, "block_dim": BLOCK_SIZE})


@wp.kernel
def entries_kernel(geometry: Geometry, rays: Rays, entries: Entries):
    """Find the entries of the rays in use; Pose.refresh_face_boxes comes before."""
    i = wp.tid()
    if rays.tet[i] > FINISHED:
        find_entries(geometry, rays.origins[i], rays.directions[i], i, entries)


@wp.func
def march_pass(
    geometry: Geometry,
    entries: Entries,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    rays: Rays,
    i: int,
    step: float,  # Δ
    seed: int,
    purpose: int,  # COUNT or WRITE
    ends: wp.array(dtype=int),  # [R] WRITE: inclusive scan of counts
    samples: Samples,  # [N] WRITE: out
    counts: wp.array(dtype=int),  # [R] COUNT: out; WRITE: in
    searches: bool,  # see next_entry
):
    """Count or write the samples of ray i; WRITE with the same seed repeats COUNT."""
    first = int(0)
    limit = int(MAX_RAY_SAMPLES)
    if purpose == WRITE:
        first = ends[i] - counts[i]
        limit = counts[i]
    entries.next[i] = 0
    count = march_ray(
        geometry,
        entries,
        occupancy,
        rays,
        i,
        step,
        seed,
        purpose,
        first,
        1,
        limit,
        samples,
        samples.length,
        ANY_DEPTH,
        searches,
    )
    if purpose == COUNT:
        counts[i] = count


@wp.kernel
def march_known_kernel(
    geometry: Geometry,
    entries: Entries,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    rays: Rays,
    step: float,  # Δ
    seed: wp.array(dtype=int),  # [1]
    purpose: int,  # COUNT or WRITE
    ends: wp.array(dtype=int),  # [R]
    samples: Samples,  # [N]
    counts: wp.array(dtype=int),  # [R]
):
    """A pass of the rays whose entries are known."""
    i = wp.tid()
    if rays.tet[i] > FINISHED and entries.count[i] != UNKNOWN:
        march_pass(
            geometry,
            entries,
            occupancy,
            rays,
            i,
            step,
            seed[0],
            purpose,
            ends,
            samples,
            counts,
            False,
        )
    elif rays.tet[i] == FINISHED and purpose == COUNT:
        counts[i] = 0


@wp.kernel
def march_unknown_kernel(
    geometry: Geometry,
    entries: Entries,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    rays: Rays,
    step: float,  # Δ
    seed: wp.array(dtype=int),  # [1]
    purpose: int,  # COUNT or WRITE
    ends: wp.array(dtype=int),  # [R]
    samples: Samples,  # [N]
    counts: wp.array(dtype=int),  # [R]
):
    """A pass of the rays that search for their entries."""
    i = wp.tid()
    if rays.tet[i] > FINISHED and entries.count[i] == UNKNOWN:
        march_pass(
            geometry,
            entries,
            occupancy,
            rays,
            i,
            step,
            seed[0],
            purpose,
            ends,
            samples,
            counts,
            True,
        )
