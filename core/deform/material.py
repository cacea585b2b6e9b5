"""The object's material in SI units, and the stiffnesses of its constraints.

Edges are springs of the shear modulus μ, with Lamé constants λ = μ, that is, Poisson's ratio 1/4.
Volume constraints of bulk modulus K = λ − μ ≥ 0 add the rest.

    E Young's modulus [Pa], ν Poisson's ratio, μ = E / (2 (1 + ν)) [Pa]
    λ = E ν / ((1 + ν)(1 − 2ν)) [Pa], K [Pa]
"""

import math
import warnings
from dataclasses import dataclass

import numpy as np

from . import checks
from .constraints import EdgeConstraints, VolumeConstraints

LOWEST_POISSON_RATIO = 0.25


@dataclass(frozen=True)
class Material:
    """An elastic solid.  Model space is one meter wide.

    The default is stiff enough that a thin neck straightens again within a few seconds,
    and soft enough that 24 substeps hold its stiffness on a grid of edge 0.045.  Springs and
    volume constraints can't represent a Poisson's ratio below 1/4; 1/4 is held instead, with a
    warning.

    Raises:
        ValueError: A value is out of range.
    """

    young_modulus: float = 1e6  # E [Pa]
    poisson_ratio: float = 0.35  # ν, below 1/2
    density: float = 1000.0  # mass per rest volume [kg/m³]
    # Rate at which velocities decay [1/s], whatever the substeps.  It spares the rigid motion of
    # parts that nothing holds.
    damping: float = 3.5
    yield_strain: float = math.inf  # edges keep what exceeds it (rest_shape.py); inf: none do

    def __post_init__(self):
        checks.number("material's young_modulus", self.young_modulus, positive=True)
        checks.number("material's density", self.density, positive=True)
        checks.number("material's damping", self.damping)
        if not 0.0 < self.yield_strain:
            raise ValueError(f"the yield strain is {self.yield_strain}; give a positive number")
        if not -1.0 < self.poisson_ratio < 0.5:
            raise ValueError(f"Poisson's ratio is {self.poisson_ratio}; give one in (-1, 0.5)")
        if self.poisson_ratio < LOWEST_POISSON_RATIO:
            warnings.warn(
                f"Poisson's ratio {self.poisson_ratio} is below {LOWEST_POISSON_RATIO}, "
                f"which springs can't represent; {LOWEST_POISSON_RATIO} is held instead",
                stacklevel=3,
            )

    @property
    def held_poisson_ratio(self) -> float:
        """The ratio that the constraints represent."""
        return max(self.poisson_ratio, LOWEST_POISSON_RATIO)

    @property
    def shear_modulus(self) -> float:
        """μ [Pa]; E / 2.5 where ν ≤ 1/4."""
        return self.young_modulus / (2.0 * (1.0 + self.held_poisson_ratio))

    @property
    def bulk_modulus(self) -> float:
        """K = λ − μ [Pa] of the volume constraints; 0 means that there are none."""
        ratio = self.held_poisson_ratio
        # λ − μ = μ (4ν − 1) / (1 − 2ν), which is exactly 0 at 1/4.
        return self.shear_modulus * (4.0 * ratio - 1.0) / (1.0 - 2.0 * ratio)

    def compliances(
        self, edges: EdgeConstraints, volumes: VolumeConstraints
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """α of edge constraints [m/N], and of volume constraints [m⁵/N] or None if K is 0.

        Edges have those of the endless lattice; XpbdSolver.compliances has those of thin parts.
        """
        bulk = self.bulk_modulus
        of_volumes = volumes.compliances(bulk) if bulk > 0 else None
        return edges.compliances(self.shear_modulus), of_volumes

    def young_modulus_at(self, stiffness_ratio: float, share_of_bulk_modulus: float = 1.0) -> float:
        """The E that a load meets at r = α/(w h²) [Pa]: E / (1 + (0.53/r)^3.5)^(1/3.5).

        For large r the body has E; for small r all constraints are at their floor, and E does not
        matter.  How stiff it then is depends on the body, which XpbdSolver.held_young_modulus
        pulls to find it out: it multiplies r by what it found.

        Args:
            share_of_bulk_modulus: How much of K the volume constraints hold, 0 to 1.  With less,
                E falls as that of an elastic solid of μ and K does.
        """
        whole, held = (
            1.0 / (1.0 + self.shear_modulus / (3.0 * (k + 5.0 / 3.0 * self.shear_modulus)))
            for k in (self.bulk_modulus, share_of_bulk_modulus * self.bulk_modulus)
        )
        modulus = self.young_modulus * held / whole
        if stiffness_ratio < 1e-6:
            return modulus * stiffness_ratio / 0.53
        return modulus / (1.0 + (0.53 / stiffness_ratio) ** 3.5) ** (1.0 / 3.5)

    def first_young_modulus_at(self, stiffness_ratio: float) -> float:
        """The same of the first integrator, whose soft grabs follow it: E / (1 + (c/r)^2.5)^0.4."""
        c = 0.32 + 0.035 * math.log1p(self.bulk_modulus / self.shear_modulus)
        if stiffness_ratio < 1e-6:
            return self.young_modulus * stiffness_ratio / c
        return self.young_modulus / (1.0 + (c / stiffness_ratio) ** 2.5) ** 0.4


# All above ν = 1/4: edges alone can't tell a tet from its mirror image, volumes can.
PRESETS = {
    "jelly": Material(young_modulus=1e5, poisson_ratio=0.45, density=1000.0, damping=2.5),
    "rubber": Material(young_modulus=1e6, poisson_ratio=0.40, density=1100.0, damping=3.5),
    "plush": Material(young_modulus=1e5, poisson_ratio=0.30, density=300.0, damping=6.0),
    "clay": Material(
        young_modulus=1e6, poisson_ratio=0.40, density=1500.0, damping=8.0, yield_strain=0.03
    ),
    # As stiff as the substeps allow: those that a frame has time for hold some 100 MPa of the
    # bundled model.
    "stiff": Material(young_modulus=1e9, poisson_ratio=0.35, density=600.0, damping=4.0),
}
