"""Rounds on a CPU: one launch for all rounds of some rays.

Native code takes a few rays at a time: cpu_march.py marches them, cpu.cpp shades and sums their
samples.  With so few, the inputs of each step are still in a core's cache.  The color network is
evaluated only for samples with a noticeable weight, or once a ray (../deferred.py).

Shapes: R rays, K slots per ray, T tets.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

from ...base.native import LANES_H, native_source
from ...field import (
    BASIS_COUNT,
    ENCODING_H,
    GEOMETRY_FEATURES,
    LAYERS_H,
    NATIVE_VALUES,
    NETWORK_BLOCK,
    NativeNetworks,
    Tables,
    native_networks,
    table_in_bytes,
)
from ..rays.cpu_march import march_some
from ..rays.marching import (
    Rays,
    RaySamples,
    Round,
    Samples,
    empty_rays,
    empty_round,
)
from ..rays.pose import Geometry, Pose
from ..render_options import RenderOptions
from .compositing import Pixels, empty_pixels

CHUNK = 10 * NETWORK_BLOCK  # samples that are shaded together; a multiple of a vector's lanes
ROUND_SLOTS = (16, 8, 8, 8, 16, 32, 64, 128)  # K by round, at most: most rays end after 12 samples
SLOTS = 1 << 14  # that are marched and then shaded: they stay in a core's cache
LEAST_WEIGHT = 4e-3  # of a color in default mode: a step of a byte
SAMPLE_BYTES = 272  # of scratch, beside features
FAR = 1.0e30  # a t behind everything
SMALLEST = 1.0e-6  # divisor: an opacity, or the length of a sum of directions


@wp.struct
class NativeShading:
    """What a chunk of samples is shaded with."""

    rotations: wp.array(dtype=wp.mat33)  # [T] Q
    tables: Tables
    table: wp.array(dtype=wp.vec4)
    words: wp.array(dtype=int)  # of a ByteTable, or none
    hashed_start: int
    byte_level: int  # from which level on `words` are read; of others, `table`
    networks: NativeNetworks
    level_count: int
    has_directions: int  # 0: colors do not depend on them
    in_pairs: int  # 1: networks multiply pairs of bfloat16 where the processor can
    stop: float  # transmittance below which a ray ends
    closing: int  # 1: behind its end a ray looks as before it; 0: black
    least_weight: float  # a sample's color counts for those before it that weigh less together
    extinctions: wp.array(dtype=float)  # [slots] out, if not empty: of samples that overlap
    scratch: wp.array(dtype=float)


@wp.func_native(
    native_source(
        Path(__file__).parent / "cpu.cpp",
        [LAYERS_H, ENCODING_H, LANES_H],
        NATIVE_VALUES | {"CHUNK": CHUNK, "FAR": f"{FAR}f", "SMALLEST": f"{SMALLEST}f"},
    )
)
def shade_native(
    rays: Rays,
    round: Round,
    shading: NativeShading,
    pixels: Pixels,
    left_before: int,
    totals: wp.array(dtype=int),
): ...


@wp.kernel(enable_backward=False)
def march_some_kernel(
    geometry: Geometry,
    rays: Rays,
    round: Round,  # its samples and counts are out
    stop: float,
    transmittance: wp.array(dtype=float),  # [R]
):
    """A round's march, by one thread."""
    march_some(geometry, rays, round, transmittance, stop)


@wp.func
def trace(
    geometry: Geometry,
    rays: Rays,
    round: Round,  # in: all rays, and slots; out: those that are left
    ray_count: int,  # of all rays
    round_slots: wp.array(dtype=int),  # K by round; empty: what is in the slots is all there is
    shading: NativeShading,
    pixels: Pixels,
    totals: wp.array(dtype=int),  # [2] room; out, the first: rays that are left
):
    """All rounds of the rays of a list, by one thread; `accumulate_kernel` says how one ends.

    Returns the number of samples.
    """
    is_marched = round_slots.shape[0] == 0
    count = int(ray_count)
    number = int(0)
    sample_count = int(0)
    while count > 0:
        if not is_marched:
            round.slot_count = round_slots[wp.min(number, round_slots.shape[0] - 1)]
        most = round.samples.tet.shape[0] / round.slot_count
        left = int(0)
        round.first = 0
        while round.first < count:
            round.ray_count = wp.min(most, count - round.first)
            if not is_marched:
                march_some(geometry, rays, round, pixels.transmittance, shading.stop)
            i = int(0)
            while i < round.ray_count:
                sample_count += round.counts[i]
                i += 1
            shade_native(rays, round, shading, pixels, left, totals)
            left = totals[0]
            round.first += round.ray_count
        number += 1
        count = wp.where(is_marched, 0, left)
    return sample_count


@wp.kernel(enable_backward=False)
def trace_kernel(
    geometry: Geometry,
    rays: Rays,
    round: Round,
    ray_count: int,
    round_slots: wp.array(dtype=int),
    shading: NativeShading,
    pixels: Pixels,
    totals: wp.array(dtype=int),  # [2] out: rays that are left, samples
):
    """As `trace`."""
    totals[1] = trace(geometry, rays, round, ray_count, round_slots, shading, pixels, totals)


class CpuShader:
    """What shades samples of one field on the CPU, for launches in any number of threads."""

    def __init__(self, shading):
        """Take a Shading on the CPU, whose arrays are read."""
        self._shading, self._field = shading, shading.field
        field = self._field
        self._words, self._hashed_start = wp.empty(0, dtype=int, device="cpu"), 0
        self._byte_level, layers = field.layout.level_count, field.density_layers
        found = table_in_bytes(field.layout, field.table) if field.entry_bits == 8 else None
        if found:
            self._words = wp.array(found.words, dtype=int, device="cpu")
            self._hashed_start, self._byte_level = found.hashed_start, found.first_level
            (weights, bias), *others = layers
            layers = (found.scales[:, None] * weights, bias), *others
        self._networks = native_networks(layers, field.color_layers)

    def of_launch(self, options) -> NativeShading:
        """What one launch needs, with memory of its own."""
        native, exact = NativeShading(), options.conformance
        native.rotations, native.tables = self._shading.rotations, self._shading.tables
        native.table, native.words = self._shading.table, self._words
        native.hashed_start, native.byte_level = self._hashed_start, self._byte_level
        native.networks = self._networks
        native.level_count = options.level_count or self._field.layout.level_count
        native.has_directions = int(self._field.options.view_dependence)
        native.in_pairs = int(options.half)
        native.stop, native.closing = options.termination, int(not exact)
        native.least_weight = 0.0 if exact else LEAST_WEIGHT
        size = CHUNK * (SAMPLE_BYTES // 4 + 4 * native.level_count)
        joined = GEOMETRY_FEATURES + BASIS_COUNT  # as floats, and as pairs
        row = 2 * self._networks.widest + 2 * native.level_count + joined + joined // 2
        size += NETWORK_BLOCK * row + 1024
        native.extinctions = wp.empty(0, dtype=float, device="cpu")
        native.scratch = wp.empty(size, dtype=float, device="cpu")
        return native

    def sigma(self, samples: Samples):
        """σ of samples.  [N] float32"""
        options = RenderOptions(single_precision=True)
        return self._endless(samples, Rays(), Pixels(), options).numpy()

    def values(self, rays: Rays, found: RaySamples, options):
        """Density of packed samples, and what their rays sum: as `Shading.shade`."""
        count, deferred = len(found.samples.tet), self._field.options.deferred
        own, pixels = empty_rays(count, "cpu"), empty_pixels(count, "cpu", deferred)
        ray = np.repeat(found.ids.numpy(), found.counts.numpy())
        own.directions.assign(rays.directions.numpy()[ray])
        sigma = self._endless(found.samples, own, pixels, options)
        return sigma, pixels.sums if deferred else pixels.color

    def _endless(self, samples, rays, pixels, options):
        """σ of samples; pixel n gets the values of sample n.  [N]

        Each sample is the only one of ray n and has no end, so its weight is 1.
        """
        count = len(samples.tet)
        round = empty_round(wp.array(np.arange(count), dtype=int, device="cpu"), count, count)
        round.samples.tet, round.samples.bary = samples.tet, samples.bary
        round.samples.t.zero_()
        round.samples.length.fill_(1.0)
        round.highs = wp.full(count, FAR, dtype=float, device="cpu")
        round.counts.fill_(1)
        shading = self.of_launch(replace(options, termination=0.0))
        sigma = shading.extinctions = wp.zeros(count, dtype=float, device="cpu")
        self.add(rays, round, pixels, shading)
        return sigma

    def color(self, ids, pixels: Pixels, options):
        """Give the rays `ids`, which have come to their ends, the colors of what they summed."""
        rays, round = Rays(), empty_round(wp.clone(ids), len(ids), len(ids))
        rays.tet = wp.full(len(pixels.transmittance), -2, dtype=int, device="cpu")  # at their ends
        round.counts.zero_()
        self.add(rays, round, pixels, self.of_launch(replace(options, termination=0.0)))

    def add(self, rays: Rays, round: Round, pixels: Pixels, shading):
        """Add the samples of a round to the pixels.

        Args:
            round: Its list becomes that of the rays that are left.
            shading: See `of_launch`.

        Returns:
            The rays that are left, and the number of samples.
        """
        assert round.slot_count <= CHUNK, round.slot_count
        totals = wp.zeros(2, dtype=int, device="cpu")
        inputs = [Geometry(), rays, round, len(round.alive), None, shading, pixels]
        wp.launch(trace_kernel, 1, inputs, [totals], device="cpu")
        left, sample_count = totals.numpy().tolist()
        return round.alive[:left], sample_count


class CpuRounds:
    """Traces rays of one field, in any number of threads at once."""

    def __init__(self, pose: Pose, shading):
        self._pose, self._shader = pose, shading.on_cpu
        self._round_slots = wp.array(ROUND_SLOTS, dtype=int, device="cpu")

    def trace(self, rays: Rays, alive, pixels: Pixels, options) -> int:
        """Add the rays `alive` to the pixels, to their ends; returns the number of samples."""
        if not len(alive):
            return 0
        memory = TraceMemory(len(alive))
        memory.alive.assign(alive)
        inputs = [self._pose.geometry, rays, memory.round, len(alive)]
        inputs += [*self.for_tiles(memory, options), pixels]
        wp.launch(trace_kernel, 1, inputs, [memory.totals], device="cpu")
        return int(memory.totals.numpy()[1])

    def for_tiles(self, memory: "TraceMemory", options):
        """The slots of each round, and the shading, for a thread's launches in a memory."""
        used = options.level_count, options.half, options.termination, options.conformance
        if memory.used != used:
            memory.used, memory.shading = used, self._shader.of_launch(options)
        return self._round_slots, memory.shading

    def march(self, rays: Rays, alive, slot_count, pixels: Pixels, options):
        """One round's samples of the rays `alive` in slots, and how many each ray has."""
        round = empty_round(alive, len(alive), len(alive) * slot_count)
        inputs = [self._pose.geometry, rays, round, options.termination, pixels.transmittance]
        wp.launch(march_some_kernel, 1, inputs, device="cpu")
        return round.samples, round.counts

    def shade(self, rays: Rays, alive, slots: Samples, counts, pixels: Pixels, options):
        """Add a round's samples to the pixels: the rays that are left, the number of samples."""
        round = Round()
        round.alive, round.slot_count = wp.clone(alive), len(slots.tet) // len(alive)
        round.samples, round.counts = slots, counts
        return self._shader.add(rays, round, pixels, self._shader.of_launch(options))


class TraceMemory:
    """What a launch of `trace_kernel` needs, for a list of at most so many rays."""

    def __init__(self, ray_count: int):
        capacity = min(SLOTS, max(ROUND_SLOTS) * ray_count)
        self.alive = wp.empty(ray_count, dtype=int, device="cpu")
        self.round = empty_round(self.alive, min(ray_count, capacity // min(ROUND_SLOTS)), capacity)
        self.totals = wp.empty(2, dtype=int, device="cpu")
        self.used = self.shading = None  # the last launch's options, as far as shading has them
