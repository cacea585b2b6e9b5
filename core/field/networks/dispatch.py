"""Choose the fastest way to evaluate a field's networks for images on a CUDA device.

    networks and GPU    half precision            float32
    if mma.fits         tensor cores (mma.py)     torch
    otherwise           torch                     torch

Torch takes seconds to import, so its networks are made at the first call that needs them.
Viewing must work without torch: if torch is missing or finds no GPU, the renderer's native code
(layers.h) replaces it in this table and evaluates the networks on the CPU.  This is slow and, in
bfloat16, less accurate than float16.  The same native code renders images on a CPU.
Training does not use this module; it calls TorchNetworks.evaluate.

Shapes: N samples, L levels, l <= L of them encoded.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field import TetField
from . import mma


@dataclass(frozen=True)
class Evaluators:
    """The two networks of a field on a CUDA device; arrays are Warp's.

    Attributes:
        geometry: geometry(features [N, l] vec4, half) -> sigma [N], h [N, 16].
        colors: colors(h [N, 16], basis [N] basis_vector, half) -> rgb [N].
        in_place: What evaluates them without allocating or waiting for anything, see mma.py; None
            where only torch does.

    With `half`, they compute in half precision if the device gains by it.
    """

    geometry: Callable
    colors: Callable
    in_place: mma.TensorCoreNetworks | None = None


def torch_finds_a_gpu() -> bool:
    """Whether the networks of `evaluators` that are not `in_place` can be evaluated."""
    try:
        import torch
    except ModuleNotFoundError:  # as after an installation for viewing alone
        return False
    return torch.cuda.is_available()  # a CPU build of torch finds none


def evaluators(field: TetField, device: wp.Device) -> Evaluators:
    """How to evaluate both networks of a field (TetField) on a CUDA device."""
    in_place = mma.TensorCoreNetworks(field, device) if mma.fits(field, device) else None

    @cache
    def networks(half):
        from .torch import TorchNetworks

        whole = TorchNetworks(field.density_layers, field.color_layers)
        whole = whole.to(f"cuda:{device.ordinal}")
        return whole.half() if half else whole

    # On Warp's stream, so that kernels and layers follow each other without waiting.
    def on_warp_stream(torch):
        return torch.cuda.stream(wp.stream_to_torch(wp.get_stream(device)))

    def geometry(features, half):
        import torch

        with torch.no_grad(), on_warp_stream(torch):
            x = wp.to_torch(features).flatten(1)
            missing = networks(half).density[0].in_features - x.shape[1]
            x = torch.nn.functional.pad(x, (0, missing)) if missing else x
            h = networks(half).density_features(x.half() if half else x)
            return wp.from_torch(networks(half).sigma(h)), wp.from_torch(h.float())

    def colors(h, basis, half):
        import torch

        with torch.no_grad(), on_warp_stream(torch):
            h = wp.to_torch(h)
            rgb = networks(half).colors(h.half() if half else h, wp.to_torch(basis))
            return wp.from_torch(rgb, dtype=wp.vec3)

    return Evaluators(geometry, colors, in_place)
