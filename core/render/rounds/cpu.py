"""Rounds on a CPU: one launch for all rounds of some rays.

Marching is Warp's, shading and summing are native code (cpu.cpp): encoding, networks and sums
pass from one to the other what is still in a core's cache, and the color network is evaluated
only for samples that weigh something.

Shapes: R rays, K slots per ray, T tets.
"""

from pathlib import Path

import warp as wp

from ...field import (
    ENCODING_H,
    LAYERS_H,
    NATIVE_VALUES,
    NETWORK_BLOCK,
    NativeNetworks,
    Tables,
    native_networks,
)
from ...native import native_source
from ..rays import (
    FILL_SLOTS,
    MIDDLE,
    Entries,
    Geometry,
    Pose,
    Rays,
    Samples,
    empty_samples,
    march_ray,
)
from .compositing import Pixels

CHUNK = 10 * NETWORK_BLOCK  # samples that are shaded together; a multiple of a vector's lanes
ROUND_SLOTS = (8, 4, 8, 8, 16, 32, 64, 128)  # K by round: most rays end after 12 samples
SLOTS = 1 << 14  # that are marched and then shaded: they stay in a core's cache
LEAST_WEIGHT = 4e-3  # of a color in default mode: a step of a byte
SAMPLE_BYTES = 256  # of scratch, beside features


@wp.func_native(
    native_source(
        Path(__file__).parent / "cpu.cpp",
        [LAYERS_H, ENCODING_H],
        NATIVE_VALUES | {"CHUNK": CHUNK},
    )
)
def shade_native(
    rays: Rays,
    rotations: wp.array(dtype=wp.mat33),
    alive: wp.array(dtype=int),
    first_alive: int,
    alive_count: int,
    samples: Samples,
    counts: wp.array(dtype=int),
    slot_count: int,
    tables: Tables,
    table: wp.array(dtype=wp.vec4),
    networks: NativeNetworks,
    level_count: int,
    has_directions: int,
    stop: float,
    closing: int,
    least_weight: float,
    scratch: wp.array(dtype=float),
    pixels: Pixels,
    left_before: int,
    still_alive: wp.array(dtype=int),
    still_alive_count: wp.array(dtype=int),
): ...


@wp.kernel(enable_backward=False)
def trace_kernel(
    geometry: Geometry,
    entries: Entries,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    rays: Rays,
    step: float,  # Δ
    round_slots: wp.array(dtype=int),  # K by round; the last one for all that follow
    is_marched: int,  # 1: samples and counts are those of the only round
    rotations: wp.array(dtype=wp.mat33),  # [T] Q
    alive: wp.array(dtype=int),  # [R] in; out: those that are left
    samples: Samples,  # room for slots
    counts: wp.array(dtype=int),  # [R] room for samples of each ray
    tables: Tables,
    table: wp.array(dtype=wp.vec4),
    networks: NativeNetworks,
    level_count: int,
    has_directions: int,  # 0: colors do not depend on them
    stop: float,  # transmittance below which a ray ends
    closing: int,  # 1: behind its end a ray looks as before it; 0: black
    least_weight: float,  # a sample's color counts for those before it that weigh less together
    scratch: wp.array(dtype=float),
    pixels: Pixels,
    totals: wp.array(dtype=int),  # [2] out: rays that are left, samples
):
    """All rounds of the rays `alive`, by one thread; `accumulate_kernel` says how a round ends."""
    count = alive.shape[0]
    number = int(0)
    sample_count = int(0)
    while count > 0:
        slot_count = round_slots[wp.min(number, round_slots.shape[0] - 1)]
        most = samples.tet.shape[0] / slot_count
        first = int(0)
        left = int(0)
        while first < count:
            some = wp.min(most, count - first)
            i = int(0)
            while i < some:
                if is_marched == 0:
                    counts[i] = march_ray(
                        geometry,
                        entries,
                        occupancy,
                        rays,
                        alive[first + i],
                        step,
                        MIDDLE,
                        FILL_SLOTS,
                        i * slot_count,
                        1,
                        slot_count,
                        samples,
                    )
                sample_count += counts[i]
                i += 1
            # It writes behind what it reads of `alive`.
            shade_native(
                rays,
                rotations,
                alive,
                first,
                some,
                samples,
                counts,
                slot_count,
                tables,
                table,
                networks,
                level_count,
                has_directions,
                stop,
                closing,
                least_weight,
                scratch,
                pixels,
                left,
                alive,
                totals,
            )
            left = totals[0]
            first += some
        number += 1
        count = wp.where(is_marched == 1, 0, left)
    totals[1] = sample_count


class CpuRounds:
    """Traces rays of one field, in any number of threads at once."""

    def __init__(self, pose: Pose, occupancy, shading, march_step: float):
        """Take a Shading on the CPU, whose arrays are read."""
        field = shading.field
        self._pose, self._occupancy, self._march_step = pose, occupancy, march_step
        self._tables, self._table = shading.tables, shading.table
        self._rotations = shading.rotations
        self._networks = native_networks(field.density_layers, field.color_layers)
        self._level_count = field.layout.level_count
        self._has_directions = int(field.options.view_dependence)
        self._round_slots = wp.array(ROUND_SLOTS, dtype=int, device="cpu")

    def trace(self, rays: Rays, entries, alive, pixels: Pixels, options) -> int:
        """Add the rays `alive` to the pixels, to their ends; returns the number of samples."""
        if not len(alive):
            return 0
        room = min(SLOTS, max(ROUND_SLOTS) * len(alive))
        samples = empty_samples(room, "cpu")
        counts = wp.empty(min(len(alive), room // min(ROUND_SLOTS)), dtype=int, device="cpu")
        alive = wp.clone(alive)
        return self._launch(rays, entries, alive, samples, counts, pixels, options)[1]

    def shade(self, rays: Rays, alive, slots: Samples, counts, pixels: Pixels, options):
        """Add a round's samples to the pixels: the rays that are left, the number of samples."""
        alive = wp.clone(alive)
        left, sample_count = self._launch(
            rays, Entries(), alive, slots, counts, pixels, options, len(slots.tet) // len(alive)
        )
        return alive[:left], sample_count

    def _launch(self, rays, entries, alive, samples, counts, pixels, options, slot_count=0):
        """Trace rays, or shade `slot_count` slots of each: what is left of `alive`, samples."""
        exact = options.conformance
        level_count = options.level_count or self._level_count
        round_slots = self._round_slots
        if slot_count:
            round_slots = wp.full(1, slot_count, dtype=int, device="cpu")
        assert round_slots.numpy().max() <= CHUNK, slot_count
        totals = wp.zeros(2, dtype=int, device="cpu")
        step = self._march_step * options.step_factor
        inputs = [self._pose.geometry, entries, self._occupancy, rays, step, round_slots]
        inputs += [int(slot_count > 0), self._rotations, alive, samples, counts]
        inputs += [self._tables, self._table, self._networks, level_count]
        inputs += [self._has_directions, options.stop, int(not exact)]
        inputs += [0.0 if exact else LEAST_WEIGHT, self._scratch(level_count), pixels]
        wp.launch(trace_kernel, 1, inputs, [totals], device="cpu")
        return tuple(totals.numpy().tolist())

    def _scratch(self, level_count):
        """Memory for a chunk."""
        size = CHUNK * (SAMPLE_BYTES // 4 + 4 * level_count)
        size += 3 * NETWORK_BLOCK * self._networks.widest + 1024
        return wp.empty(size, dtype=float, device="cpu")
