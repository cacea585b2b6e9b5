"""The networks in torch: for training, and for rendering on CUDA in float32.

Loading torch takes seconds, so import this module only inside functions that need it.
"""

import torch
from torch import nn

from ...definition.networks import MAX_LOG_SIGMA
from .shapes import Layers


class TruncatedExp(torch.autograd.Function):
    """exp with a gradient that stays finite (Instant-NGP's truncated exponential)."""

    @staticmethod
    def forward(ctx, x):
        y = torch.exp(x.clamp(max=MAX_LOG_SIGMA))
        ctx.save_for_backward(y)
        return y

    @staticmethod
    def backward(ctx, gradient):
        (y,) = ctx.saved_tensors
        return gradient * y


class TorchNetworks(nn.Module):
    """Both networks as torch modules, with gradients."""

    def __init__(self, density_layers: Layers, color_layers: Layers):
        super().__init__()
        self.density = nn.ModuleList(_linear(w, b) for w, b in density_layers)
        self.color = nn.ModuleList(_linear(w, b) for w, b in color_layers)

    def density_features(self, features: torch.Tensor) -> torch.Tensor:
        """[N, L·F] -> h [N, 16]"""
        for layer in self.density[:-1]:
            features = torch.relu(layer(features))
        return self.density[-1](features)

    def sigma(self, h: torch.Tensor) -> torch.Tensor:
        """Density per unit of rest length, float32.  [N]"""
        return TruncatedExp.apply(h[:, 0].float())

    def logits(self, h: torch.Tensor, basis: torch.Tensor) -> torch.Tensor:
        """What `colors` takes the sigmoid of, float32.  [N, 3]"""
        x = torch.cat([h, basis.to(h.dtype)], dim=1)
        for layer in self.color[:-1]:
            x = torch.relu(layer(x))
        return self.color[-1](x).float()

    def colors(self, h: torch.Tensor, basis: torch.Tensor) -> torch.Tensor:
        """rgb [N, 3], float32, of what the density network gives [N, 16] and directions [N, 16]."""
        return torch.sigmoid(self.logits(h, basis))

    def forward(
        self, features: torch.Tensor, basis: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """sigma [N] and rgb [N, 3], both float32."""
        h = self.density_features(features)
        return self.sigma(h), self.colors(h, basis)

    def evaluate(
        self, features: torch.Tensor, basis: torch.Tensor, sample_count: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """`forward`, by the fused kernels where they fit (triton.py).

        Args:
            sample_count: Number of existing samples, at most N, int32 [1] on the device; None for
                all.  The fused kernels skip the others and give no values for them.
        """
        if features.is_cuda:
            from . import triton

            if triton.fits(self):
                return triton.evaluate(self, features, basis, sample_count)
        return self(features, basis)

    def geometry(
        self, features: torch.Tensor, sample_count: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """sigma [N] and h [N, 16], both float32; otherwise as `evaluate`."""
        if features.is_cuda:
            from . import triton

            if triton.density_fits(self):
                return triton.evaluate_density(self, features, sample_count)
        h = self.density_features(features).float()
        return self.sigma(h), h

    def layers(self) -> tuple[Layers, Layers]:
        """Density and color layers as NumPy arrays (weights [in, out], bias [out])."""

        def arrays(layer):
            weight, bias = (p.detach().float().cpu().numpy() for p in (layer.weight, layer.bias))
            return weight.T.copy(), bias.copy()

        return tuple(tuple(map(arrays, layers)) for layers in (self.density, self.color))


def _linear(weights, bias):
    layer = nn.Linear(*weights.shape)
    with torch.no_grad():
        layer.weight.copy_(torch.from_numpy(weights.T.copy()))
        layer.bias.copy_(torch.from_numpy(bias.copy()))
    return layer
