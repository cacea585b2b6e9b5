"""Tiles of an image on a CPU: a thread renders one after the other, in memory that it keeps.

A tile's stages are begin (rays, where they enter the mesh), trace (rounds/cpu.py), and finish
(colors and depths).  A thread renders all of its tiles by one launch, which takes the next tile
when one is done: only one thread at a time runs Python, and the others would wait for it.  Where
rays may be tangled or begin elsewhere, and where stages are timed, each stage is launched.

Shapes: R rays, at most as many as the memory has room for.
"""

from dataclasses import dataclass

import warp as wp

from ..base.native import MOST_LANES
from .rays.approach import ASIDE, PARALLEL
from .rays.camera import DeviceCamera, camera_ray
from .rays.entries import MOST_ENTRIES, UNKNOWN, empty_entries
from .rays.marching import Rays, Round, empty_rays
from .rays.pose import Geometry
from .rays.raster import raster_native
from .rays.traversal import orientation
from .rounds.compositing import Pixels, empty_pixels, ray_sums, to_bytes
from .rounds.cpu import NativeShading, TraceMemory, trace

wp.set_module_options({"enable_backward": False, "max_unroll": 2})


@wp.func
def begin(
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
):
    """Begin the rays of some pixels, by one thread; returns how many are alive."""
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
    return left


@wp.func
def finish(
    ray: int,
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
    """Color and depth of a ray."""
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


@wp.kernel
def begin_kernel(
    camera: DeviceCamera,
    first_pixel: int,
    count: int,
    has_rays: int,
    geometry: Geometry,
    rectangles: wp.array(dtype=wp.vec4i),
    rays: Rays,
    pixels: Pixels,
    by_component: wp.array(dtype=float),
    exits: wp.array(dtype=int),
    alive: wp.array(dtype=int),
    alive_count: wp.array(dtype=int),  # [1] out
):
    """As `begin`."""
    alive_count[0] = begin(
        camera,
        first_pixel,
        count,
        has_rays,
        geometry,
        rectangles,
        rays,
        pixels,
        by_component,
        exits,
        alive,
    )


@wp.kernel
def finish_kernel(
    pixels: Pixels,
    skipped: wp.array(dtype=float),
    background: wp.vec3,
    tet_ids: wp.array(dtype=int),
    first: int,
    color: wp.array(dtype=wp.vec4ub),
    depth: wp.array(dtype=float),
    tet: wp.array(dtype=int),
    samples: wp.array(dtype=int),
):
    """As `finish`."""
    finish(wp.tid(), pixels, skipped, background, tet_ids, first, color, depth, tet, samples)


@wp.func_native("return __atomic_fetch_add(next.data, 1, __ATOMIC_RELAXED);")
def take(next: wp.array(dtype=int)) -> int:
    """A number that no other thread gets; the next one."""
    ...


@wp.kernel
def tiles_kernel(
    camera: DeviceCamera,
    starts: wp.array(dtype=int),  # [N + 1] first pixels of the tiles, and the end
    next: wp.array(dtype=int),  # [1] of all threads: the next tile
    geometry: Geometry,
    rectangles: wp.array(dtype=wp.vec4i),
    tet_ids: wp.array(dtype=int),
    background: wp.vec3,
    round_slots: wp.array(dtype=int),
    rays: Rays,  # here and in what follows: a thread's own memory
    pixels: Pixels,
    by_component: wp.array(dtype=float),
    exits: wp.array(dtype=int),
    round: Round,
    shading: NativeShading,
    totals: wp.array(dtype=int),
    none: wp.array(dtype=float),  # empty
    color: wp.array(dtype=wp.vec4ub),  # out, as in Image; each of the whole image
    depth: wp.array(dtype=float),  # out
    tet: wp.array(dtype=int),  # out, or empty
    samples: wp.array(dtype=int),  # out, or empty
    sample_count: wp.array(dtype=int),  # [1] out, of this thread's tiles
):
    """Render tiles, one after the other, by one thread."""
    evaluated = int(0)
    tile = take(next)
    while tile < starts.shape[0] - 1:
        first = starts[tile]
        count = starts[tile + 1] - first
        alive = begin(
            camera,
            first,
            count,
            0,
            geometry,
            rectangles,
            rays,
            pixels,
            by_component,
            exits,
            round.alive,
        )
        evaluated += trace(geometry, rays, round, alive, round_slots, shading, pixels, totals)
        ray = int(0)
        first -= starts[0]
        while ray < count:
            finish(ray, pixels, none, background, tet_ids, first, color, depth, tet, samples)
            ray += 1
        tile = take(next)
    sample_count[0] = evaluated


@dataclass(frozen=True)
class Tiles:
    """An image's tiles, for all threads that render some of them."""

    camera: DeviceCamera
    starts: wp.array  # [N + 1] int: first pixels, and the end
    geometry: Geometry
    rectangles: wp.array  # as `bounding_rectangles` has them.  vec4i
    tet_ids: wp.array  # [K] int: old ids of the visible tets
    image: dict  # arrays of all pixels: color, depth, and perhaps tet and samples
    next: wp.array  # [1] int: the tile that is taken next, 0 at first


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

    def render(self, tiles: "Tiles", options, host_rounds) -> int:
        """Render tiles until all are taken; returns the number of samples."""
        trace, (slots, shading) = self.trace, host_rounds.for_tiles(self.trace, options)
        inputs = [tiles.camera, tiles.starts, tiles.next, tiles.geometry, tiles.rectangles]
        inputs += [tiles.tet_ids, wp.vec3(*options.background), slots, self.rays, self.pixels]
        inputs += [self._by_component, self._exits, trace.round, shading, trace.totals]
        details = [tiles.image.get(name, self._no_ids) for name in ("tet", "samples")]
        outputs = [tiles.image["color"], tiles.image["depth"], *details, self._count]
        wp.launch(tiles_kernel, 1, [*inputs, self._no_numbers], outputs, device="cpu")
        return int(self._count.numpy()[0])

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
