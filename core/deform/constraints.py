"""Edge-length and tet-volume constraints: their vertices, rest values and compliances.

core/definition/solver.py defines constraints, their projection, and the term a that stands there in
place of α/(θh)².  This module adds

    edge:   α = 1/k_e,  k_e = 15 μ f V_e / L²;  f makes a lattice equally stiff in all directions
            (isotropy.py); thin parts have others (sheets.py)
    brace:  an edge of no tet (hinges.py)
    volume: α = 36 V0 / K_t;  K_t is the material's K, except on A15, where most tets have K_t = 0
            and the K_t of the others makes up for it (locking.py)
    spring: C = |x_i − target|,  α = 1/k, with a force of at most F.  It is projected last, so
            a = α/h².

Units: x [m], w [1/kg], L [m], 6 V0 [m³], K and μ [Pa]; a [1/kg] for edges and springs,
[m⁴/kg] for volumes.  Shapes: V vertices, E edges, B braces, T tets, K handles.
"""

from dataclasses import dataclass

import numpy as np

from ..definition.solver import (
    SECOND_SOFTENING,
    SWEEP_SOFTENING,
    volume_gradients,
)
from ..geometry import EDGES, color_order, signed_volumes
from .hinges import LONG_STIFFNESS, SHORT_VOLUME, hinge_braces
from .isotropy import edge_factors
from .kept_ratios import SheetRatios
from .locking import volume_shares
from .sheets import sheet_ratios

SMALLEST_SHARE = 1e-3  # of the mean volume or mass, for edges and vertices of flat tets alone
# A vertex that begins a substep below the ground, because it was held there or the ground came up,
# leaves it no faster, and without keeping that speed [m/s].
LEAVING_SPEED = 0.05
PRESS_SHARE = 1.0 / 16.0  # of a substep in the mean of a vertex's pushes, which bounds friction
NO_SPRING = -1.0  # in place of a, which is never negative
CONTACT_LOAD_UNIT = 2**20  # in place of 1 where weights are added up as integers
UNLIMITED = 3e38  # a longest move that no spring reaches


@dataclass(frozen=True)
class ColoredConstraints:
    """All constraints of one type, C of them with n vertices each, sorted by color."""

    vertices: np.ndarray  # [C, n] int32; the corners of a tet are in positive order
    rest_values: np.ndarray  # [C] L or 6 V0
    rest_gradients_squared: np.ndarray  # [C, n] |g_i|² at rest: 1, or of a tet in m⁴
    offsets: np.ndarray  # color c is offsets[c]:offsets[c + 1]
    classes: np.ndarray  # [C] the same for translates in a lattice (coloring.py)

    def weights(self, inverse_masses):
        """w̄ = Σ w_i |g_i|² at rest.  [C]"""
        return (inverse_masses[self.vertices] * self.rest_gradients_squared).sum(axis=1)

    def softened(self, compliances, factors):
        """Compliances [C] where Young's modulus is multiplied by factors at the vertices.  [V]"""
        return compliances / factors[self.vertices].mean(axis=1)

    def regularization(self, compliances, inverse_masses, reach, floor):
        """a = max(α/(θh)² − ½ w̄ − 0.07 w̄² (θh)²/α, f w̄).  [C]

        Args:
            reach: θh [s]
            floor: f, a number or [C]
        """
        weights = self.weights(inverse_masses)
        scaled = np.broadcast_to(compliances, weights.shape) / reach**2
        with np.errstate(divide="ignore", invalid="ignore"):
            a = scaled - SWEEP_SOFTENING * weights - SECOND_SOFTENING * weights**2 / scaled
        return np.fmax(a, floor * weights)  # also where both are 0


@dataclass(frozen=True)
class EdgeConstraints(ColoredConstraints):
    """Every edge and every brace once."""

    volumes: np.ndarray  # [E] V_e, a sixth of the volume of the tets around the edge
    factors: np.ndarray  # [E] f of the endless lattice
    sheet_ratios: SheetRatios  # what thin parts have instead, over f

    def compliances(self, shear_modulus):
        """α = L² / (15 μ f V_e), if the lattice were endless [m/N].  [E]"""
        return self.rest_values**2 / (15.0 * shear_modulus * self.factors * self.volumes)


@dataclass(frozen=True)
class VolumeConstraints(ColoredConstraints):
    """Every tet that has a volume."""

    shares: np.ndarray  # [T] K_t over the material's K (locking.py)

    @property
    def sparse(self) -> bool:
        """Whether only some tets hold the volume."""
        return not (self.shares > 0.0).all()

    def compliances(self, bulk_modulus, of_each=0.0):
        """α = 36 V0 / K_t [m⁵/N]; ∞ for a tet that holds nothing.  [T]

        Args:
            of_each: How much of the bulk modulus each tet holds; the holding ones hold the rest.
        """
        of_each = min(of_each, bulk_modulus)
        with np.errstate(divide="ignore"):
            return 6.0 * self.rest_values / (of_each + (bulk_modulus - of_each) * self.shares)


def edge_constraints(rest_vertices: np.ndarray, tets: np.ndarray) -> EdgeConstraints:
    """The edges of a mesh and the braces of its hinges, sorted by color.

    Raises:
        ValueError: All tets are flat.
    """
    ends, edge_of = np.unique(
        np.sort(tets[:, EDGES].reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    shares = np.repeat(np.abs(signed_volumes(rest_vertices, tets)) / 6.0, 6)
    volumes = np.bincount(edge_of.ravel(), weights=shares, minlength=len(ends))
    if not volumes.any():
        raise ValueError(f"no tet has a volume; all {len(tets)} are flat")
    # An edge between flat tets alone would have no stiffness.
    volumes = np.maximum(volumes, SMALLEST_SHARE * volumes.mean())
    lengths = np.linalg.norm(np.diff(rest_vertices[ends], axis=1)[:, 0], axis=1)
    factors = edge_factors(lengths)
    short, far = hinge_braces(rest_vertices, tets, lengths.mean())
    # A long brace is as stiff as a mean edge: its ends could not bear more.
    spans = np.linalg.norm(np.diff(rest_vertices[far], axis=1)[:, 0], axis=1)
    of_braces = np.append(
        np.full(len(short), SHORT_VOLUME), LONG_STIFFNESS * (spans / lengths.mean()) ** 2
    )
    volumes = np.append(volumes, of_braces * volumes.mean())
    of_tets = rest_vertices, tets, ends, edge_of.reshape(-1, 6), lengths
    ends = np.concatenate([ends, short, far])
    factors = np.append(factors, np.ones(len(of_braces)))
    order, offsets, classes = color_order(ends, rest_vertices)
    ends, volumes, factors = ends[order], volumes[order], factors[order]
    lengths = np.linalg.norm(rest_vertices[ends[:, 0]] - rest_vertices[ends[:, 1]], axis=1)
    common = ends.astype(np.int32), lengths, np.ones(ends.shape), offsets, classes

    none = np.stack([np.ones(len(of_braces)), np.zeros(len(of_braces))])
    thin = SheetRatios(
        lambda: sheet_ratios(*of_tets),
        lambda ratios: np.concatenate([ratios, none], axis=1)[:, order],
        rest_vertices,
        tets,
    )
    return EdgeConstraints(*common, volumes, factors, thin)


def volume_constraints(rest_vertices: np.ndarray, tets: np.ndarray) -> VolumeConstraints:
    """The tets of a mesh that aren't flat, positively oriented, sorted by color."""
    volumes = 6.0 * signed_volumes(rest_vertices, tets)
    tets = np.where((volumes < 0)[:, None], tets[:, [0, 1, 3, 2]], tets)
    solid = np.abs(volumes) > 1e-6 * np.abs(volumes).mean()
    tets, volumes = tets[solid], np.abs(volumes[solid])
    order, offsets, classes = color_order(tets, rest_vertices)
    tets, volumes = tets[order], volumes[order]
    gradients = volume_gradients(rest_vertices, tets)
    shares = volume_shares(rest_vertices, tets, volumes)
    return VolumeConstraints(
        tets.astype(np.int32), volumes, (gradients**2).sum(-1), offsets, classes, shares
    )


def lumped_masses(rest_vertices: np.ndarray, tets: np.ndarray, density: float) -> np.ndarray:
    """A quarter of each tet's mass to each of its corners [kg].  [V]

    A vertex without a tet has no mass.  A vertex of flat tets alone has a small one: without
    mass it would be kinematic and pin its neighbors.
    """
    shares = np.repeat(density * np.abs(signed_volumes(rest_vertices, tets)) / 4.0, 4)
    masses = np.bincount(tets.ravel(), weights=shares, minlength=len(rest_vertices))
    used = np.unique(tets)
    masses[used] = np.maximum(masses[used], SMALLEST_SHARE * masses[used].mean())
    return masses


def spring_coefficients(stiffness, force_limit, inverse_masses, substep):
    """a = 1/(k h²) [1/kg] and the longest move w F h² [m] of a spring.  [K, 2]

    Args:
        stiffness: k [N/m].  [K]
        force_limit: F [N].  [K]
        inverse_masses: w.  [K]
    """
    a = 1.0 / (np.asarray(stiffness) * substep**2)
    longest = inverse_masses * np.minimum(force_limit, UNLIMITED) * substep**2
    longest = np.minimum(longest, UNLIMITED)
    return np.stack(np.broadcast_arrays(a, longest), axis=-1)
