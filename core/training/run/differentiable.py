"""Warp kernels as torch functions: encoding and compositing with their gradients.

On CUDA the caller makes Warp's stream torch's current one (`on_warp_stream`), so kernels
and layers run one after another without waiting for the host.
"""

from contextlib import nullcontext

import torch
import warp as wp

from ...base.wide import vec4h
from ...field import FEATURES, Tables, encode_backward_kernel, encode_kernel
from .compositing import (
    composite_backward_kernel,
    composite_kernel,
    geometry_vector,
    lane_count,
)


def on_warp_stream(device):
    """Context in which torch works on Warp's stream of the device."""
    device = wp.get_device(device)
    if not device.is_cuda:
        return nullcontext()
    return torch.cuda.stream(wp.stream_to_torch(wp.get_stream(device)))


class Encode(torch.autograd.Function):
    """features [N, L·F] = encode(table [entries, F]); differentiable in the table only.

    The kernels read `entries`, the table itself or a float16 copy of it.  With a copy the
    features and their gradients are float16; the sums and the table's gradient stay float32.
    """

    @staticmethod
    def forward(ctx, table, entries, tables: Tables, level_count, sample_tet, sample_bary):
        count = len(sample_tet)
        features = entries.new_empty(count, level_count * FEATURES)
        wp.launch(
            encode_kernel,
            dim=count,
            inputs=[tables, _vec4(entries), sample_tet, sample_bary, level_count],
            outputs=[_levels(features, level_count)],
            device=wp.device_from_torch(table.device),
        )
        ctx.tables, ctx.level_count = tables, level_count
        ctx.sample_tet, ctx.sample_bary, ctx.table_shape = sample_tet, sample_bary, table.shape
        return features

    @staticmethod
    def backward(ctx, features_grad):
        table_grad = torch.zeros(ctx.table_shape, device=features_grad.device)
        wp.launch(
            encode_backward_kernel,
            dim=len(ctx.sample_tet),
            inputs=[
                ctx.tables,
                ctx.sample_tet,
                ctx.sample_bary,
                _levels(features_grad.contiguous(), ctx.level_count),
            ],
            outputs=[_vec4(table_grad)],
            device=wp.device_from_torch(features_grad.device),
        )
        return table_grad, None, None, None, None, None


class Composite(torch.autograd.Function):
    """Sums of values [R, C], opacity, distortion, lead [R], weights [N], visible [R] of samples.

    Differentiable in sigma and in the values, which are colors (C = 3) or the numbers between the
    networks (C = 16) [N, C]; weights, and how many samples of a ray are visible, are not to be
    differentiated through.
    """

    @staticmethod
    def forward(ctx, sigma, values, length, t, counts, ends):
        ray_count, device = len(counts), wp.device_from_torch(sigma.device)
        weights = torch.empty_like(sigma)
        sums = torch.empty(ray_count, values.shape[1], device=sigma.device)
        opacity = torch.empty(ray_count, device=sigma.device)
        weighted_t, distortion, lead = (torch.empty_like(opacity) for _ in range(3))
        visible = torch.empty(ray_count, dtype=torch.int32, device=sigma.device)
        sigma, values = sigma.contiguous(), values.contiguous()
        lanes = lane_count(device)
        wp.launch(
            composite_kernel,
            dim=ray_count * lanes,
            inputs=[lanes, _float(sigma), _vectors(values), length, t, counts, ends],
            outputs=[
                _float(weights),
                _vectors(sums),
                _float(opacity),
                _float(weighted_t),
                _float(distortion),
                _float(lead),
                wp.from_torch(visible),
            ],
            device=device,
        )
        ctx.save_for_backward(values, weights, opacity, weighted_t)
        ctx.samples = (length, t, counts, ends)
        ctx.mark_non_differentiable(weights, visible)
        return sums, opacity, distortion, lead, weights, visible

    @staticmethod
    def backward(ctx, sums_grad, opacity_grad, distortion_grad, lead_grad, *_others):
        values, weights, opacity, weighted_t = ctx.saved_tensors
        length, t, counts, ends = ctx.samples
        # Zeros: samples that belong to no ray get nothing.
        sigma_grad, values_grad = torch.zeros_like(weights), torch.zeros_like(values)
        device = wp.device_from_torch(weights.device)
        lanes = lane_count(device)
        wp.launch(
            composite_backward_kernel,
            dim=len(counts) * lanes,
            inputs=[
                lanes,
                _vectors(values),
                length,
                t,
                counts,
                ends,
                _float(weights),
                _float(opacity),
                _float(weighted_t),
                _vectors(sums_grad),
                _float(opacity_grad),
                _float(distortion_grad),
                _float(lead_grad),
            ],
            outputs=[_float(sigma_grad), _vectors(values_grad)],
            device=device,
        )
        return sigma_grad, values_grad, None, None, None, None


def _float(tensor):
    return wp.from_torch(tensor.detach().contiguous(), dtype=wp.float32)


def _vectors(tensor):
    dtype = wp.vec3 if tensor.shape[1] == 3 else geometry_vector
    return wp.from_torch(tensor.detach().contiguous(), dtype=dtype)


def _vec4(tensor):
    return wp.from_torch(tensor.detach(), dtype=vec4h if tensor.dtype == torch.half else wp.vec4)


def _levels(tensor, level_count):
    return _vec4(tensor.detach().view(-1, level_count, FEATURES))
