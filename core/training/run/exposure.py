"""Exposure and white balance of photographs: trained color maps, dropped after training.

A telephone changes both from photograph to photograph.  A field alone would explain that by
colors that depend on the direction, and by fog.  So let c be the color that the model renders for a
pixel of view i, and o its opacity.  The loss compares the photograph with

    c + M_i (c, o),    M_i = SCALE (θ_i − mean over views of θ),    θ_i [3, 4]

an affine map with an offset proportional to o, so transparent pixels stay black and backgrounds do
not change.  The mean of the maps is the identity, so the model keeps the mean look.  The loss adds
COST · mean over views of |SCALE θ_i|², which keeps a map near the identity unless its photograph
requires another one.
(Per-image affine maps: Urban Radiance Fields, Rematas et al., CVPR 2022, Section 4.2.)

Shapes: R rays, N views.
"""

import torch

SCALE = 0.1  # of a map over its parameters: Adam moves these by the field's learning rate
# Per view: a map that scales a mean squared color of 0.2 is off by 0.5 % of what it should do.
COST = 1e-3
GRAY = 0.5


class LearnedExposure(torch.nn.Module):
    """The color maps of all views, identities at first.

    Attributes:
        maps: θ.  [N, 3, 4]
    """

    def __init__(self, view_count: int, device):
        """`device` is torch's."""
        super().__init__()
        self.maps = torch.nn.Parameter(torch.zeros(view_count, 3, 4, device=device))

    def forward(self, color, opacity, views):
        """Colors as photographs show them, differentiable in all but the views.  torch [R, 3]

        Args:
            color: Without background, that is, times opacity.  [R, 3]
            opacity: [R]
            views: Of each ray.  int [R]
        """
        chosen = self._centered().index_select(0, views)
        return color + (chosen @ torch.cat([color, opacity[:, None]], dim=1)[..., None])[..., 0]

    def cost(self):
        """The maps' price.  torch []"""
        return COST * (SCALE * self.maps).square().sum(dim=(1, 2)).mean()

    def _centered(self):
        return SCALE * (self.maps - self.maps.mean(dim=0))

    @torch.no_grad()
    def spread(self) -> float:
        """Of the brightness in which the views show middle gray: its deviation over its mean."""
        gray = torch.tensor([GRAY, GRAY, GRAY, 1.0], device=self.maps.device)
        gains = (1.0 + (self._centered() @ gray).mean(dim=1) / GRAY).cpu().numpy()
        return float(gains.std() / gains.mean())
