"""Density and color of samples: features from the tables, then the networks.

If each ray has one color (deferred.py), `shade` returns, instead of colors, the values to sum along
each ray, and `finish` computes the ray's color from the sums.

Shapes: N packed samples, L levels.
"""

from functools import cached_property, partial

import numpy as np
import warp as wp

from ..base.wide import vec4h
from ..field import (
    CONSTANT_BASIS,
    GEOMETRY_FEATURES,
    SUBTET_COUNT,
    Evaluators,
    TetField,
    basis_vector,
    encode_kernel,
    make_tables,
    node_table,
    subtet_corners,
    torch_finds_a_gpu,
    unpack_mask,
)
from .deferred import color_rays, colors_in_place, values_kernel
from .rays.marching import Rays, RaySamples, Samples, basis_kernel, empty_samples
from .rounds.compositing import Pixels, ray_sums
from .rounds.cpu import CpuShader

AT_ONCE = 1 << 12  # tets whose sub-tets' densities are found: 40 MB

wp.set_module_options({"enable_backward": False})


class Shading:
    """Density and color of samples of one field on one device.

    Attributes:
        on_cpu: Its native code; None on CUDA.
        in_place: That of the `Evaluators`, for rounds that do not wait for the host; None on a CPU.
    """

    def __init__(self, field: TetField, rotations, device):
        """`rotations`: Q of each tet; the renderer writes each new pose to this array."""
        self.field, self.rotations, self.device = field, rotations, device
        self.tables = make_tables(field.mesh, field.layout, device)
        self.in_place = self.on_cpu = None
        if device.is_cuda:
            self._networks = Evaluators(field, device)
            self.in_place = self._networks.in_place
        else:
            self.on_cpu = CpuShader(self)

    def shade(self, rays: Rays, found: RaySamples, options, stage):
        """Density of packed samples, and what their rays sum: sigma [N] and values [N].

        The values are colors, vec3; of a field with one color a ray they are ray_sums.
        """
        if self.on_cpu is not None:
            return self.on_cpu.values(rays, found, options)
        if self.in_place is not None and options.half:
            return self._shade_half(rays, found, options, stage)
        if self._host is not None:
            with stage("networks"):
                wp.copy(self._host.rotations, self.rotations)
                shaded = self._host.on_cpu.values(rays, found.to("cpu"), options)
                return tuple(array.to(self.device) for array in shaded)
        with stage("encode"):
            features = self._encode(self.table, found.samples, options)
        with stage("networks"):
            sigma, h = self._networks.geometry(features, options.half)
            if self.field.options.deferred:
                return sigma, self._values(rays, found, h)
            return sigma, self._networks.colors(h, self.basis(rays, found), options.half)

    def finish(self, ids, pixels: Pixels, options):
        """Give the rays `ids`, which have come to their ends, the colors of what they summed."""
        if not (self.field.options.deferred and len(ids)):
            return
        view_dependence = self.field.options.view_dependence
        if self.on_cpu is not None:
            self.on_cpu.color(ids, pixels, options)
        elif self.in_place is not None and options.half:
            color_rays(colors_in_place(self.in_place), view_dependence, ids, pixels)
        elif self._host is not None:
            copied = pixels.to("cpu")
            self._host.on_cpu.color(ids.to("cpu"), copied, options)
            wp.copy(pixels.color, copied.color)
        else:
            colors = partial(self._networks.colors, half=options.half)
            color_rays(colors, view_dependence, ids, pixels)

    @cached_property
    def _host(self):
        """On CUDA, a Shading of the same field on the CPU if torch finds no GPU; else None."""
        if torch_finds_a_gpu():
            return None
        rotations = wp.empty(len(self.rotations), dtype=wp.mat33, device="cpu")
        return Shading(self.field, rotations, rotations.device)

    @cached_property
    def densities(self):
        """σ in the middle of each occupied sub-tet, else 0: what rays on a CPU expect.  [64 T]"""
        occupancy, middles = self.field.occupancy, subtet_corners().mean(axis=1)
        expected = np.zeros((len(occupancy), SUBTET_COUNT), np.float32)
        for first in range(0, len(occupancy), AT_ONCE):
            tets, subtets = np.nonzero(unpack_mask(occupancy[first : first + AT_ONCE]))
            if not len(tets):
                continue
            tets += first
            samples = empty_samples(len(tets), self.device)
            samples.tet.assign(tets.astype(np.int32))
            samples.bary.assign(middles[subtets].astype(np.float32))
            expected[tets, subtets] = self.on_cpu.sigma(samples)
        return wp.array(expected.ravel(), dtype=float, device=self.device)

    def _values(self, rays, found, h):
        values = wp.empty(len(h), dtype=ray_sums, device=self.device)
        inputs = [rays, self.rotations, found, h]
        wp.launch(values_kernel, len(found.ids), inputs, [values], device=self.device)
        return values

    def _shade_half(self, rays, found, options, stage):
        samples, count, device = found.samples, len(found.samples.tet), self.device
        with stage("encode"):
            features = self._encode(self.half_tables[0], samples, options)
        with stage("networks"):
            sigma = wp.empty(count, dtype=float, device=device)
            total = wp.full(1, count, dtype=int, device=device)
            between = wp.empty((count, 4), dtype=vec4h, device=device)
            if self.field.options.deferred:
                self.in_place.geometry(features.flatten(), total, sigma, between.flatten())
                h = wp.empty((count, GEOMETRY_FEATURES), dtype=float, device=device)
                wp.launch(float_kernel, (count, 4), [between], [h], device=device)
                return sigma, self._values(rays, found, h)
            exact = self.basis(rays, found)
            wp.launch(half_basis_kernel, count, inputs=[exact], outputs=[between], device=device)
            rgb = wp.empty(count, dtype=wp.vec3, device=device)
            self.in_place.evaluate(features.flatten(), between.flatten(), total, sigma, rgb)
        return sigma, rgb

    def _encode(self, table, samples: Samples, options):
        """Features of samples, of the table's type; 0 in levels that aren't used.  [N, L]"""
        count, level_count = len(samples.tet), self.field.layout.level_count
        features = wp.zeros((count, level_count), dtype=table.dtype, device=self.device)
        inputs = [self.tables, table, samples.tet, samples.bary]
        inputs.append(options.level_count or level_count)
        wp.launch(encode_kernel, count, inputs=inputs, outputs=[features], device=self.device)
        return features

    def basis(self, rays: Rays, found: RaySamples):
        """Spherical harmonics of the samples' rest directions.  [N] basis_vector"""
        count, device = len(found.samples.tet), self.device
        if not self.field.options.view_dependence:
            constant = basis_vector(CONSTANT_BASIS)
            return wp.full(count, constant, dtype=basis_vector, device=device)
        basis = wp.empty(count, dtype=basis_vector, device=device)
        inputs = [rays, self.rotations, found]
        wp.launch(basis_kernel, len(found.ids), inputs=inputs, outputs=[basis], device=device)
        return basis

    @cached_property
    def table(self):
        """Entries in float32, which default mode on CUDA does not need."""
        return wp.array(self.field.table, dtype=wp.vec4, device=self.device)

    @cached_property
    def half_tables(self):
        """Entries, and nodes of the dense levels, in half precision.  Two arrays of vec4h"""
        table = self.field.table.astype(np.float16)
        tables = table, node_table(self.field.layout, table)
        return [wp.array(a, dtype=vec4h, device=self.device) for a in tables]


@wp.kernel
def half_basis_kernel(
    basis: wp.array(dtype=basis_vector),  # [N]
    halves: wp.array2d(dtype=vec4h),  # [N, 4] out
):
    n = wp.tid()
    b = basis[n]
    for k in range(4):
        halves[n, k] = vec4h(
            wp.float16(b[4 * k]),
            wp.float16(b[4 * k + 1]),
            wp.float16(b[4 * k + 2]),
            wp.float16(b[4 * k + 3]),
        )


@wp.kernel
def float_kernel(
    halves: wp.array2d(dtype=vec4h),  # [N, 4]
    h: wp.array2d(dtype=float),  # [N, 16] out
):
    n, k = wp.tid()
    four = halves[n, k]
    for i in range(4):
        h[n, 4 * k + i] = float(four[i])
