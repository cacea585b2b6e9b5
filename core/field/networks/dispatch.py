"""Choose the fastest way to evaluate a field's networks for images on a CUDA device.

    networks and GPU    half precision            float32
    if mma.fits         tensor cores (mma.py)     torch
    otherwise           torch                     torch

Torch takes seconds to import, so its networks are made at the first call that needs them.
Viewing must work without torch: if torch is missing or finds no GPU, the renderer's native code
(layers.h) replaces it in this table and evaluates the networks on the CPU.  This is slow and, in
bfloat16, less accurate than float16.  The same native code renders images on a CPU.
Training does not use this module; it calls TorchNetworks.evaluate.

Shapes: N samples, L levels.
"""

from contextlib import contextmanager

import warp as wp

from ..field import TetField
from . import mma


def torch_finds_a_gpu() -> bool:
    """Whether the networks of `Evaluators` that are not `in_place` can be evaluated."""
    try:
        import torch
    except ModuleNotFoundError:  # as after an installation for viewing alone
        return False
    return torch.cuda.is_available()  # a CPU build of torch finds none


class Evaluators:
    """Both networks of a field on a CUDA device, with `half` in half precision; arrays are Warp's.

    Attributes:
        in_place: What evaluates them without allocating or waiting for anything, see mma.py; None
            where only torch does.
    """

    def __init__(self, field: TetField, device: wp.Device):
        self.in_place = mma.TensorCoreNetworks(field, device) if mma.fits(field, device) else None
        self._field, self._device = field, device
        self._networks = {}  # by precision

    def geometry(self, features, half: bool):
        """sigma [N] and h [N, 16] of features [N, L] vec4."""
        with self._of_torch(half) as networks:
            x = wp.to_torch(features).flatten(1)
            h = networks.density_features(x.half() if half else x)
            return wp.from_torch(networks.sigma(h)), wp.from_torch(h.float())

    def colors(self, h, basis, half: bool):
        """rgb [N] of h [N, 16] and basis [N] basis_vector."""
        with self._of_torch(half) as networks:
            h = wp.to_torch(h)
            rgb = networks.colors(h.half() if half else h, wp.to_torch(basis))
            return wp.from_torch(rgb, dtype=wp.vec3)

    @contextmanager
    def _of_torch(self, half):
        """The networks in torch, on Warp's stream: launches and layers follow without waiting."""
        import torch

        from .torch import TorchNetworks

        stream = torch.cuda.stream(wp.stream_to_torch(wp.get_stream(self._device)))
        with torch.no_grad(), stream:
            if half not in self._networks:
                networks = TorchNetworks(self._field.density_layers, self._field.color_layers)
                networks = networks.to(f"cuda:{self._device.ordinal}")
                self._networks[half] = networks.half() if half else networks
            yield self._networks[half]
