"""The samples of a batch of rays, in arrays on the device that are allocated once.

A march counts samples, then writes them in a second pass that repeats the first, because slots for
all samples that a ray may have would take a gigabyte.  Both passes use the ray's entries from one
search of the boundary.  The arrays have a fixed capacity, so no launch waits for the host, and a
CUDA graph can record them.  If a ray's samples don't fit, the step ignores that ray (`fits`).
Unused places have tet = -1.

Shapes: R rays, N samples or places for them, T tets.
"""

import numpy as np
import torch
import warp as wp

from ...field import CONSTANT_BASIS, basis_of, basis_vector
from ...render import (
    COUNT,
    WRITE,
    Geometry,
    Pose,
    Rays,
    RaySamples,
    basis_kernel,
    empty_entries,
    empty_rays,
    empty_samples,
    find_entries,
    march_ray,
)
from ..data.raybank import NO_LIMIT, RayBank, empty_drawn

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
    found: RaySamples,  # COUNT: counts are out; WRITE: samples are
):
    """Count or write the samples of each ray; WRITE with the same seed repeats COUNT."""
    i = wp.tid()
    first = int(0)
    limit = int(MAX_RAY_SAMPLES)
    if limits[i] < NO_LIMIT:
        limit = limits[i]
    if purpose == WRITE:
        first = found.ends[i] - found.counts[i]
        limit = found.counts[i]
    rays.entries.next[i] = 0
    count = march_ray(
        geometry, rays, i, found.samples, first, 1, limit, seed=seed[0], purpose=purpose
    )
    if purpose == COUNT:
        found.counts[i] = count


@wp.kernel
def fit_kernel(
    ends: wp.array(dtype=int),  # [R] inclusive scan of counts
    tets: wp.array(dtype=int),  # [R] where rays begin, -2 for those that are not in use
    capacity: int,  # N
    counts: wp.array(dtype=int),  # [R] in, out: 0 for rays that don't fit
    fits: wp.array(dtype=float),  # [R] out: 1 or 0
    sample_count: wp.array(dtype=int),  # [1] out: samples of the rays that fit
):
    i = wp.tid()
    if i == 0 and ends[0] > capacity:
        sample_count[0] = 0
    fits[i] = 0.0
    if ends[i] <= capacity:
        fits[i] = wp.where(tets[i] > -2, 1.0, 0.0)
        is_last = i == ends.shape[0] - 1
        if not is_last:
            is_last = ends[i + 1] > capacity
        if is_last:
            sample_count[0] = ends[i]
    else:
        counts[i] = 0


@wp.kernel
def mark_unused_kernel(sample_count: wp.array(dtype=int), sample_tet: wp.array(dtype=int)):
    n = wp.tid()
    if n >= sample_count[0]:
        sample_tet[n] = -1


@wp.kernel
def ray_basis_kernel(
    directions: wp.array(dtype=wp.vec3),  # [R]
    basis: wp.array(dtype=basis_vector),  # [R] out
):
    i = wp.tid()
    basis[i] = basis_of(directions[i])


class Batch:
    """R rays and space for their samples.

    Attributes:
        samples: Samples of all rays that fit, without gaps, then tet = -1.  [N]
        origins, directions, rgba, background, views, pixels: The same as torch tensors.
        counts, ends: Number of each ray's samples, and its inclusive scan.  [R]
        drawn: The rays, and the colors that they should see.
        basis: Spherical harmonics of the samples' directions; None without `harmonics`.
            torch [N, 16]
        fits: 1 where a ray is in use and its samples fit, else 0.  A step may leave out more, see
            sample_limits.py.  torch [R]
        tries: See Drawn.  torch [R]
        learned: What the step finds out about the limits of the rays' pixels, see
            sample_limits.py.  [R] int
        sample_count: Number of samples.  wp int [1]
        mask: The occupancy that its rays are marched through; None is the field's at that time.
    """

    def __init__(self, ray_count: int, capacity: int | None, device, first_ray=0, harmonics=True):
        """`capacity` None makes space for what each march finds, and waits for the device.

        `first_ray` is the number of ray 0, see Drawn.  With one color a ray, samples need no
        `harmonics`: see `ray_basis`.
        """
        self.device = device
        self.capacity = capacity
        self._rays = empty_rays(ray_count, device)
        self._rays.first = first_ray
        self._rays.entries = empty_entries(ray_count, device)
        self._used = ray_count
        self.drawn = empty_drawn(ray_count, device)
        self.drawn.origins, self.drawn.directions = self._rays.origins, self._rays.directions
        self.drawn.first = first_ray
        self.origins = wp.to_torch(self.drawn.origins)
        self.directions = wp.to_torch(self.drawn.directions)
        self.rgba = wp.to_torch(self.drawn.rgba)
        self.background = wp.to_torch(self.drawn.background)
        self.views = wp.to_torch(self.drawn.views)
        self.pixels = wp.to_torch(self.drawn.pixels)
        self.tries = wp.to_torch(self.drawn.tries)
        self.seed = wp.zeros(1, dtype=int, device=device)
        self.counts = wp.zeros(ray_count, dtype=int, device=device)
        self.ends = wp.zeros(ray_count, dtype=int, device=device)
        self._found = RaySamples()
        self._found.ids = wp.array(np.arange(ray_count), dtype=int, device=device)
        self._found.counts, self._found.ends = self.counts, self.ends
        self._fits = wp.zeros(ray_count, dtype=float, device=device)
        self.fits = wp.to_torch(self._fits)
        self.learned = wp.zeros(ray_count, dtype=int, device=device)
        self.sample_count = wp.zeros(1, dtype=int, device=device)
        self.mask = None
        self._harmonics, self.basis = harmonics, None
        if capacity is not None:
            self._make_space(capacity)

    @property
    def ray_count(self) -> int:
        return len(self.counts)

    def use(self, count: int):
        """Use the first rays only; the others have no samples and don't fit."""
        if count != self._used:
            begins = wp.to_torch(self._rays.tet)
            begins[:count].fill_(-1)
            begins[count:].fill_(-2)
            self._used = count

    def march(self, pose: Pose, mask, step: float, view_dependence=True):
        """Find the samples of the rays, jittered by `seed`.

        Without `view_dependence` their basis is constant.
        """
        pose.refresh_face_boxes()
        geometry = pose.geometry
        geometry.occupancy, geometry.step = mask, step
        self._launch(entries_kernel, self.ray_count, [geometry, self._rays], [])
        self._march(geometry, COUNT)
        wp.utils.array_scan(self.counts, self.ends, inclusive=True)
        if self.capacity is None:
            self._make_space(int(self.ends[self.ray_count - 1 :].numpy()[0]))
        capacity = len(self.samples.tet)
        self._launch(
            fit_kernel,
            self.ray_count,
            [self.ends, self._rays.tet, capacity],
            [self.counts, self._fits, self.sample_count],
        )
        self._march(geometry, WRITE)
        self._launch(mark_unused_kernel, capacity, [self.sample_count], [self.samples.tet])
        if not self._harmonics:
            return
        if not view_dependence:
            self.basis[:, 0] = CONSTANT_BASIS[0]
            return
        inputs = [self._rays, pose.geometry.rotations, self._found]
        self._launch(basis_kernel, self.ray_count, inputs, [self._basis])

    def ray_basis(self, view_dependence=True):
        """Spherical harmonics of the rays' directions, which at rest are the samples'.  [R, 16]"""
        basis = torch.zeros(self.ray_count, len(CONSTANT_BASIS), device=self.directions.device)
        if not view_dependence:
            basis[:, 0] = CONSTANT_BASIS[0]
            return basis
        outputs = [wp.from_torch(basis, dtype=basis_vector)]
        self._launch(ray_basis_kernel, self.ray_count, [self.drawn.directions], outputs)
        return basis

    def pixels_tried(self):
        """How many pixels were drawn for the rays that the step learns from.  torch []"""
        return (self.fits * self.tries).sum()

    def _march(self, geometry, purpose):
        """A pass over all rays."""
        inputs = [geometry, self._rays, self.seed, purpose, self.drawn.limits, self._found]
        self._launch(march_pass_kernel, self.ray_count, inputs, [])

    def _make_space(self, capacity):
        self.samples = self._found.samples = empty_samples(capacity, self.device)
        for array in (self.samples.bary, self.samples.length, self.samples.t):
            array.zero_()  # the networks read unused places too
        if self._harmonics:
            self._basis = wp.zeros(capacity, dtype=basis_vector, device=self.device)
            self.basis = wp.to_torch(self._basis)

    def _launch(self, kernel, dim, inputs, outputs):
        wp.launch(
            kernel,
            dim=dim,
            inputs=inputs,
            outputs=outputs,
            device=self.device,
            block_dim=kernel.module.options["block_dim"],
        )


def looks(bank: RayBank, device, most: int, size: int):
    """Batches of `size` rays through all training pixels, or through `most` random ones."""
    seed, chosen = wp.zeros(1, dtype=int, device=device), None
    for number, first in enumerate(range(0, min(most, bank.pixel_count), size)):
        if bank.pixel_count <= most:
            pixels = np.arange(first, min(first + size, bank.pixel_count), dtype=np.int32)
            chosen = wp.array(pixels, dtype=int, device=device)
        batch = Batch(size if chosen is None else len(chosen), None, device)
        seed.fill_(number)
        bank.draw(seed, batch.drawn, chosen)
        yield batch
