"""Beams and balls that are cut from a lattice, and what beam theory needs of them.

A beam cut from A15 or BCC has a ragged surface, so its section is taken from the mesh: over
all tets whose centers lie in a stretch of s whole cells (integrals that are exact),

    A = 1/s ∫ dV,   I = 1/s ∫ (z − z̄)² dV

Units: m.  Shapes: V vertices, T tets.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from deformrf.core.geometry import (
    Lattice,
    TetMesh,
    cell_tets,
    extract,
    face_components,
    morton_order,
    signed_volumes,
    tet_neighbours,
)


@dataclass(frozen=True)
class Beam:
    """Along x, clamped at x ≤ 0 and free at x = length; z is up."""

    mesh: TetMesh  # a little of it is inside the clamp, x < 0
    length: float  # ℓ
    clamped: np.ndarray  # [V] bool
    area: float  # A
    second_moment: float  # I, for bending in the xz plane

    def tip(self, vertices):
        """Where the beam's free end is: the mean over its last twentieth, carried on to ℓ.  [3]"""
        x = self.mesh.rest_vertices[:, 0]
        last = x > 0.9 * self.length
        design = np.stack([np.ones(last.sum()), x[last] - self.length], axis=1)
        return np.linalg.lstsq(design, vertices[last], rcond=None)[0][0]

    def bending_sag(self, masses, young_modulus, gravity=9.81):
        """Euler–Bernoulli: how far the tip hangs down under the beam's own weight.

            Σ m g x² (3ℓ − x) / (6 E I),   in the limit ρ A g ℓ⁴ / (8 E I)

        Summed over the vertices' masses, as a ragged end weighs a little more or less.
        """
        x = np.where(self.clamped, 0.0, self.mesh.rest_vertices[:, 0])
        load = (masses * gravity * x**2 * (3.0 * self.length - x)).sum()
        return float(load / (6.0 * young_modulus * self.second_moment))

    def shear_sag(self, masses, shear_modulus, gravity=9.81, coefficient=5 / 6):
        """What shear adds (Timoshenko): Σ m g x / (κ μ A), κ = 5/6 for a rectangle."""
        x = np.where(self.clamped, 0.0, self.mesh.rest_vertices[:, 0])
        return float((masses * gravity * x).sum() / (coefficient * shear_modulus * self.area))


def beam(lattice: Lattice, spacing, length=1.0, width=0.25) -> Beam:
    """A square beam: the tets of a lattice whose centers are in the box.

    Args:
        spacing: dx; width should be a whole number of cells, or it isn't symmetric.
    """
    cell = lattice.cell_edge * spacing
    half = width / 2
    slack = 1e-9

    def inside(centers):
        x, y, z = centers.T
        across = np.maximum(np.abs(y), np.abs(z)) < half - slack
        return across & (x > -cell) & (x < length - slack)

    offset = np.array([0.0, half, half]) / spacing
    mesh = region(lattice, spacing, [-cell, -half, -half], [length, half, half], inside, offset)
    centers = mesh.rest_vertices[mesh.tets].mean(axis=1)
    stretch = max(1, int(0.5 * length / cell)) * cell
    middle = (centers[:, 0] > cell - slack) & (centers[:, 0] < cell + stretch - slack)
    volumes = signed_volumes(mesh.rest_vertices, mesh.tets[middle])
    z = mesh.rest_vertices[mesh.tets[middle], 2]
    # ∫ z² over a tet is V/20 (Σ z_i² + (Σ z_i)²).
    squares = (volumes / 20.0 * ((z**2).sum(axis=1) + z.sum(axis=1) ** 2)).sum()
    total = volumes.sum()  # 0 where a beam is too coarse to have a section
    mean = (volumes * z.mean(axis=1)).sum() / total if total > 0 else 0.0
    return Beam(
        mesh=mesh,
        length=length,
        clamped=mesh.rest_vertices[:, 0] <= slack,
        area=float(total / stretch),
        second_moment=float((squares - total * mean**2) / stretch),
    )


def ball(lattice: Lattice, spacing, radius=0.5) -> TetMesh:
    """The tets of a lattice whose centers are within a radius of the origin."""
    reach = [radius + lattice.cell_edge * spacing] * 3

    def inside(centers):
        return np.linalg.norm(centers, axis=1) < radius

    return region(lattice, spacing, -np.array(reach), np.array(reach), inside)


def region(lattice: Lattice, spacing, low, high, inside, offset=(0, 0, 0)) -> TetMesh:
    """Whichever tets between two corners have their centers inside, in one piece.

    Args:
        low, high: Corners of a box that holds the region.  [3] m
        inside: Of centers [T, 3] m to [T] bool.
        offset: Where the lattice's origin is in the box from its center line, in dx.  [3]

    Tets that hang on one face are left out: trimming again and again until there are none.

    Raises:
        ValueError: Nothing is left.
    """
    edge = lattice.cell_edge
    shift = np.asarray(offset)
    first = np.floor((np.asarray(low) / spacing + shift) / edge).astype(int) - 1
    last = np.ceil((np.asarray(high) / spacing + shift) / edge).astype(int) + 1
    cells = np.array(list(product(*map(range, first, last)))) * edge
    corners = (cells[:, None, None] + cell_tets(lattice)[None]).reshape(-1, 4, 3)
    corners = corners[inside((corners.mean(axis=1) - shift) * spacing)]
    corners = corners[morton_order((corners.sum(axis=1) - corners.sum(axis=1).min(axis=0)) // 4)]
    addresses, ids = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    order = morton_order(addresses - addresses.min(axis=0))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    addresses = addresses[order].astype(np.int32)
    tets = rank[ids.reshape(-1, 4)].astype(np.int32)
    mesh = TetMesh((addresses - shift) * spacing, addresses, tets)
    while len(mesh.tets):
        neighbours = tet_neighbours(mesh.tets)
        held = (neighbours >= 0).sum(axis=1) > 1
        labels = face_components(neighbours, held)
        keep = held & (labels == np.bincount(labels[held], minlength=1).argmax())
        if keep.all():
            return mesh
        mesh, _ = extract(mesh, keep)
    raise ValueError(f"a spacing of {spacing} leaves no tet of the body; give a smaller one")
