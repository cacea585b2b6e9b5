"""Static poses in float64 of the energies that NVIDIA Newton's tets have, for xpbd_peers.py.

    stable    Σ V0 (½ μ (tr FᵀF − 3) + ½ (λ + μ) (J − 1 − μ/(λ + μ))²)
    split     ½ Σ V0 (μ (tr FᵀF − 3)² + λ (J − 1)²)

Each less Σ m g·x.  Newton's method: derivatives are PyTorch's, linear systems are left to
conjugate gradients, which stop where the energy is concave (Steihaug).  Our own energy has
wings/lab/dynamics/references.py.

Units: SI.  Shapes: V vertices, T tets.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

NEWTON_STEPS = 25
CONJUGATE_STEPS = 1000
TOLERANCE = 1e-9  # of the weight


def stable(squared, stretch, mu, lame):
    """J/m³, of tr FᵀF − 3 and J."""
    bulk = lame + mu
    return 0.5 * mu * squared + 0.5 * bulk * (stretch - 1.0 - mu / bulk) ** 2


def split(squared, stretch, mu, lame):
    return 0.5 * mu * squared**2 + 0.5 * lame * (stretch - 1.0) ** 2


DENSITIES = {"stable": stable, "split": split}


@dataclass(frozen=True)
class Solids:
    """A mesh of one material."""

    rest: np.ndarray  # [V, 3]
    tets: np.ndarray  # [T, 4], of positive volume
    density: Callable  # energy per volume; see stable
    mu: float  # [Pa]
    lame: float  # λ [Pa]

    def rest_pose(self, start, held, weights, device):
        """The equilibrium near a pose whose held vertices are where they shall be.  [V, 3]

        Args:
            start: [V, 3]
            held: [V] bool
            weights: m g.  [V, 3] N
            device: "cpu" or "cuda"

        Raises:
            RuntimeError: None was found.
        """
        tets = torch.as_tensor(self.tets, device=device).long()
        rest, x, loads = (torch.as_tensor(a, device=device) for a in (self.rest, start, weights))
        free = torch.as_tensor(~held, device=device)[:, None]
        inverses = torch.linalg.inv(spans(rest, tets))
        volumes = 1.0 / (6.0 * torch.linalg.det(inverses))

        def energy(x):
            deformations = spans(x, tets) @ inverses  # F
            a, b, c = deformations.unbind(2)
            stretch = (torch.linalg.cross(a, b) * c).sum(1)  # J
            squared = deformations.square().sum((1, 2)) - 3.0
            stored = (volumes * self.density(squared, stretch, self.mu, self.lame)).sum()
            return stored - (loads * (x - rest)).sum()

        gradient = torch.func.grad(energy)
        for _ in range(NEWTON_STEPS):
            force = -gradient(x) * free
            left = float(force.norm() / loads.norm())
            if left < TOLERANCE:
                return x.cpu().numpy()
            way = descent(lambda p, x=x: torch.func.jvp(gradient, (x,), (p,))[1] * free, force)
            here, slope, step = energy(x), (force * way).sum(), 1.0
            rounding = 1e-14 * abs(here)
            while step > 1e-9 and energy(x + step * way) > here - 1e-4 * step * slope + rounding:
                step *= 0.5
            x = x + step * way
        raise RuntimeError(
            f"no equilibrium of '{self.density.__name__}' in {NEWTON_STEPS} steps of Newton's"
            f" method: forces of {left:.1e} of the weight are left"
        )


def spans(x, tets):
    """Corners 1 to 3 minus corner 0, as columns.  [T, 3, 3]"""
    corners = x.index_select(0, tets.flatten()).view(-1, 4, 3)
    return (corners[:, 1:] - corners[:, :1]).mT


def descent(hessian, force):
    """hessian⁻¹ force, as far as conjugate gradients get.  [V, 3]"""
    way, residual, along = torch.zeros_like(force), force, force
    squared = whole = force.square().sum()
    for _ in range(CONJUGATE_STEPS):
        curved = hessian(along)
        curvature = (along * curved).sum()
        if curvature <= 0.0:
            return way if way.any() else force
        length = squared / curvature
        way, residual = way + length * along, residual - length * curved
        before, squared = squared, residual.square().sum()
        if squared < 1e-6 * whole:
            break
        along = residual + (squared / before) * along
    return way
