"""Choose the fastest way to evaluate a field's networks for images on a device.

    device                         half precision            float32
    CPU                            native, bfloat16 (cpu.py) native (cpu.py)
    CUDA, if mma.fits              tensor cores (mma.py)     torch
    CUDA otherwise                 torch                     torch

Torch takes seconds to import, so its networks are made at the first call that needs them.
Viewing must work without torch: if torch is missing or finds no GPU, the CPU evaluates the
networks, which is slow and, in bfloat16, less accurate than float16.
Training does not use this module, but TorchNetworks.evaluate.

Shapes: N samples, L levels, l <= L of them encoded.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import warp as wp

from ..field import TetField
from . import mma
from .cpu import CpuNetworks


@dataclass(frozen=True)
class Evaluators:
    """The two networks of a field on a Warp device; arrays are Warp's.

    Attributes:
        geometry: geometry(features [N, l] vec4, half) -> sigma [N], h [N, 16].
        colors: colors(h [N, 16], basis [N] basis_vector, half) -> rgb [N].
        in_place: What evaluates them without allocating or waiting for anything, see mma.py; None
            where only the others are there.

    With `half`, they compute in half precision if the device gains by it.
    """

    geometry: Callable
    colors: Callable
    in_place: mma.TensorCoreNetworks | None = None


def evaluators(field: TetField, device: wp.Device) -> Evaluators:
    """How to evaluate both networks of a field (TetField) on a Warp device."""
    if not device.is_cuda:
        return _on_cpu(field)
    in_place = mma.TensorCoreNetworks(field, device) if mma.fits(field, device) else None

    @cache
    def networks():
        return _in_torch(field, device) if _torch_finds_a_gpu() else _on_cpu(field)

    return Evaluators(
        lambda features, half: networks().geometry(features, half),
        lambda h, basis, half: networks().colors(h, basis, half),
        in_place,
    )


def _torch_finds_a_gpu() -> bool:
    try:
        import torch
    except ModuleNotFoundError:  # as after an installation for viewing alone
        return False
    return torch.cuda.is_available()  # a CPU build of torch finds none


def _on_cpu(field) -> Evaluators:
    networks = CpuNetworks(field.density_layers, field.color_layers)

    # Of a GPU's arrays, these calls copy down and up.
    def geometry(features, half):
        found = networks.geometry(features.to("cpu"), half)
        return tuple(array.to(features.device) for array in found)

    def colors(h, basis, half):
        return networks.colors(h.to("cpu"), basis.to("cpu"), half).to(h.device)

    return Evaluators(geometry, colors)


def _in_torch(field, device) -> Evaluators:
    import torch

    from .torch import TorchNetworks

    @cache
    def networks(half):
        whole = TorchNetworks(field.density_layers, field.color_layers)
        whole = whole.to(f"cuda:{device.ordinal}")
        return whole.half() if half else whole

    # On Warp's stream, so that kernels and layers follow each other without waiting.
    def on_warp_stream():
        return torch.cuda.stream(wp.stream_to_torch(wp.get_stream(device)))

    def geometry(features, half):
        with torch.no_grad(), on_warp_stream():
            x = wp.to_torch(features).flatten(1)
            missing = networks(half).density[0].in_features - x.shape[1]
            x = torch.nn.functional.pad(x, (0, missing)) if missing else x
            h = networks(half).density_features(x.half() if half else x)
            return wp.from_torch(networks(half).sigma(h)), wp.from_torch(h.float())

    def colors(h, basis, half):
        with torch.no_grad(), on_warp_stream():
            h = wp.to_torch(h)
            rgb = networks(half).colors(h.half() if half else h, wp.to_torch(basis))
            return wp.from_torch(rgb, dtype=wp.vec3)

    return Evaluators(geometry, colors)
