"""The fastest way to evaluate a field's networks for images on a device.

    device                         half precision            float32
    CPU                            none: it would be slower  native (cpu.py)
    CUDA that tensor cores fit     tensor cores (mma.py)     torch
    CUDA of another kind or shape  torch                     torch

Torch takes seconds to import, so its networks are made at the first call that needs them.
Viewing must not need torch: where it is missing, or finds no GPU, the host stands in for it,
in float32, which is slow and as accurate.
Training evaluates its networks itself: TorchNetworks.evaluate.

Shapes: N samples, L levels, l <= L of them encoded.
"""

from functools import cache

import warp as wp

from . import mma
from .cpu import evaluate_on_cpu, native_networks


def evaluators(field, device):
    """Functions that evaluate both networks of a field (TetField) on a Warp device.

    Returns:
        packed: packed(features [N, l] vec4, basis [N] basis_vector, half) -> sigma [N], rgb
            [N]: Warp arrays.  With `half`, in half precision if the device gains by it.
        in_place: mma.TensorCoreNetworks.evaluate, which allocates nothing and waits for
            nothing; None where only `packed` is there.
    """
    if not device.is_cuda:
        return _on_cpu(field), None
    in_place = None
    if mma.fits(field, device):
        in_place = mma.TensorCoreNetworks(field, device).evaluate

    @cache
    def networks():
        return _in_torch(field, device) if _torch_finds_a_gpu() else _on_cpu(field)

    def packed(features, basis, half):
        return networks()(features, basis, half)

    return packed, in_place


def _torch_finds_a_gpu() -> bool:
    try:
        import torch
    except ModuleNotFoundError:  # as after an installation for viewing alone
        return False
    return torch.cuda.is_available()  # a CPU build of torch finds none


def _on_cpu(field):
    networks = native_networks(field.density_layers, field.color_layers)

    def packed(features, basis, half):
        device = features.device  # of a GPU's arrays, these calls copy down and up
        sigma, rgb = evaluate_on_cpu(networks, features.to("cpu"), basis.to("cpu"))
        return sigma.to(device), rgb.to(device)

    return packed


def _in_torch(field, device):
    @cache
    def networks(half):
        from .torch import TorchNetworks

        whole = TorchNetworks(field.density_layers, field.color_layers)
        whole = whole.to(f"cuda:{device.ordinal}")
        return whole.half() if half else whole

    def packed(features, basis, half):
        import torch

        dtype = torch.float16 if half else torch.float32
        # On Warp's stream, so that kernels and layers follow each other without waiting.
        stream = wp.stream_to_torch(wp.get_stream(device))
        with torch.no_grad(), torch.cuda.stream(stream):
            x = wp.to_torch(features).flatten(1)
            missing = networks(half).density[0].in_features - x.shape[1]
            x = torch.nn.functional.pad(x, (0, missing)) if missing else x
            sigma, rgb = networks(half)(x.to(dtype), wp.to_torch(basis).to(dtype))
            return wp.from_torch(sigma), wp.from_torch(rgb, dtype=wp.vec3)

    return packed
