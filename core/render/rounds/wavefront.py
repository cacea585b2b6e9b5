"""Default mode on CUDA: images without a wait for the host.

One launch makes the rays and lists those that meet the mesh.  If each ray has one color, another
one takes them from there to their sums (tracing.py).  Three launches then color all rays that have
any opacity: means, color network, pixels.

If samples have colors, or pieces have to be sorted (overlap/window_slots.py), rays go on in rounds.
Each has six launches (the kernels are in slots.py and slot_march.py):

    advance     swaps the lists of rays and divides the slots among the rays
    march       fills K slots for each ray of the list, for as many rays as there are slots
    search      at the same time: the same for the few rays that search for their entries
    encode      slots to features and spherical harmonics, in half precision
    evaluate    features to density and color: both networks, one fused kernel
    composite   slots to pixels; lists the rays that go on in the next round

If pieces of rays with one color have to be sorted, slot_densities.py does encode and evaluate, and
rays sum h instead of colors.

If nothing overlaps, one CUDA graph has the launches of a whole image; otherwise there is a graph
for each round.  If stages are timed, there is no graph.

K follows from the length of the list, which only the device knows.  The host launches as many
rounds as the last few images needed at most, and then reads how many rays are left.  If there are
any, which is rare, it launches further rounds.

Rays of neighboring pixels are side by side in lists and slots: a warp takes a tile of 8 x 4
pixels, and slot k of ray i is at k * stride + i.

Shapes: R rays, S slots, L levels.
"""

from collections import deque
from contextlib import contextmanager
from ctypes import byref, memmove
from dataclasses import dataclass

import warp as wp

from ...base.recorded import Recorded
from ..rays.camera import DeviceCamera
from ..rays.marching import empty_samples
from ..rays.pose import Pose
from ..shading import Shading
from . import ray_color, slot_march, slots
from .tiles import pixel_threads

SLOTS_PER_PIXEL = 4.0  # rays that get none wait for the next round
FIRST_ROUNDS = 4  # until it is known how many an image needs
REMEMBERED_IMAGES = 8  # the next one is expected to need as many rounds as the most of these
MOST_MORE_ROUNDS = 8  # before the host looks again
MOST_GRAPHS = 16  # of images
DEVICE_CAMERA_BYTES = wp.types.type_size_in_bytes(DeviceCamera)
LEAST_SLOTS_IN_ALL = 1 << 19  # a round of fewer takes as long
MOST_BYTES = 640e6  # of slots
RAY_COLOR_BYTES, SAMPLE_COLOR_BYTES = 76, 148  # of a slot, about, with those of WindowSlots
SLOT_MULTIPLE = 4096  # so that some rays get slots in any case


@dataclass(frozen=True, eq=False)
class Way:
    """How the rays of a list fill their slots, and what becomes of these.

    The kernels are launched for the place of each listed ray, with inputs (geometry, buffers,
    *more) and (stop, buffers, *more).
    """

    march: wp.Kernel
    composite: wp.Kernel
    least: int  # slots per ray and round
    most: int
    more: tuple = ()


PLAIN = Way(
    slot_march.march_slots_kernel, slots.composite_slots_kernel, slots.LEAST_SLOTS, slots.MOST_SLOTS
)


class Wavefront:
    """Renders images of up to `capacity` pixels in default mode into its `buffers`."""

    def __init__(self, pose: Pose, shading: Shading, options, capacity: int):
        """`options` are the field's; what only rounds need is allocated by `add_slots`."""
        self.capacity = capacity
        self._pose = pose
        self._tables, self._networks = shading.tables, shading.in_place
        self._table, self._nodes = shading.half_tables
        self._constant_direction = int(not options.view_dependence)
        self._deferred = options.deferred
        self._ray_count = 0  # of the image
        self._level_count = options.level_count
        self.device = device = pose.device
        self.buffers = slots.empty_buffers(capacity, options, shading)
        self._traces = options.deferred and device.is_cuda
        self._slot_count = 0
        if not self._traces:
            self.add_slots(options)
        self._own = {}  # what kernels that trace write and read, by kernel
        self._painted = self.buffers.state[slots.PAINTED : slots.PAINTED + 1]
        pinned = device.is_cuda
        self._host_state = wp.zeros(slots.STATE_SIZE, dtype=int, device="cpu", pinned=pinned)
        self._host_camera = wp.zeros(1, dtype=DeviceCamera, device="cpu", pinned=pinned)
        self._background = None  # that the buffers have
        self._beside = wp.Stream(device) if pinned else None
        self._graphs = {}  # of one round each, by way, step, stop and levels
        self._whole = {}  # Recorded of all that an image takes, by its size, rounds and options
        self._needed_rounds = {}  # of each way, for the last images

    def add_slots(self, options):
        """Allocate what rounds need, unless it is there."""
        if self._slot_count:
            return
        slot_count = max(int(SLOTS_PER_PIXEL * self.capacity), LEAST_SLOTS_IN_ALL)
        slot_bytes = RAY_COLOR_BYTES if options.deferred else SAMPLE_COLOR_BYTES
        slot_count = min(slot_count, int(MOST_BYTES / slot_bytes))
        slot_count = -(-slot_count // SLOT_MULTIPLE) * SLOT_MULTIPLE
        slots.add_slots(self.buffers, slot_count, options, self.device)
        self._slot_count = slot_count

    def begin(self, camera: DeviceCamera, rows, options, stage):
        """Make the rays of an image, and list those that meet the mesh for the next round.

        Args:
            rows: (first, last): the rows first..last-1 of the camera's image.
        """
        with stage("begin"):
            self._take(camera, rows, options)
            self._launch_begin(camera.lens.width, rows)

    def draw(self, camera: DeviceCamera, rows, options, stage):
        """`begin` and `start`, of whole images with as few launches as possible."""
        width, whole = camera.lens.width, (0, camera.lens.height)
        if not self.device.is_cuda or stage.seconds is not None or tuple(rows) != whole:
            self.begin(camera, rows, options, stage)
            self.start(options, stage)
            return
        self._take(camera, rows, options)
        count = 0 if self._traces else self._likely_rounds(PLAIN)
        key = count, width, whole, options.step_factor, options.termination, options.level_count
        recorded = self._whole.pop(key, None) or Recorded(self.device)
        if len(self._whole) == MOST_GRAPHS:
            del self._whole[next(iter(self._whole))]  # the one that was launched longest ago
        self._whole[key] = recorded

        def launch():
            self._launch_begin(width, rows)
            if self._traces:
                self._launch_tracing(options, stage)
            else:
                for _ in range(count):
                    self._launch_round(PLAIN, options, stage)
            if self._deferred:
                self._launch_colors(options, stage)

        recorded(launch)

    def _take(self, camera, rows, options):
        """What recorded launches read of an image, and what they need before."""
        if self._background != tuple(options.background):
            self._background = tuple(options.background)
            self.buffers.background.fill_(wp.vec3(*options.background))
        self._ray_count = (rows[1] - rows[0]) * camera.lens.width
        # No image of another camera is under way.  (numpy_value() fails for structs in structs.)
        memmove(self._host_camera.ptr, byref(camera.__ctype__()), DEVICE_CAMERA_BYTES)
        wp.copy(self.buffers.camera, self._host_camera)
        self._pose.refresh_face_boxes()

    def _launch_begin(self, width, rows):
        self.buffers.state.zero_()
        row_count = rows[1] - rows[0]
        inputs = [self._pose.geometry, rows[0], row_count, int(self._traces), self.buffers]
        self._launch(slots.begin_kernel, pixel_threads(width, row_count), inputs)

    def start(self, options, stage, way: Way = PLAIN, rounds: int | None = None):
        """Launch what fills `color` and `depth` of the buffers for the rays in the list.

        Of rounds, by default as many as an image likely needs.
        """
        if way is PLAIN and self._traces:
            self._launch_tracing(options, stage)
        else:
            for _ in range(rounds or self._likely_rounds(way)):
                self._round(way, options, stage)
        if self._deferred:
            self._launch_colors(options, stage)

    def finish(self, options, stage, way: Way = PLAIN) -> tuple[int, int, bool]:
        """Wait for what `start` launched, and launch other rounds until no ray is listed.

        Returns:
            The numbers of samples and of crowded rays, and whether other rounds were launched.
        """
        first = rounds = self._likely_rounds(way)
        while True:
            wp.copy(self._host_state, self.buffers.state)
            if self.device.is_cuda:
                wp.synchronize_stream(wp.get_stream(self.device))
            state = self._host_state.numpy()
            if way is PLAIN and self._traces:
                return int(state[slots.SAMPLES]), 0, False
            if state[slots.NEXT_LISTED] == 0:
                break
            rounds = min(max(2, rounds // 2), MOST_MORE_ROUNDS)
            self.start(options, stage, way, rounds)
        needed = self._needed_rounds.setdefault(way.march, deque(maxlen=REMEMBERED_IMAGES))
        needed.append(int(state[slots.ROUNDS]))
        return int(state[slots.SAMPLES]), int(state[slots.CROWDED]), needed[-1] > first

    def _likely_rounds(self, way) -> int:
        return max(self._needed_rounds.get(way.march, ()), default=FIRST_ROUNDS)

    def _round(self, way, options, stage):
        """One round, recorded as a CUDA graph unless its stages are timed."""
        if not self.device.is_cuda or stage.seconds is not None:
            self._launch_round(way, options, stage)
            return
        key = way, options.step_factor, options.termination, options.level_count
        if key not in self._graphs:
            self._launch_round(way, options, stage)  # compiles
            with wp.ScopedCapture(self.device, force_module_load=False) as capture:
                self._launch_round(way, options, stage)
            self._graphs[key] = capture.graph
        wp.capture_launch(self._graphs[key])

    def _launch_round(self, way, options, stage):
        geometry, buffers = self._pose.geometry, self.buffers
        with stage("march"):
            self._launch(
                slots.advance_kernel, 1, [self._slot_count, way.least, way.most, buffers.state]
            )
            inputs = [geometry, buffers]
            with self._side_by_side():
                self._launch(slot_march.search_slots_kernel, slot_march.SEARCHING_THREADS, inputs)
            self._launch(way.march, len(buffers.counts), [*inputs, *way.more])
            self._join()
        used_level_count = options.level_count or self._level_count
        if self._traces:
            with stage("networks"):
                self._launch_densities(used_level_count)
        else:
            self._launch_networks(used_level_count, stage)
        with stage("composite"):
            inputs = [options.termination, buffers, *way.more]
            self._launch(way.composite, self.capacity, inputs)

    @contextmanager
    def _side_by_side(self):
        """Context whose launches run beside those that follow it, up to `_join`."""
        if self._beside is None:
            yield
            return
        self._beside.wait_stream(wp.get_stream(self.device))
        with wp.ScopedStream(self._beside, sync_enter=False):
            yield

    def _join(self):
        if self._beside is not None:
            wp.get_stream(self.device).wait_stream(self._beside)

    def _launch_densities(self, used_level_count):
        from .slot_densities import BLOCKS_PER_PROCESSOR, slot_densities_kernel  # CUDA alone

        threads = self.device.sm_count * BLOCKS_PER_PROCESSOR * slots.BLOCK_SIZE
        inputs = [self._tables, self._table, self._nodes, used_level_count]
        inputs += [*self._networks.density, threads, self.buffers]
        self._launch(slot_densities_kernel, threads, inputs)

    def _launch_tracing(self, options, stage):
        from . import tracing  # CUDA alone

        head = [self._pose.geometry, self._tables, self._table, self._nodes]
        head += [options.level_count or self._level_count, *self._networks.density]
        head.append(options.termination)

        def launch(kernel, blocks):
            threads = self.device.sm_count * blocks * slots.BLOCK_SIZE
            if kernel not in self._own:
                self._own[kernel] = empty_samples(threads * int(tracing.SLOTS), self.device)
            self._launch(kernel, threads, [*head, self._own[kernel], threads, self.buffers])

        with stage("trace"):
            with self._side_by_side():
                launch(tracing.trace_searching_kernel, tracing.SEARCH_BLOCKS)
            launch(tracing.trace_kernel, tracing.BLOCKS_PER_PROCESSOR)
            self._join()

    def _launch_networks(self, used_level_count, stage):
        buffers, level_count = self.buffers, self._level_count
        with stage("encode"):
            inputs = [self._tables, self._table, self._nodes, self._pose.geometry.rotations]
            inputs += [level_count, used_level_count, self._constant_direction, buffers]
            self._launch(slots.encode_slots_kernel, self._slot_count, inputs)
        with stage("networks"):
            total = buffers.state[slots.TOTAL : slots.TOTAL + 1]
            places = buffers.counts, buffers.state[slots.STRIDE : slots.STRIDE + 1]
            if self._deferred:
                self._networks.geometry(buffers.features, total, buffers.sigma, buffers.h, places)
            else:
                inputs = buffers.features, buffers.basis, total
                self._networks.evaluate(*inputs, buffers.sigma, buffers.rgb, places)

    def _launch_colors(self, options, stage):
        """Paint all rays that have any opacity; those that are not done are painted again later."""
        buffers, count, painted = self.buffers, self._ray_count, self._painted
        transmittance = buffers.pixels.transmittance
        with stage("networks"):
            painted.zero_()
            inputs = [transmittance, buffers.sums, self._constant_direction, painted]
            self._launch(ray_color.means_kernel, count, [*inputs, buffers.painted, buffers.means])
            self._networks.colors(buffers.means, painted, buffers.rgb)
            inputs = [transmittance, painted, buffers.painted, buffers.rgb, options.termination]
            self._launch(
                ray_color.paint_kernel, count, [*inputs, buffers.background, buffers.color]
            )

    def _launch(self, kernel, dim, inputs):
        wp.launch(kernel, dim=dim, inputs=inputs, device=self.device, block_dim=slots.BLOCK_SIZE)
