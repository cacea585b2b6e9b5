"""What samples look like: features from the tables, density and color from the networks.

On the CPU the networks are NumPy's, in blocks.  On CUDA they run in half precision on tensor
cores (network_mma.py; for networks of other shapes Triton, if it is there); where float32 is
asked for, torch does it, which takes seconds to import and so waits until then.

Shapes: N packed samples, L levels.
"""

import numpy as np
import warp as wp

from ..field import FEATURES, TetField, encode_kernel, make_tables, node_table, vec4h
from ..field.networks import mma as network_mma
from ..field.networks import reference as network
from .rays import Rays, Samples, basis_kernel

wp.set_module_options({"enable_backward": False})


class Shading:
    """Density and color of samples of one field on one device.

    Attributes:
        evaluate_slots: What Wavefront takes as `evaluate`; None where there is no such thing.
    """

    def __init__(self, field: TetField, rotations, device):
        """Upload what is needed.

        Args:
            rotations: Q of each tet in the present pose, the same array for ever.
        """
        self._field, self._rotations, self.device = field, rotations, device
        self.tables = make_tables(field.mesh, field.layout, device)
        self._table = self._half_tables = self._networks = None
        self.evaluate_slots = None
        if not device.is_cuda:
            self._networks = numpy_networks(field)
            self._upload_table()
        elif network_mma.fits(field, device):
            self.evaluate_slots = network_mma.Networks(field, device).evaluate
        else:
            self._networks, self.evaluate_slots = torch_networks(field, device)

    def shade(self, rays: Rays, alive, counts, ends, samples: Samples, count, options, stage):
        """Density and color of packed samples.

        Args:
            alive, counts, ends: Whose samples they are, see marching.pack_kernel.
            count: N
            options: RenderOptions.
            stage: Stages.

        Returns:
            sigma [N] and rgb [N], Warp arrays.
        """
        if self.evaluate_slots is not None and options.half:
            return self._shade_half(rays, alive, counts, ends, samples, count, options, stage)
        if self._networks is None:
            self._networks, _ = torch_networks(self._field, self.device)
        with stage("encode"):
            features = self.encode(samples, count, options.level_count)
            basis = self.basis(rays, alive, counts, ends, samples, count)
        with stage("networks"):
            return self._networks(features, basis, half=options.half)

    def _shade_half(self, rays, alive, counts, ends, samples, count, options, stage):
        device = self.device
        with stage("encode"):
            level_count = self._field.layout.level_count
            features = wp.zeros((count, level_count), dtype=vec4h, device=device)
            inputs = [self.tables, self.half_tables()[0], samples.tet, samples.bary]
            inputs.append(options.level_count or level_count)
            wp.launch(encode_kernel, count, inputs=inputs, outputs=[features], device=device)
            basis = wp.empty((count, 4), dtype=vec4h, device=device)
            exact = self.basis(rays, alive, counts, ends, samples, count)
            wp.launch(half_basis_kernel, count, inputs=[exact], outputs=[basis], device=device)
        with stage("networks"):
            sigma = wp.empty(count, dtype=float, device=device)
            rgb = wp.empty(count, dtype=wp.vec3, device=device)
            total = wp.full(1, count, dtype=int, device=device)
            self.evaluate_slots(features.flatten(), basis.flatten(), total, sigma, rgb)
        return sigma, rgb

    def encode(self, samples, count, level_count=None):
        """Features of samples, float32.  [N, L] vec4"""
        self._upload_table()
        level_count = level_count or self._field.layout.level_count
        features = wp.empty((count, level_count), dtype=wp.vec4, device=self.device)
        wp.launch(
            encode_kernel,
            dim=count,
            inputs=[self.tables, self._table, samples.tet, samples.bary, level_count],
            outputs=[features],
            device=self.device,
        )
        return features

    def basis(self, rays, alive, counts, ends, samples, count):
        """Spherical harmonics of the samples' rest directions.  [N] basis_vector"""
        if not self._field.options.view_dependence:
            constant = network.basis_vector(network.CONSTANT_BASIS)
            return wp.full(count, constant, dtype=network.basis_vector, device=self.device)
        basis = wp.empty(count, dtype=network.basis_vector, device=self.device)
        wp.launch(
            basis_kernel,
            dim=len(counts),
            inputs=[rays, self._rotations, alive, counts, ends, samples.tet],
            outputs=[basis],
            device=self.device,
        )
        return basis

    def half_tables(self):
        """Entries, and nodes of the dense levels, in half precision.  Two arrays of vec4h"""
        if self._half_tables is None:
            table = self._field.table.astype(np.float16)
            tables = table, node_table(self._field.layout, table)
            tables = tuple(wp.array(a, dtype=vec4h, device=self.device) for a in tables)
            self._half_tables = tables
        return self._half_tables

    def _upload_table(self):
        """In float32: on CUDA only if somebody asks, as the common case has `half_tables`."""
        if self._table is None:
            self._table = wp.array(self._field.table, dtype=wp.vec4, device=self.device)


@wp.kernel
def half_basis_kernel(
    basis: wp.array(dtype=network.basis_vector),  # [N]
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


def numpy_networks(field):
    """evaluate(features, basis, half) -> sigma, rgb, all Warp arrays on the CPU."""
    networks = network.BlockedNetworks(field.density_layers, field.color_layers, field.options)

    def evaluate(features, basis, half):  # half precision would be slower here
        width = FEATURES * features.shape[1]
        sigma, rgb = networks.evaluate(features.numpy().reshape(len(basis), width), basis.numpy())
        return (
            wp.array(sigma, dtype=float, device="cpu", copy=False),
            wp.array(rgb, dtype=wp.vec3, device="cpu", copy=False),
        )

    return evaluate


def torch_networks(field, device):
    """The networks on a CUDA device, in two forms.

    Returns:
        evaluate(features, basis, half) -> sigma, rgb, all Warp arrays; and what Wavefront
        takes as `evaluate`, or None where Triton can't do these networks.
    """
    import torch

    from ..field import Networks
    from ..field.networks import triton as network_triton

    networks = Networks(
        field.density_layers, field.color_layers, field.options.density_activation
    ).to(f"cuda:{device.ordinal}")
    half_networks = Networks(*networks.layers(), field.options.density_activation)
    half_networks = half_networks.to(f"cuda:{device.ordinal}").half()

    @torch.no_grad()
    def evaluate(features, basis, half):
        # On Warp's stream, so that kernels and layers follow each other without waiting.
        with torch.cuda.stream(wp.stream_to_torch(wp.get_stream(device))):
            x = wp.to_torch(features).flatten(1)
            missing = networks.density[0].in_features - x.shape[1]
            x = torch.nn.functional.pad(x, (0, missing)) if missing else x
            y = wp.to_torch(basis)
            if half:
                sigma, rgb = half_networks(x.half(), y.half())
            else:
                sigma, rgb = networks(x, y)
            return wp.from_torch(sigma), wp.from_torch(rgb, dtype=wp.vec3)

    if not network_triton.can_fuse(networks):
        return evaluate, None
    parameters = network_triton.pack(networks).detach()

    @torch.no_grad()
    def evaluate_slots(features, basis, total, sigma, rgb):
        with torch.cuda.stream(wp.stream_to_torch(wp.get_stream(device))):
            network_triton.launch_forward(
                networks,
                parameters,
                wp.to_torch(features).view(len(sigma), -1),
                wp.to_torch(basis).view(len(sigma), -1),
                *(wp.to_torch(array) for array in (total, sigma, rgb)),
            )

    return evaluate, evaluate_slots
