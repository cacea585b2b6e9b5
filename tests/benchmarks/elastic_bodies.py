"""Bodies that dynamics.py measures, the loads that it puts on them, and what references say.

Loads are gravities under which a linear body moves by a given share of its size, so that a
soft and a stiff body give way alike.

Units: SI.  Shapes: V vertices.
"""

import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from beams import Beam, beam, region
from contact_scenes import box, joined

sys.path.append(str(Path(__file__).resolve().parents[1] / "support"))
from finite_elements import Solid, quadratic
from scipy import sparse
from scipy.sparse.linalg import eigsh

from deformrf.core import field as fields
from deformrf.core.base.paths import BUNDLED
from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver
from deformrf.core.geometry import A15
from deformrf.wings.lab.dynamics.energy import material_energy
from deformrf.wings.lab.dynamics.measure import (
    SETTLING_FRAMES,
    STILL,
    HeldMesh,
    LoadCase,
    response,
    standing,
)
from deformrf.wings.lab.dynamics.references import free_dofs

MODES = 6  # those nearest to a frequency; the solver's own modes are mixtures of them
AWAKE = {"sleep_motion": 0.0, "rescue": False}  # what a reference doesn't do
CELL, SHEET_LENGTH, SHEET_WIDTH, SLACK = 1 / 12, 8, 4, 1e-9  # m, cells, cells, m
CUBE, CUBE_CELLS, GAP = 0.2, 4, 1e-3  # m; the gap is that between cubes before they fall


@dataclass(frozen=True)
class Load(LoadCase):
    """A body under a gravity, with contact or without."""

    contact: bool = True

    def solver(self, substep_count, device):
        options = {"gravity": self.gravity, "contact": self.contact, **AWAKE}
        return make_solver(self.body, self.material, substep_count, device, **options)

    @property
    def response(self):
        """Displacements of a linear body.  [V, 3]"""
        rest, _, held = self.body
        return response(self.energy, rest, held, self.gravity)

    def settled(self, substep_count, device):
        """The solver, when it is still, and its displacements.  [V, 3]"""
        solver, size = self.solver(substep_count, device), longest_side(self.body.rest)
        before, now = self.body.rest + size, self.body.rest
        for _ in range(0, SETTLING_FRAMES, 30):
            if np.abs(now - before).max() < STILL * size:
                break
            for _ in range(30):
                solver.step(TIME_STEP)
            before, now = now, solver.vertices.numpy().astype(np.float64)
        return solver, now - self.body.rest


def make_solver(body: HeldMesh, material, substep_count, device, **options) -> XpbdSolver:
    """The program's solver with its default options but for these."""
    options = XpbdOptions(substep_count=substep_count, **options)
    return XpbdSolver(body.rest, body.tets, material, body.held, options, device)


def default_count(body: HeldMesh, material) -> int:
    """The substeps that the program takes for a body of this material."""
    solver = XpbdSolver(body.rest, body.tets, material, body.held)
    follows = getattr(solver, "substeps_that_hold", None)  # older programs take one number for all
    return follows() if follows else solver.options.substep_count


def load(body, scene, direction, share, material=None, contact=True) -> Load:
    """A gravity along a direction [3] that moves a linear body by a share of its size."""
    material = material or Material()
    case = Load(body, scene, tuple(map(float, direction)), material, contact)
    most = np.linalg.norm(case.response, axis=1).max()
    strength = share * longest_side(body.rest) / most
    return replace(case, gravity=tuple((strength * np.array(case.gravity)).tolist()))


def longest_side(vertices) -> float:
    return float(np.ptp(vertices, axis=0).max())


def bundled(model) -> HeldMesh:
    """A model, "helmet", "fox" or a file, on its default pins."""
    return standing(fields.load(BUNDLED.get(model, model)).mesh)


def free(body: HeldMesh) -> HeldMesh:
    return body._replace(held=np.zeros(len(body.rest), bool))


def held_beam(body: Beam) -> HeldMesh:
    """As the solver's float32 has it."""
    rest = body.mesh.rest_vertices.astype(np.float32).astype(np.float64)
    return HeldMesh(rest, body.mesh.tets, body.clamped)


def cantilever(spacing) -> Beam:
    """A beam of A15: 1,408 tets with a spacing of 1/32, 4,852 with 1/48."""
    return beam(A15, spacing)


def sheet(cells, cut) -> Beam:
    """A sheet of A15 along x, clamped at x ≤ 0.

    Args:
        cells: Its thickness.
        cut: Where its lower face is in a cell of the lattice, 0 to 1: surfaces differ by it.
    """
    low = CELL * np.array([-1.0, -SHEET_WIDTH / 2, cut])
    high = CELL * np.array([SHEET_LENGTH, SHEET_WIDTH / 2, cut + cells])

    def inside(centers):
        return ((centers > low + SLACK) & (centers < high - SLACK)).all(axis=1)

    mesh = region(A15, CELL / A15.cell_edge, low, high, inside)
    clamped = mesh.rest_vertices[:, 0] <= SLACK
    return Beam(mesh, high[0], clamped, area=np.nan, second_moment=np.nan)


def stack(count) -> HeldMesh:
    """Cubes on top of each other, free."""
    rest, tets = box((CUBE_CELLS,) * 3, CUBE / CUBE_CELLS)
    step = np.array([0.0, 0.0, CUBE + GAP])
    cubes = [(rest + k * step, tets) for k in range(count)]
    rest, tets, _ = joined(*cubes)
    return HeldMesh(rest, tets, np.zeros(len(rest), bool))


def energy_of(body: HeldMesh, material):
    """What the solver minimizes."""
    return material_energy(body.rest, body.tets, material)


def quadratic_sag(body: Beam, material, gravity):
    """Displacements of the vertices by quadratic elements on the same tets.  [V, 3]"""
    rest = body.mesh.rest_vertices
    mesh = quadratic(rest, body.mesh.tets, body.clamped)
    lame = material.bulk_modulus + material.shear_modulus
    solid = Solid(mesh, lame, material.shear_modulus, material.density)
    return solid.sag(gravity)[: len(rest)]


def modes(body, energy, frequency):
    """The modes nearest to a frequency [Hz], it first: ω [MODES] 1/s, shapes [MODES, V, 3].

    Shapes have mass 1: Σ m |shape|² = 1.
    """
    dofs = free_dofs(body.held)
    roots = 1.0 / np.sqrt(np.repeat(energy.masses, 3)[dofs])
    scale = sparse.diags_array(roots)
    matrix = (scale @ energy.hessian(body.rest)[dofs][:, dofs] @ scale).tocsc()
    start = np.random.default_rng(0).normal(size=len(dofs))
    squares, vectors = eigsh(matrix, MODES, sigma=(2.0 * math.pi * frequency) ** 2, v0=start)
    omegas = np.sqrt(squares)
    order = np.argsort(np.abs(omegas - 2.0 * math.pi * frequency))
    shapes = np.zeros((MODES, body.rest.size))
    shapes[:, dofs] = (roots[:, None] * vectors[:, order]).T
    return omegas[order], shapes.reshape(MODES, -1, 3)
