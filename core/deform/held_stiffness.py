"""What substeps of a given length hold of a material's stiffness.

A constraint is as stiff as its compliance α says while r = α/(w̄ h²) is large enough: a, which
stands for α/(θh)² (definition/solver.py), has a floor.  Below it the substep decides, not Young's
modulus.

    edges    E_h = E / (1 + (0.53/(s r))^3.5)^(1/3.5), r the median over edges (Material); s is 1 as
             long as nobody has pulled the body to find it out (pull_test.py)
    volumes  K_h = K / mean(max(1, θ² (f + ½)/r)), f their floor; the mean is over the volumes for
             which tets hold K, since neighbors share a pressure.  A load then meets
             E(μ, K_h)/E(μ, K) of E.

Nearly incompressible bodies reach the floor of the volumes first.  A cantilever of 4,852 tets sags
too much by the share 0.36 (μ/K_h − μ/K) of its sag, from ν = 0.45 to 0.49 and 24 to 40 substeps
(measured, within a tenth of that); by E(μ, K_h) it would be 0.33.

Shapes: E edges and T tets that can move.
"""

import math
from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from ..definition.solver import SWEEP_SOFTENING
from .material import Material
from .xpbd_options import (
    FIRST_INTEGRATOR,
    INTEGRATORS,
    STIFF,
    TIME_STEP,
    Integrator,
    XpbdOptions,
    automatic_counts,
)

HELD_SHARE = 0.98  # of E: substeps that hold less soften the material


@dataclass(frozen=True)
class HeldStiffness:
    """The stiffness of one body, as a function of the length of its substeps, h [s]."""

    material: Material
    options: XpbdOptions
    edges: np.ndarray  # α and w̄ [m/N, 1/kg].  [2, E]
    volumes: np.ndarray  # α and w̄ [m⁵/N, m⁴/kg], and the volumes of which the tets hold K.  [3, T]
    sparse: bool  # whether only some tets hold the volume

    @classmethod
    def of(cls, material, options, edges, volumes, edge_alphas, volume_alphas, inverse_masses):
        """That of what can move.

        Args:
            edges, volumes: All constraints.
            edge_alphas: α [m/N].  [E] or a number
            volume_alphas: α [m⁵/N].  [T] or a number; None without volumes
            inverse_masses: 0 where a vertex can't move [1/kg].  [V]
        """
        weights = edges.weights(inverse_masses)
        of_edges = np.stack([np.broadcast_to(edge_alphas, weights.shape), weights])
        of_volumes = np.empty((3, 0))
        if volume_alphas is not None:
            of_each = volumes.weights(inverse_masses)
            held = volumes.shares * volumes.rest_values
            of_volumes = np.stack([np.broadcast_to(volume_alphas, of_each.shape), of_each, held])
            of_volumes = of_volumes[:, (of_each > 0) & (volumes.shares > 0)]
        return cls(material, options, of_edges[:, weights > 0], of_volumes, volumes.sparse)

    def ratio(self, h) -> float:
        """The median r of the edges; nan if there are none."""
        alphas, weights = self.edges
        return float(np.median(alphas / (weights * h * h))) if len(alphas) else math.nan

    def integrator(self, h) -> Integrator:
        """How substeps move on where nothing needs damping."""
        usual, of_stiff, _ = INTEGRATORS[self.options.integrator]
        return of_stiff if self.ratio(h) < STIFF else usual

    def young_modulus(self, h, floor_share=1.0) -> float:
        """The E that a load meets [Pa].

        Args:
            floor_share: How much of it, over this estimate, it meets where all constraints are at
                their floor (pull_test.py).
        """
        ratio = self.ratio(h)
        if self.options.integrator == FIRST_INTEGRATOR:
            return self.material.first_young_modulus_at(ratio)
        of_volumes = self._share_of_bulk_modulus(h)
        return self.material.young_modulus_at(ratio * floor_share, of_volumes)

    def _share_of_bulk_modulus(self, h):
        """K_h / K."""
        alphas, weights, held = self.volumes
        if not len(alphas):
            return 1.0
        theta, floor, sparse_floor = self.integrator(h)
        at_floor = theta**2 * ((sparse_floor if self.sparse else floor) + SWEEP_SOFTENING)
        with np.errstate(divide="ignore"):
            softened = np.maximum(1.0, at_floor * weights * h * h / alphas)
        return 1.0 / np.average(softened, weights=held)

    def least_count(self, edge_count) -> int:
        """The least number of substeps per 1/60 s with which a load meets HELD_SHARE of E.

        It is one of automatic_counts(), the last if none is enough.

        Args:
            edge_count: Of the mesh.
        """
        counts = automatic_counts(edge_count)
        wanted = HELD_SHARE * self.material.young_modulus

        def holds(count):
            # What can't move is not softened: its r is nan.
            return not self.young_modulus(TIME_STEP / count) < wanted

        return counts[bisect_left(counts[:-1], True, key=holds)]
