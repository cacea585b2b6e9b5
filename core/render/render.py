"""Rays to an image of the mesh in its current shape, on the CPU and on CUDA.

Rounds of: march (at most K pieces per ray) -> pack -> encode and evaluate -> accumulate,
until every ray has left the mesh or sees nothing more.  On the CPU, tiles of the image go
to a pool of threads (a Warp launch there uses one core, and releases the interpreter).  On
CUDA default mode has rounds of its own, which nothing waits for (wavefront.py).

Where the mesh overlaps itself, the rays that see it are rendered by layers.py.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import warp as wp

from ..device import thread_count
from ..field import TetField
from .overlap import Layers, Overlap
from .rays import (
    FILL_SLOTS,
    MIDDLE,
    Camera,
    FaceBoxes,
    Pose,
    camera_rays_kernel,
    device_camera,
    empty_rays,
    empty_samples,
    march_kernel,
    pack_kernel,
)
from .render_options import RenderOptions, checked
from .rounds import accumulate_kernel, empty_pixels, resolve_kernel
from .shading import Shading
from .stages import Stages
from .visible import visible_part

CPU_TILE_RAYS = 8192  # many for each launch, few enough for all cores to have some
CUDA_TILE_RAYS = 1 << 20
WAVEFRONT_PIXELS = 1 << 16  # a wavefront has room for a multiple of these
ROUND_SLOTS = (4, 4, 4, 4, 8, 8, 16, 32, 64, 128)  # most rays end after some 12 samples

wp.set_module_options({"enable_backward": False})


@dataclass
class Image:
    """A rendered image on the renderer's device.

    Attributes:
        color: RGB over the background, alpha = opacity; row 0 is the top.  [H, W] vec4ub
        depth: Distance along the unit ray, inf where opacity < 0.5.  [H, W] float32
        sample_count: Samples that were evaluated.
        tet: With `details`: the tet where transmittance passes ½, or -1.  [H, W] int32
        samples: With `details`: samples that were evaluated for each pixel.  [H, W] int32
    """

    color: wp.array
    depth: wp.array
    sample_count: int
    tet: wp.array | None = None
    samples: wp.array | None = None

    def color_array(self):
        """uint8 [H, W, 4]"""
        return self.color.numpy()

    def depth_array(self):
        """float32 [H, W]"""
        return self.depth.numpy()


@wp.kernel
def count_up_kernel(values: wp.array(dtype=int)):
    i = wp.tid()
    values[i] = i


@wp.kernel
def old_ids_kernel(
    tet_ids: wp.array(dtype=int),  # [K] of the visible part
    tets: wp.array(dtype=int),  # [R] -1: none
    old_ids: wp.array(dtype=int),  # [R] out
):
    i = wp.tid()
    old_ids[i] = wp.where(tets[i] < 0, -1, tet_ids[wp.max(tets[i], 0)])


class Renderer:
    """Renders one field in a pose that changes: `set_vertices`, then `render`.

    Attributes:
        part: What can be seen of the field: fewer tets, in another order.
        pose: Of that part.
        shading: Of that part.
    """

    def __init__(self, field: TetField, device="cpu", part_of=visible_part):
        """Upload what is needed.

        Args:
            part_of: Chooses the tets that are worth a ray's time, as visible_part does.
        """
        self.field = field
        self.device = wp.get_device(device)
        self.stage = Stages(self.device)  # stage(name) times what happens within
        self.part, tet_ids = part_of(field)
        mesh, neighbours = self.part.mesh, self.part.neighbours
        self._tet_ids = wp.array(tet_ids, dtype=int, device=self.device)
        self.pose = Pose(mesh, neighbours, self.device)
        self.shading = Shading(self.part, self.pose.geometry.rotations, self.device)
        self._occupancy = wp.array(self.part.occupancy, dtype=wp.uint64, device=self.device)
        self._boxes = FaceBoxes(self.pose)
        self._overlap = Overlap(mesh, neighbours, self.pose, self._boxes)
        self._layers = Layers(self.pose, self._occupancy)
        self._all_rays = wp.empty(0, dtype=int, device=self.device)
        self._wavefront = None
        self._middle = wp.full(1, MIDDLE, dtype=int, device=self.device)
        if not self.device.is_cuda:
            self._pool = ThreadPoolExecutor(thread_count())

    @property
    def stage_seconds(self):
        """None, or a dict that collects seconds per stage; then every image is waited for."""
        return self.stage.seconds

    @stage_seconds.setter
    def stage_seconds(self, seconds):
        self.stage.ask(seconds)

    def set_vertices(self, vertices):
        """Take the current positions: [V, 3] array, or wp.array of vec3 on the device."""
        with self.stage("pose"):
            self.pose.set_vertices(vertices)

    def tangle(self):
        """What the mesh overlaps with in its present pose: overlap.Tangle, false if nothing."""
        return self._overlap.tangle()

    def render(self, camera: Camera, options: RenderOptions | None = None, rows=None) -> Image:
        """Render the rows first..last-1 (all by default) as `camera` sees them.

        Args:
            camera: Its world is model space.
            rows: (first, last) for a strip of the image.

        Returns:
            An Image of last - first rows.
        """
        options = checked(options, self.field.layout.level_count)
        first, last = rows or (0, camera.height)
        first_pixel, count = first * camera.width, (last - first) * camera.width
        shape = (last - first, camera.width)
        if self._has_slots(options):
            image = self._render_wavefront(camera, options, (first, last), shape)
            self.stage.collect()
            return image
        image = {
            "color": wp.empty(count, dtype=wp.vec4ub, device=self.device),
            "depth": wp.empty(count, dtype=float, device=self.device),
        }
        if options.details:
            image["tet"] = wp.empty(count, dtype=int, device=self.device)
            image["samples"] = wp.empty(count, dtype=int, device=self.device)
        tile_rays = CUDA_TILE_RAYS if self.device.is_cuda else CPU_TILE_RAYS
        self._prepare(options)
        tiles = [(a, min(a + tile_rays, count)) for a in range(0, count, tile_rays)]
        work = partial(self._render_tile, camera, options, first_pixel, image)
        if self.device.is_cuda:
            sample_count = sum(map(work, tiles))
        else:
            from threadpoolctl import threadpool_limits

            with threadpool_limits(1, user_api="blas"):  # the tiles are the parallelism
                sample_count = sum(self._pool.map(work, tiles))
        image = {name: array.reshape(shape) for name, array in image.items()}
        self.stage.collect()
        return Image(**image, sample_count=sample_count)

    def render_rays(self, origins, directions, options=None):
        """Render rays given one by one, without rounding to bytes.

        Args:
            origins, directions: Model space, directions of length one.  [R, 3]

        Returns:
            color [R, 3] over the background, opacity [R], depth [R] (0 without opacity),
            float32 arrays.
        """
        options = checked(options, self.field.layout.level_count)
        self._prepare(options)
        count = len(origins)
        rays = empty_rays(count, self.device)
        rays.origins.assign(np.ascontiguousarray(origins, np.float32))
        rays.directions.assign(np.ascontiguousarray(directions, np.float32))
        pixels, _ = self._accumulate(rays, count, options)
        transmittance = pixels.transmittance.numpy()
        self.stage.collect()
        opacity = 1.0 - transmittance
        color = pixels.color.numpy() + transmittance[:, None] * np.float32(options.background)
        return color, opacity, pixels.depth.numpy() / np.maximum(opacity, 1e-6)

    def _has_slots(self, options) -> bool:
        """Whether a wavefront renders the image."""
        allowed = options.path == "auto" and options.half and not options.details
        return allowed and self.shading.evaluate_slots is not None

    def _render_wavefront(self, camera, options, rows, shape):
        count = shape[0] * shape[1]
        from .rounds import Wavefront  # whose kernels only CUDA needs

        if self._wavefront is None or self._wavefront.capacity < count:
            self._wavefront = None  # its memory first
            room = -(-count // WAVEFRONT_PIXELS) * WAVEFRONT_PIXELS  # a window grows bit by bit
            self._wavefront = Wavefront(
                self.pose, self._boxes, self._occupancy, self.shading, self.field.options, room
            )
        with self.stage("overlap"):
            self._overlap.seek()
        wavefront = self._wavefront
        sample_count = wavefront.render(device_camera(camera), rows, options, self.stage)
        with self.stage("overlap"):
            tangle = self.tangle()
        if tangle:
            sample_count += self._mend(wavefront, count, options)
        color, depth = wp.clone(wavefront.color[:count]), wp.clone(wavefront.depth[:count])
        return Image(color.reshape(shape), depth.reshape(shape), sample_count)

    def _mend(self, wavefront, count, options) -> int:
        """Render tangled rays again, which the wavefront got wrong."""
        self._prepare(options)
        with self.stage("layers"):
            _, tangled = self._overlap.sort_rays(wavefront.rays, count)
            if not len(tangled):
                return 0
            sample_count = self._render_layers(wavefront.rays, tangled, wavefront.pixels, options)
            self._launch(
                resolve_kernel,
                len(tangled),
                [wavefront.pixels, tangled, wp.vec3(*options.background)],
                [wavefront.color, wavefront.depth],
            )
        return sample_count

    def _prepare(self, options):
        """Look for overlap, and get ready for it."""
        with self.stage("overlap"):
            tangle = self.tangle()
        if tangle or options.path == "merge":
            self._layers.prepare()
            self._boxes.refresh()

    def _render_tile(self, camera, options, first_pixel, image, tile) -> int:
        count = tile[1] - tile[0]
        image = {name: array[tile[0] : tile[1]] for name, array in image.items()}
        rays = empty_rays(count, self.device)
        self._launch(
            camera_rays_kernel,
            count,
            [device_camera(camera), first_pixel + tile[0]],
            [rays.origins, rays.directions],
        )
        pixels, sample_count = self._accumulate(rays, count, options)
        self._launch(
            resolve_kernel,
            count,
            [pixels, self._all_rays, wp.vec3(*options.background)],
            [image["color"], image["depth"]],
        )
        if options.details:
            self._launch(old_ids_kernel, count, [self._tet_ids, pixels.tet], [image["tet"]])
            wp.copy(image["samples"], pixels.sample_count)
        return sample_count

    def _accumulate(self, rays, count, options):
        pixels = empty_pixels(count, self.device)
        alive = wp.empty(count, dtype=int, device=self.device)
        sample_count, round_ = 0, 0
        if self.tangle() or options.path == "merge":
            if options.path == "merge":
                self._launch(count_up_kernel, count, [], [alive])
                alive, tangled = alive[:0], alive
            else:
                alive, tangled = self._overlap.sort_rays(rays, count)
            count = len(alive)
            if len(tangled):
                with self.stage("layers"):
                    sample_count += self._render_layers(rays, tangled, pixels, options)
        else:
            self._launch(count_up_kernel, count, [], [alive])
        while count > 0:
            slot_count = ROUND_SLOTS[min(round_, len(ROUND_SLOTS) - 1)]
            with self.stage("march"):
                samples, counts, ends, packed_count = self._march(
                    *(rays, alive, count, slot_count, options.step_factor)
                )
            sigma, rgb = self.shading.shade(
                *(rays, alive, counts, ends, samples, packed_count, options, self.stage)
            )
            with self.stage("accumulate"):
                still_alive = wp.empty(count, dtype=int, device=self.device)
                still_alive_count = wp.zeros(1, dtype=int, device=self.device)
                self._launch(
                    accumulate_kernel,
                    count,
                    [
                        *(sigma, rgb, samples.length, samples.t, samples.tet),
                        *(alive, counts, ends, rays.tet, options.stop),
                        *(int(not options.conformance), pixels, still_alive, still_alive_count),
                    ],
                )
                sample_count += packed_count
                count = int(still_alive_count.numpy()[0])
            alive, round_ = still_alive, round_ + 1
        return pixels, sample_count

    def _render_layers(self, rays, tangled, pixels, options):
        def shade(samples, alive, counts, ends, count):
            unasked = Stages(self.device)  # the stage "layers" has it all
            return self.shading.shade(rays, alive, counts, ends, samples, count, options, unasked)

        step = self.field.options.march_step * options.step_factor
        return self._layers.render(rays, tangled, step, pixels, shade)

    def _march(self, rays, alive, count, slot_count, step_factor):
        slots = empty_samples(count * slot_count, self.device)
        counts = wp.empty(count, dtype=int, device=self.device)
        ends = wp.empty(count, dtype=int, device=self.device)
        step = self.field.options.march_step * step_factor
        self._launch(
            march_kernel,
            count,
            [
                *(self.pose.geometry, self._occupancy, rays, alive, step, slot_count),
                *(self._middle, FILL_SLOTS, ends),
            ],
            [slots, counts],
        )
        wp.utils.array_scan(counts, ends, inclusive=True)
        packed_count = int(ends[count - 1 : count].numpy()[0])
        packed = empty_samples(packed_count, self.device)
        self._launch(pack_kernel, count, [slots, counts, ends, slot_count], [packed])
        return packed, counts, ends, packed_count

    def _launch(self, kernel, dim, inputs, outputs=()):
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self.device)
