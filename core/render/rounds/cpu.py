"""Rounds on a CPU: one launch for all rounds of some rays.

Native code marches (rays/cpu_march.py), shades and sums (cpu.cpp) a few rays at a time, so the
encoding, the networks and the sums find their inputs in a core's cache.  The color network is
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
from ..rays.cpu_march import lattice_paths, march_some
from ..rays.entries import Entries
from ..rays.marching import Rays, RaySamples, Samples, empty_rays, empty_samples
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
class NativeBytes:
    """A ByteTable, whose scales the density network has; no words: `table` is read."""

    words: wp.array(dtype=int)
    hashed_start: int


@wp.struct
class NativeShading:
    """What a chunk of samples is shaded with."""

    rotations: wp.array(dtype=wp.mat33)  # [T] Q
    tables: Tables
    table: wp.array(dtype=wp.vec4)
    bytes: NativeBytes
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
    alive: wp.array(dtype=int),
    first_alive: int,
    alive_count: int,
    samples: Samples,
    highs: wp.array(dtype=float),
    counts: wp.array(dtype=int),
    slot_count: int,
    shading: NativeShading,
    pixels: Pixels,
    left_before: int,
    still_alive: wp.array(dtype=int),
    still_alive_count: wp.array(dtype=int),
): ...


@wp.kernel(enable_backward=False)
def march_some_kernel(
    geometry: Geometry,
    entries: Entries,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    rays: Rays,
    step: float,  # Δ
    slot_count: int,  # K
    paths: wp.array(dtype=int),  # `lattice_paths`
    densities: wp.array(dtype=float),  # [64 T] expected σ of sub-tets
    stop: float,
    transmittance: wp.array(dtype=float),  # [R]
    alive: wp.array(dtype=int),  # [R]
    samples: Samples,  # out
    counts: wp.array(dtype=int),  # [R] out: samples of each ray
):
    """A round's march of the rays `alive`, by one thread."""
    march_some(
        geometry,
        entries,
        occupancy,
        rays,
        alive,
        0,
        alive.shape[0],
        step,
        slot_count,
        paths,
        densities,
        transmittance,
        stop,
        samples,
        counts,
    )


@wp.kernel(enable_backward=False)
def trace_kernel(
    geometry: Geometry,
    entries: Entries,
    occupancy: wp.array(dtype=wp.uint64),  # [T]
    rays: Rays,
    step: float,  # Δ
    round_slots: wp.array(dtype=int),  # K by round; the last one for all that follow
    is_marched: int,  # 1: samples and counts are those of the only round
    paths: wp.array(dtype=int),  # `lattice_paths`
    densities: wp.array(dtype=float),  # [64 T] expected σ of sub-tets
    alive: wp.array(dtype=int),  # [R] in; out: those that are left
    samples: Samples,  # the slots of some rays
    highs: wp.array(dtype=float),  # [slots] where samples end that overlap; else empty
    counts: wp.array(dtype=int),  # samples of each of these rays
    shading: NativeShading,
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
            if is_marched == 0:
                march_some(
                    geometry,
                    entries,
                    occupancy,
                    rays,
                    alive,
                    first,
                    some,
                    step,
                    slot_count,
                    paths,
                    densities,
                    pixels.transmittance,
                    shading.stop,
                    samples,
                    counts,
                )
            i = int(0)
            while i < some:
                sample_count += counts[i]
                i += 1
            # Compacts `alive` in place: the write index never passes the read index.
            shade_native(
                rays,
                alive,
                first,
                some,
                samples,
                highs,
                counts,
                slot_count,
                shading,
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


class CpuShader:
    """What shades samples of one field on the CPU, for launches in any number of threads."""

    def __init__(self, shading):
        """Take a Shading on the CPU, whose arrays are read."""
        self._shading, self._field = shading, shading.field
        field = self._field
        self._bytes, layers = NativeBytes(), field.density_layers
        self._bytes.words = wp.empty(0, dtype=int, device="cpu")
        found = table_in_bytes(field.layout, field.table) if field.entry_bits == 8 else None
        if found:
            self._bytes.words = wp.array(found.words, dtype=int, device="cpu")
            self._bytes.hashed_start = found.hashed_start
            (weights, bias), *others = layers
            layers = (found.scales[:, None] * weights, bias), *others
        self._networks = native_networks(layers, field.color_layers)

    def of_launch(self, options) -> NativeShading:
        """What one launch needs, with memory of its own."""
        native, exact = NativeShading(), options.conformance
        native.rotations, native.tables = self._shading.rotations, self._shading.tables
        native.table, native.bytes = self._shading.table, self._bytes
        native.networks = self._networks
        native.level_count = options.level_count or self._field.layout.level_count
        native.has_directions = int(self._field.options.view_dependence)
        native.in_pairs = int(options.half)
        native.stop, native.closing = options.stop, int(not exact)
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
        count, endless = len(samples.tet), Samples()
        endless.tet, endless.bary = samples.tet, samples.bary
        endless.t = wp.zeros(count, dtype=float, device="cpu")
        sigma, endless.length, highs = (
            wp.full(count, value, dtype=float, device="cpu") for value in (0.0, 1.0, FAR)
        )
        alive = wp.array(np.arange(count), dtype=int, device="cpu")
        counts = wp.full(count, 1, dtype=int, device="cpu")
        shading = self.of_launch(replace(options, termination=0.0))
        shading.extinctions = sigma
        if count:
            self.add(rays, alive, endless, counts, pixels, shading, highs)
        return sigma

    def color(self, ids, pixels: Pixels, options):
        """Give the rays `ids`, which have come to their ends, the colors of what they summed."""
        rays, count = Rays(), len(ids)
        rays.tet = wp.full(len(pixels.transmittance), -2, dtype=int, device="cpu")  # at their ends
        counts, slots = wp.zeros(count, dtype=int, device="cpu"), empty_samples(count, "cpu")
        shading = self.of_launch(replace(options, termination=0.0))
        self.add(rays, ids, slots, counts, pixels, shading)

    def add(self, rays: Rays, alive, slots: Samples, counts, pixels: Pixels, shading, highs=None):
        """Add samples in slots to the pixels of the rays `alive`.

        Args:
            shading: See `of_launch`.
            highs: Where samples end, if they overlap; see cpu.cpp.

        Returns:
            The rays that are left, and the number of samples.
        """
        alive, nothing = wp.clone(alive), wp.empty(0, dtype=int, device="cpu")
        none, totals = wp.empty(0, dtype=float, device="cpu"), wp.zeros(2, dtype=int, device="cpu")
        slot_count = len(slots.tet) // max(len(alive), 1)
        assert slot_count <= CHUNK, slot_count
        inputs = [Geometry(), Entries(), wp.empty(0, dtype=wp.uint64, device="cpu"), rays, 0.0]
        inputs += [wp.full(1, slot_count, dtype=int, device="cpu"), 1, nothing, none, alive, slots]
        inputs += [none if highs is None else highs, counts, shading, pixels]
        wp.launch(trace_kernel, 1, inputs, [totals], device="cpu")
        left, sample_count = totals.numpy().tolist()
        return alive[:left], sample_count


class CpuRounds:
    """Traces rays of one field, in any number of threads at once."""

    def __init__(self, pose: Pose, occupancy, shading, march_step: float):
        self._pose, self._occupancy, self._march_step = pose, occupancy, march_step
        self._shader = shading.on_cpu
        self._round_slots = wp.array(ROUND_SLOTS, dtype=int, device="cpu")
        self._no_highs = wp.empty(0, dtype=float, device="cpu")
        self._paths = wp.array(lattice_paths(), dtype=int, device="cpu")
        self._densities = shading.densities

    def trace(self, rays: Rays, entries, alive, pixels: Pixels, options) -> int:
        """Add the rays `alive` to the pixels, to their ends; returns the number of samples."""
        if not len(alive):
            return 0
        most = min(SLOTS, max(ROUND_SLOTS) * len(alive))
        samples = empty_samples(most, "cpu")
        counts = wp.empty(min(len(alive), most // min(ROUND_SLOTS)), dtype=int, device="cpu")
        totals = wp.zeros(2, dtype=int, device="cpu")
        step = self._march_step * options.step_factor
        inputs = [self._pose.geometry, entries, self._occupancy, rays, step, self._round_slots, 0]
        inputs += [self._paths, self._densities, wp.clone(alive), samples, self._no_highs, counts]
        inputs += [self._shader.of_launch(options), pixels]
        wp.launch(trace_kernel, 1, inputs, [totals], device="cpu")
        return int(totals.numpy()[1])

    def march(self, rays: Rays, entries, alive, slot_count, pixels: Pixels, options):
        """One round's samples of the rays `alive` in slots, and how many each ray has."""
        slots = empty_samples(len(alive) * slot_count, "cpu")
        counts = wp.empty(len(alive), dtype=int, device="cpu")
        step = self._march_step * options.step_factor
        inputs = [self._pose.geometry, entries, self._occupancy, rays, step, slot_count]
        inputs += [self._paths, self._densities, options.stop, pixels.transmittance, alive]
        wp.launch(march_some_kernel, 1, inputs, [slots, counts], device="cpu")
        return slots, counts

    def shade(self, rays: Rays, alive, slots: Samples, counts, pixels: Pixels, options):
        """Add a round's samples to the pixels: the rays that are left, the number of samples."""
        shading = self._shader.of_launch(options)
        return self._shader.add(rays, alive, slots, counts, pixels, shading)
