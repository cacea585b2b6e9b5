"""Shading and summing on a CPU: one launch of native code (cpu.cpp) for a round's samples.

Encoding, networks and sums pass from one to the other what is still in a core's cache, and
the color network is evaluated only for samples that weigh something.

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
from ..rays import Rays, Samples
from .compositing import Pixels

CHUNK = 10 * NETWORK_BLOCK  # samples that are shaded together; a multiple of a vector's lanes
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
    still_alive: wp.array(dtype=int),
    still_alive_count: wp.array(dtype=int),
): ...


@wp.kernel(enable_backward=False)
def shade_kernel(
    rays: Rays,
    rotations: wp.array(dtype=wp.mat33),  # [T] Q
    alive: wp.array(dtype=int),  # [R]
    samples: Samples,  # [R · K] slots
    counts: wp.array(dtype=int),  # [R]
    slot_count: int,  # K, not more than CHUNK
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
    still_alive: wp.array(dtype=int),  # [R] out
    still_alive_count: wp.array(dtype=int),  # [1] out
):
    """All samples of a round, by one thread; `accumulate_kernel` says what becomes of a ray."""
    shade_native(
        rays,
        rotations,
        alive,
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
        still_alive,
        still_alive_count,
    )


class CpuShading:
    """Shades rounds of one field's samples, in any number of threads at once."""

    def __init__(self, shading):
        """Take a Shading on the CPU, whose arrays are read."""
        field = shading.field
        self._tables, self._table = shading.tables, shading.table
        self._rotations = shading.rotations
        self._networks = native_networks(field.density_layers, field.color_layers)
        self._level_count = field.layout.level_count
        self._has_directions = int(field.options.view_dependence)

    def round(self, rays: Rays, alive, slots: Samples, counts, pixels: Pixels, options, stage):
        """Add a round's samples to the pixels: the rays that are left, the number of samples."""
        with stage("shade"):
            count = len(alive)
            level_count = options.level_count or self._level_count
            still_alive = wp.empty(count, dtype=int, device="cpu")
            still_alive_count = wp.zeros(1, dtype=int, device="cpu")
            exact = options.conformance
            slot_count = len(slots.tet) // count
            assert slot_count <= CHUNK, slot_count
            inputs = [rays, self._rotations, alive, slots, counts, slot_count]
            inputs += [self._tables, self._table, self._networks, level_count]
            inputs += [self._has_directions, options.stop, int(not exact)]
            inputs += [0.0 if exact else LEAST_WEIGHT, self._scratch(level_count), pixels]
            outputs = [still_alive, still_alive_count]
            wp.launch(shade_kernel, 1, inputs, outputs, device="cpu")
            left = still_alive[: int(still_alive_count.numpy()[0])]
            return left, int(counts.numpy().sum())

    def _scratch(self, level_count):
        """Memory for a chunk."""
        size = CHUNK * (SAMPLE_BYTES // 4 + 4 * level_count)
        size += 3 * NETWORK_BLOCK * self._networks.widest + 1024
        return wp.empty(size, dtype=float, device="cpu")
