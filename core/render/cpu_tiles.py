"""Tiles of an image on a CPU: a thread renders one after the other, in memory that it keeps.

A tile takes three launches, each of one thread: begin (rays, where they enter the mesh), trace
(rounds/cpu.py), finish (colors and depths).  What Python does between them is what many cores wait
for, because only one thread runs it at a time.

Shapes: R rays, at most as many as the memory has room for.
"""

import warp as wp

from ..base.native import MOST_LANES
from .rays.approach import ASIDE, PARALLEL
from .rays.camera import DeviceCamera, camera_ray
from .rays.entries import MOST_ENTRIES, UNKNOWN, empty_entries
from .rays.marching import Rays, empty_rays
from .rays.pose import Geometry
from .rays.raster import raster_native
from .rays.traversal import orientation
from .rounds.compositing import Pixels, empty_pixels, ray_sums, to_bytes
from .rounds.cpu import TraceMemory

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.kernel
def begin_kernel(
    camera: DeviceCamera,
    first_pixel: int,  # of ray 0
    count: int,
    has_rays: int,  # 1: origins and directions are there already
    geometry: Geometry,
    rectangles: wp.array(dtype=wp.vec4i),  # [B] `bounding_rectangles`; empty: rays have to search
    rays: Rays,  # [R] out
    pixels: Pixels,  # [R] out
    by_component: wp.array(dtype=float),  # [6 (R + lanes)] room
    exits: wp.array(dtype=int),  # [R] room
    alive: wp.array(dtype=int),  # [R] out: the rays that may meet something
    alive_count: wp.array(dtype=int),  # [1] out
):
    """Begin the rays of some pixels, by one thread."""
    width = camera.lens.width
    entries = rays.entries
    known = rectangles.shape[0] > 0
    ray = int(0)
    while ray < count:
        if has_rays == 0:
            pixel = first_pixel + ray
            origin, direction = camera_ray(camera, pixel % width, pixel / width)
            if wp.min(wp.abs(direction)) < wp.static(PARALLEL):
                origin += wp.static(wp.vec3(*ASIDE))
            rays.origins[ray] = origin
            rays.directions[ray] = direction
        rays.t[ray] = 0.0
        rays.tet[ray] = -1
        rays.entry_face[ray] = -1
        rays.piece[ray] = 0
        entries.count[ray] = wp.where(known, 0, wp.static(int(UNKNOWN)))
        entries.next[ray] = 0
        exits[ray] = 0
        pixels.color[ray] = wp.vec3(0.0, 0.0, 0.0)
        pixels.depth[ray] = 0.0
        pixels.transmittance[ray] = 1.0
        pixels.tet[ray] = -1
        pixels.sample_count[ray] = 0
        ray += 1
    if known:
        facing = orientation(geometry)
        raster_native(
            geometry, rectangles, facing, width, first_pixel, count, rays, by_component, exits
        )
    left = int(0)
    ray = int(0)
    while ray < count:
        found = entries.count[ray]
        if found != exits[ray] or found > wp.static(int(MOST_ENTRIES)):
            found = wp.static(int(UNKNOWN))
            entries.count[ray] = found
        if found != 0:
            alive[left] = ray
            left += 1
            if pixels.sums.shape[0] > 0:
                pixels.sums[ray] = ray_sums()
        ray += 1
    alive_count[0] = left


@wp.kernel
def finish_kernel(
    pixels: Pixels,  # [R]
    skipped: wp.array(dtype=float),  # [R] of each ray's beginning, or empty
    background: wp.vec3,
    tet_ids: wp.array(dtype=int),  # [K] old ids of the visible tets
    first: int,  # pixel of the image that ray 0 is of
    color: wp.array(dtype=wp.vec4ub),  # out, as in Image; each of the whole image
    depth: wp.array(dtype=float),  # out
    tet: wp.array(dtype=int),  # out, or empty
    samples: wp.array(dtype=int),  # out, or empty
):
    """Colors and depths of a tile's rays."""
    ray = wp.tid()
    pixel = first + ray
    left = pixels.transmittance[ray]
    t = pixels.depth[ray] / wp.max(1.0 - left, 1.0e-6)
    if skipped.shape[0] > 0:
        t += skipped[ray]
    color[pixel] = to_bytes(pixels.color[ray] + left * background, 1.0 - left)
    depth[pixel] = wp.where(left > 0.5, wp.inf, t)
    if tet.shape[0] > 0:
        inside = pixels.tet[ray]
        tet[pixel] = wp.where(inside < 0, -1, tet_ids[wp.max(inside, 0)])
        samples[pixel] = pixels.sample_count[ray]


class TileMemory:
    """What the tiles of one thread are rendered in, one after the other."""

    def __init__(self, capacity: int, deferred: bool):
        """Have room for so many rays, which sum features instead of colors if `deferred`."""
        self.capacity = capacity
        self.rays = empty_rays(capacity, "cpu")
        self.rays.entries = empty_entries(capacity, "cpu")
        self.pixels = empty_pixels(capacity, "cpu", deferred)
        self.trace = TraceMemory(capacity)
        self._exits = wp.empty(capacity, dtype=int, device="cpu")
        self._by_component = wp.empty(6 * (capacity + MOST_LANES), dtype=float, device="cpu")
        self._count = wp.empty(1, dtype=int, device="cpu")
        self._no_ids = wp.empty(0, dtype=int, device="cpu")
        self._no_numbers = wp.empty(0, dtype=float, device="cpu")

    def begin(self, camera: DeviceCamera, first_pixel, count, geometry, rectangles, rays=None):
        """Begin the rays of the pixels first_pixel, ...; returns the number of `alive` ones.

        Args:
            rectangles: Of faces, as `bounding_rectangles` has them, a wp.array; perhaps empty.
            rays: Origins and directions [count, 3], if they are not the camera's.
        """
        if rays is not None:
            self.rays.origins.numpy()[:count], self.rays.directions.numpy()[:count] = rays
        inputs = [camera, first_pixel, count, int(rays is not None), geometry, rectangles]
        outputs = [self.rays, self.pixels, self._by_component, self._exits]
        outputs += [self.trace.alive, self._count]
        wp.launch(begin_kernel, 1, inputs, outputs, device="cpu")
        return int(self._count.numpy()[0])

    def finish(self, count, background, tet_ids, first, image: dict, skipped=None) -> None:
        """Write `count` pixels of an image, from the pixel `first` on.

        Args:
            image: Arrays of all pixels: color, depth, and perhaps tet and samples.
            skipped: t of the rays' beginnings [count] float32, or None: 0.
        """
        skips = self._no_numbers
        if skipped is not None:
            skips = wp.array(skipped, dtype=float, device="cpu")
        inputs = [self.pixels, skips, wp.vec3(*background), tet_ids, first]
        details = [image.get(name, self._no_ids) for name in ("tet", "samples")]
        outputs = [image["color"], image["depth"], *details]
        wp.launch(finish_kernel, count, inputs, outputs, device="cpu")
