"""Render rays to an image of the mesh in its current shape, on the CPU and on CUDA.

A ray takes one of three paths:

    rounds/wavefront.py    default mode on CUDA: one launch for all rays, or rounds without a host
    rounds/host.py         everything else: rounds of march, shade, accumulate
    overlap/               tangled rays, through places where the mesh overlaps itself:
                           windows.py on a CPU, window_slots.py in a wavefront, else merging.py

Each path marches rays through the mesh (rays/), and computes density and color of the samples
(shading.py).  On the CPU a Warp launch uses one core and releases the interpreter, so a pool of
threads renders tiles of the image.
"""

import io
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from threading import local

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from ..base.device import start_warp, thread_count
from ..base.paths import whole_file
from ..field import TetField, check_finite
from ..geometry import morton_order
from .cpu_tiles import TileMemory, Tiles
from .overlap.merging import PieceMerger
from .overlap.search import Overlap
from .rays.approach import ball_around, begin_at_ball, moved_aside
from .rays.camera import Camera, camera_rays, camera_rays_kernel, device_camera
from .rays.marching import empty_rays
from .rays.pose import Pose
from .rays.raster import bounding_rectangles, row_work
from .render_options import RenderOptions, checked
from .rounds.compositing import empty_pixels, resolve
from .rounds.host import HostRounds
from .shading import Shading
from .stage_timer import StageTimer

CPU_TILE_WORK = 2.0e6  # as `row_work` measures it: much for each launch
CPU_TILES_PER_THREAD = 3  # or more, so that no thread waits long for the others
THREAD_COST = 3.0e4  # of Python for a launch, which runs in one thread at a time; as work
CPU_TILE_RAYS = 1 << 15  # bound what a tile takes of memory
CUDA_TILE_RAYS = 1 << 20
QUALITY = 95  # of pictures in formats with losses
PICTURE_ENDINGS = ".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp"
WAVEFRONT_PIXELS = 1 << 16  # a wavefront holds a multiple of these

wp.set_module_options({"enable_backward": False})


def visible_field(field: TetField) -> tuple[TetField, np.ndarray]:
    """A field without its empty tets: those that have no occupied sub-tet.

    They give the object its solid interior in the dynamics, but rays would only lose time in them:
    without them a ray enters the mesh where the density begins, and leaves it where that ends.
    All vertices stay, so that poses of the field fit it.  One tet stays if all are empty.

    Returns:
        The field, whose tets are sorted along a space-filling curve (Morton's), so that neighbors
        are close in memory; and the old id of each of these tets [K] int32.
    """
    mesh = field.mesh
    seen = field.occupancy != 0
    if not seen.any():
        seen[:1] = True
    ids = np.flatnonzero(seen)
    middles = mesh.rest_vertices[mesh.tets[ids]].mean(axis=1)
    low, high = middles.min(axis=0), middles.max(axis=0)
    ids = ids[morton_order(((middles - low) / np.maximum(high - low, 1e-30) * 1023).astype(int))]
    new_ids = np.full(mesh.tet_count + 1, -1, np.int32)  # the last one is for -1, outside
    new_ids[ids] = np.arange(len(ids), dtype=np.int32)
    layout = replace(field.layout, node_ids=tuple(nodes[ids] for nodes in field.layout.node_ids))
    visible = replace(
        field,
        mesh=replace(mesh, tets=mesh.tets[ids]),
        neighbours=new_ids[field.neighbours[ids]],
        occupancy=field.occupancy[ids],
        layout=layout,
    )
    return visible, ids.astype(np.int32)


@dataclass
class Image:
    """A rendered image on the renderer's device.  Arrays [H, W], row 0 is the top."""

    color: wp.array  # vec4ub: RGB over the background, alpha = opacity
    depth: wp.array  # float32: distance along the unit ray, inf where opacity < 0.5
    sample_count: int  # samples that were evaluated
    tet: wp.array | None = None  # int32, with `details`: where transmittance passes ½, or -1
    samples: wp.array | None = None  # int32, with `details`: samples of each pixel

    def color_array(self) -> np.ndarray:
        """uint8 [H, W, 4]"""
        return self.color.numpy()

    def depth_array(self) -> np.ndarray:
        """float32 [H, W]"""
        return self.depth.numpy()

    def save(self, path: str | Path) -> None:
        """Write the picture, without its opacity, in the format that the path's ending names.

        Raises:
            ValueError: The ending is none of PICTURE_ENDINGS.
            OSError: The file can't be written; one that was there before stays.
        """
        path = Path(path)
        if path.suffix.lower() not in PICTURE_ENDINGS:
            raise ValueError(f"{path}: a picture's name ends in {', '.join(PICTURE_ENDINGS)}")
        with whole_file(path) as partial:
            self._picture().save(partial, quality=QUALITY)

    def _repr_png_(self) -> bytes:
        """What Jupyter shows."""
        stream = io.BytesIO()
        self._picture().save(stream, "PNG")
        return stream.getvalue()

    def _picture(self):
        from PIL import Image as Picture  # a frame of the viewer does without

        return Picture.fromarray(np.ascontiguousarray(self.color_array()[..., :3]))


class Renderer:
    """Renders one field in a pose that changes: `set_vertices`, then `render`.

    Attributes:
        shown: The field without its empty tets: fewer tets, in another order.
        pose, shading: Pose and shading of those tets.
        overlap: `overlap.exists()` says whether the pose overlaps itself.
        stage: Times the stages while `stage.seconds` is a dict; then each image is waited for, and
            no stage runs beside another.  Where an overlap begins, two images count as one.
    """

    def __init__(self, field: TetField, device: str = "cpu"):
        """A ValueError if the field's table, mesh or networks hold NaN or infinite numbers."""
        check_finite(field)
        start_warp()
        self.field = field
        self.device = wp.get_device(device)
        self.stage = StageTimer(self.device)
        self.shown, tet_ids = visible_field(field)
        self._shown_ids = tet_ids  # on the host
        self._tet_ids = wp.array(tet_ids, dtype=int, device=self.device)
        mesh, neighbours = self.shown.mesh, self.shown.neighbours
        self.pose = Pose(mesh, neighbours, self.device)
        self.shading = Shading(self.shown, self.pose.geometry.rotations, self.device)
        self._fill_geometry()
        self.overlap = Overlap(mesh, neighbours, self.pose)
        self.merger = PieceMerger(self.pose, self.shading)
        self.host_rounds = HostRounds(self.pose, self.shading)
        self._wavefront = self._windows = None
        self._threads = thread_count()
        self._pool = None if self.device.is_cuda else ThreadPoolExecutor(self._threads)
        self._memories = local()  # of the pool's threads

    def _fill_geometry(self):
        """Say where there can be density, and how long pieces are."""
        geometry = self.pose.geometry
        geometry.occupancy = wp.array(self.shown.occupancy, dtype=wp.uint64, device=self.device)
        geometry.step = self.field.options.march_step
        if self.device.is_cpu:
            geometry.densities = self.shading.densities

    def set_vertices(self, vertices: ArrayLike | wp.array) -> None:
        """Take the current positions.  [V, 3]

        Args:
            vertices: An array, a list, a torch tensor of any device, or a wp.array of vec3; one
                of float32 on the renderer's device is copied without a detour by the host.

        Raises:
            ValueError: They have another shape or, unless they are a wp.array of vec3, no finite
                numbers; or torch would want gradients of them.
        """
        with self.stage("pose"):
            self.overlap.join()  # a search may still read the pose before, if its image failed
            self.pose.set_vertices(vertices)

    def set_occupancy(self, occupancy: np.ndarray) -> None:
        """Take other masks, of sub-tets that the field's own masks have, too.  [T] uint64"""
        self.pose.geometry.occupancy.assign(occupancy[self._shown_ids])

    def render(
        self,
        camera: Camera,
        options: RenderOptions | None = None,
        rows: tuple[int, int] | None = None,
    ) -> Image:
        """The image, or a strip of it, as `camera` sees the field; its world is model space.

        Args:
            rows: (first, last) for the strip first..last-1.

        Raises:
            TypeError: `camera` is no Camera.
            ValueError: See render_options.checked.
        """
        if not isinstance(camera, Camera):
            raise TypeError(
                f"render takes a Camera, not {type(camera).__name__}: make one with "
                f"from_field_of_view(look_at(eye, target), angle_x, width, height)"
            )
        options = self._checked(options)
        if self.device.is_cuda:
            camera = moved_aside(camera)  # on a CPU each ray is looked at
        fast = self.shading.in_place is not None and options.half
        fast = fast and options.path == "auto" and not options.details
        way = self._render_wavefront if fast else self._render_tiles
        image = way(camera, options, rows or (0, camera.height))
        self.stage.collect()
        return image

    def render_rays(
        self, origins: np.ndarray, directions: np.ndarray, options: RenderOptions | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Render rays given one by one [R, 3] in model space, without rounding to bytes.

        Returns:
            color [R, 3] over the background, opacity [R], depth [R] (0 without opacity),
            float32 arrays.

        Raises:
            ValueError: See render_options.checked.
        """
        options = self._checked(options)
        self._find_overlap(options)
        rays = empty_rays(len(origins), self.device)
        ball = ball_around(self.pose.vertices.numpy())
        *begun, skipped = begin_at_ball(origins, directions, ball)
        rays.origins.assign(begun[0])
        rays.directions.assign(begun[1])
        pixels, _ = self._trace(rays, options)
        transmittance = pixels.transmittance.numpy()
        self.stage.collect()
        opacity = 1.0 - transmittance
        color = pixels.color.numpy() + transmittance[:, None] * np.float32(options.background)
        depth = pixels.depth.numpy() / np.maximum(opacity, 1e-6)
        return color, opacity, depth + np.where(opacity > 0.0, skipped, 0.0)

    def _checked(self, options) -> RenderOptions:
        options = checked(options, self.field.options)
        self.pose.geometry.step = self.field.options.march_step * options.step_factor
        return options

    def _find_overlap(self, options):
        """Prepare sorting and merging, if rays may be tangled."""
        with self.stage("overlap"):
            found = self.overlap.exists() or options.path == "merge"
        if found:
            self.merger.prepare()
            self.overlap.prepare()

    def _trace(self, rays, options):
        """The Pixels of rays, and the number of samples; `_find_overlap` comes before."""
        count = len(rays.origins)
        pixels = empty_pixels(count, self.device, self.field.options.deferred)
        ids = wp.array(np.arange(count), dtype=int, device=self.device)
        return pixels, self._trace_some(rays, ids, pixels, options)

    def _trace_some(self, rays, ids, pixels, options):
        """Add the rays `ids` to the pixels; returns the number of samples."""
        plain, tangled = ids, wp.empty(0, dtype=int, device=self.device)
        if options.path == "merge":
            plain, tangled = tangled, plain
        elif self.overlap.exists():
            plain, tangled = self.overlap.sort_rays(rays, ids)
        sample_count = 0
        if len(tangled):
            with self.stage("merge"):
                sample_count = self.merger.render(rays, tangled, pixels, options)
        return sample_count + self.host_rounds.render(rays, plain, pixels, options, self.stage)

    def _render_tiles(self, camera, options, rows) -> Image:
        shape, device = (rows[1] - rows[0], camera.width), self.device
        color = wp.empty(shape, dtype=wp.vec4ub, device=device)
        image = Image(color, wp.empty(shape, dtype=float, device=device), 0)
        pixels = {"color": image.color.flatten(), "depth": image.depth.flatten()}
        if options.details:
            image.tet = wp.empty(shape, dtype=int, device=device)
            image.samples = wp.empty(shape, dtype=int, device=device)
            pixels |= {"tet": image.tet.flatten(), "samples": image.samples.flatten()}
        render = self._render_cuda_tiles if device.is_cuda else self._render_cpu_tiles
        image.sample_count = render(camera, options, rows, pixels)
        return image

    def _render_cuda_tiles(self, camera, options, rows, image: dict) -> int:
        """As _render_cpu_tiles."""
        self._find_overlap(options)
        first, end = rows[0] * camera.width, rows[1] * camera.width
        sample_count = 0
        for start, stop in pairwise([*range(first, end, CUDA_TILE_RAYS), end]):
            tile = {name: array[start - first : stop - first] for name, array in image.items()}
            sample_count += self._render_tile(camera, options, start, tile)
        return sample_count

    def _render_tile(self, camera, options, first_pixel, tile) -> int:
        count = len(tile["color"])
        rays = empty_rays(count, self.device)
        inputs = [device_camera(camera), first_pixel]
        outputs = [rays.origins, rays.directions]
        wp.launch(camera_rays_kernel, count, inputs, outputs, device=self.device)
        pixels, sample_count = self._trace(rays, options)
        resolve(pixels, options.background, tile["color"], tile["depth"])
        if options.details:
            inputs = [self._tet_ids, pixels.tet]
            wp.launch(old_ids_kernel, count, inputs, [tile["tet"]], device=self.device)
            wp.copy(tile["samples"], pixels.sample_count)
        return sample_count

    def _render_cpu_tiles(self, camera, options, rows, image: dict) -> int:
        """Fill the arrays of `rows`; returns the number of samples."""
        seen, vertices = device_camera(camera), self.pose.vertices.numpy()
        faces = bounding_rectangles(camera, vertices.astype(float), self.pose.boundary_faces)
        rectangles = wp.array(faces, dtype=wp.vec4i, device="cpu")
        ball = ball_around(vertices, camera.position)
        work, row_limit = row_work(camera, faces), max(CPU_TILE_RAYS // camera.width, 1)
        starts = _tile_starts(work, rows, row_limit, self._threads)
        starts = camera.width * np.array(starts, np.int32)
        capacity = int(np.diff(starts).max(initial=0))
        plain = ball is None and options.path != "merge" and self.stage.seconds is None
        # A pose is taken for one like the last one, with overlap or without.
        if plain and not (self.overlap.expected and self.overlap.exists()):
            bounds = wp.array(starts, dtype=int, device="cpu")
            taken = wp.zeros(1, dtype=int, device="cpu")
            tiles = seen, bounds, self.pose.geometry, rectangles, self._tet_ids, image, taken
            sample_count = self._render_plain_tiles(Tiles(*tiles), capacity, options)
            if not self.overlap.exists():
                return sample_count
        self._find_overlap(options)

        def render_tile(span):
            first, count, rays, skipped = span[0], span[1] - span[0], None, None
            memory = self._tile_memory(capacity)
            if ball is not None:
                *rays, skipped = begin_at_ball(*camera_rays(camera, first, count), ball)
            with self.stage("march"):
                memory.begin(seen, first, count, self.pose.geometry, rectangles, rays)
            # A tangled ray may start within tets and graze the boundary unnoticed.
            ids = wp.array(np.arange(count), dtype=int, device="cpu")
            sample_count = self._trace_some(memory.rays, ids, memory.pixels, options)
            start = first - rows[0] * camera.width
            memory.finish(count, options.background, self._tet_ids, start, image, skipped)
            return sample_count

        return sum(self._pool.map(render_tile, pairwise(starts.tolist())))

    def _render_plain_tiles(self, tiles, capacity, options) -> int:
        """Render tiles as if nothing overlapped, and find out meanwhile."""

        def render_some():
            return self._tile_memory(capacity).render(tiles, options, self.host_rounds)

        self.pose.refresh_face_boxes()  # the search may, and rays read them
        used = -(-(len(tiles.starts) - 1) // CPU_TILES_PER_THREAD)
        running = list(map(self._pool.submit, [render_some] * min(used, self._threads)))
        try:
            self.overlap.exists()
        finally:
            wait(running)
        return sum(map(Future.result, running))

    def _tile_memory(self, capacity) -> TileMemory:
        """This thread's memory, for tiles of at most `capacity` rays."""
        memory = getattr(self._memories, "own", None)
        if memory is None or memory.capacity < capacity:
            memory = self._memories.own = TileMemory(capacity, self.field.options.deferred)
        return memory

    def _render_wavefront(self, camera, options, rows) -> Image:
        from .overlap.window_slots import WindowSlots  # kernels that only CUDA needs

        shape = (rows[1] - rows[0], camera.width)
        count = shape[0] * shape[1]
        wavefront = self._wavefront_for(count)
        with self.stage("overlap"):
            self.overlap.search()
            if self.stage.seconds is not None:
                self.overlap.join()  # or its time would count elsewhere
        view = device_camera(camera), rows, options, self.stage
        rays, pixels = wavefront.buffers.rays, wavefront.buffers.pixels
        color, depth = wavefront.buffers.color[:count], wavefront.buffers.depth[:count]

        def copied():
            return Image(wp.clone(color).reshape(shape), wp.clone(depth).reshape(shape), 0)

        # The host does not wait for the search before it launches: a pose is taken for one like
        # the last one, with overlap or without.
        overlaps, image = self.overlap.expected, None
        if not overlaps:
            wavefront.draw(*view)
            image = copied()  # while the device is busy
            overlaps = self.overlap.exists()
        if overlaps:  # the image is begun, perhaps anew
            wavefront.begin(*view)
            self.overlap.join()
            if self._windows is None:  # most models never overlap themselves
                self._windows = WindowSlots(self.pose, wavefront, self.field.options)
            crowded, sample_count = self._windows.render(
                self.overlap.counts, camera.width, shape[0], options, self.stage
            )
            self.overlap.exists()  # for the next pose: by now the answer is there
            if len(crowded):
                with self.stage("merge"):
                    self.merger.prepare()
                    sample_count += self.merger.render(rays, crowded, pixels, options)
                    resolve(pixels, options.background, color, depth, crowded)
            image = copied()
        else:
            sample_count, _, again = wavefront.finish(options, self.stage)
            if again:
                image = copied()
        image.sample_count = sample_count
        return image

    def _wavefront_for(self, count):
        """A wavefront that holds that many pixels: the last one, if it is large enough."""
        from .rounds.wavefront import Wavefront  # kernels that only CUDA needs

        if self._wavefront is None or self._wavefront.capacity < count:
            self._wavefront = self._windows = None  # frees their memory first
            capacity = -(-count // WAVEFRONT_PIXELS) * WAVEFRONT_PIXELS
            self._wavefront = Wavefront(self.pose, self.shading, self.field.options, capacity)
        return self._wavefront


def _tile_starts(row_work, rows, row_limit, most_threads):
    """Rows that tiles with about as much work begin at, and the last tile's end.

    There are so many that equal ones would have at most `row_limit` rows.
    """
    first, last = rows
    done = np.concatenate([[0.0], row_work[first:last].cumsum()])
    # n threads take about n THREAD_COST + work/n.
    threads = min(most_threads, max((done[-1] / THREAD_COST) ** 0.5 // 1, 1.0))
    count = CPU_TILES_PER_THREAD * threads
    count = max(count, np.ceil(done[-1] / CPU_TILE_WORK), np.ceil((last - first) / row_limit), 1.0)
    starts = np.searchsorted(done, done[-1] * np.arange(1, count) / count)
    return sorted({first, last, *(first + starts).tolist()})


@wp.kernel
def old_ids_kernel(
    tet_ids: wp.array(dtype=int),  # [K] of the visible part
    tets: wp.array(dtype=int),  # [R] -1: none
    old_ids: wp.array(dtype=int),  # [R] out
):
    i = wp.tid()
    old_ids[i] = wp.where(tets[i] < 0, -1, tet_ids[wp.max(tets[i], 0)])
