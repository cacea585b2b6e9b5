"""Cantilevers of about 5,000 tets: the solver and its energy beside quadratic finite elements.

    python tests/benchmarks/cantilevers.py [--lattices a15 bcc kuhn] [--ratios 0.25 0.35]

A beam of 1 m, E = 0.2 MPa, hangs by 1.4 % of its length, so strains are small; then it swings.
Its tip's sag and its lowest frequency, of

    elements    quadratic tets on the beam's own tets
    converged   the same, extrapolated from the beam's tets and eight times as many
    energy      edges and volumes, with the solver's masses (wings/lab/dynamics/energy.py)
    solver      XpbdSolver with many substeps, from the energy's equilibrium

All are of one body: what a mesh encloses, held where all corners of a tet, a face or an edge are.
"""

import argparse
import json
import math

import numpy as np
from beams import beam
from finite_elements import Solid, quadratic
from scipy import sparse

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver
from deformrf.core.geometry import A15, BCC, KUHN
from deformrf.wings.lab.dynamics.energy import material_energy
from deformrf.wings.lab.dynamics.references import factorize, free_dofs

SPACINGS = {"a15": (A15, 1 / 48), "bcc": (BCC, 1 / 40), "kuhn": (KUHN, 1 / 24)}
RATIOS = (0.25, 0.35, 0.40, 0.45, 0.49)
MODULUS, DENSITY = 2e5, 1000.0
GRAVITY = (0.0, 0.0, -0.1)
# What a subdivision leaves of the change by the one before: 0.37 to 0.44, on beams of 0.5 m
# with 550 to 900, 8 and 64 times as many tets.  The clamp's edge and the ragged surface decide.
LEFT = 0.4
SUBSTEPS = 120  # of a 60th of a second
STILL_SECONDS, SWING_SECONDS = 4.0, 5.0


def tip_sag(body, u):
    return -float(body.tip(u[: body.mesh.vertex_count])[2])


def elements(body, lame, mu):
    """Sag [m] and frequency [Hz] by quadratic elements: on the beam's tets, and converged."""
    mesh = quadratic(body.mesh.rest_vertices, body.mesh.tets, body.clamped)
    coarse = Solid(mesh, lame, mu, DENSITY)
    sag = coarse.sag(GRAVITY)
    frequency, mode = coarse.lowest_mode(sag)
    fine = Solid(mesh.subdivided(), lame, mu, DENSITY, coarse)
    finer = tip_sag(body, fine.sag(GRAVITY)), fine.lowest_mode(mesh.prolongation() @ mode, 1)[0]
    own = np.array([tip_sag(body, sag), frequency])
    return own, own + (finer - own) / (1.0 - LEFT)


def network(body, energy):
    """Sag [m], frequency [Hz], the pose at rest and the mode of the energy, for small strains."""
    rest = body.mesh.rest_vertices
    dofs = free_dofs(body.clamped)
    stiffness = energy.hessian(rest)[dofs][:, dofs]
    factors = factorize(stiffness)
    masses = np.repeat(energy.masses, 3)
    u = np.zeros(rest.size)
    u[dofs] = factors.solve((masses * np.tile(GRAVITY, len(rest)))[dofs])
    weights = sparse.diags_array(masses[dofs])
    mode = u[dofs]
    for _ in range(4):
        mode = factors.solve(weights @ mode)
        mode /= math.sqrt(mode @ (weights @ mode))
    swing = np.zeros(rest.size)
    swing[dofs] = mode
    frequency = math.sqrt(mode @ (stiffness @ mode)) / (2.0 * math.pi)
    u = u.reshape(-1, 3)
    return np.array([tip_sag(body, u), frequency]), u, swing.reshape(-1, 3)


def solver(body, material, pose, mode):
    """Sag [m] and frequency [Hz] of XpbdSolver: it settles at its sag, then swings freely."""
    rest = body.mesh.rest_vertices
    common = {"substep_count": SUBSTEPS, "rescue": False, "sleep_motion": 0.0}
    beam_solver = XpbdSolver(
        rest, body.mesh.tets, material, body.clamped, XpbdOptions(gravity=GRAVITY, **common)
    )
    beam_solver.set_state(rest + pose)
    for _ in range(round(STILL_SECONDS / TIME_STEP)):
        beam_solver.step(TIME_STEP)
    sag = tip_sag(body, beam_solver.vertices.numpy() - rest)

    beam_solver.set_options(XpbdOptions(**common))
    beam_solver.set_material(Material(MODULUS, material.poisson_ratio, DENSITY, damping=0.0))
    beam_solver.set_state(rest + mode * (sag / tip_sag(body, mode)))
    tips = []
    for _ in range(round(SWING_SECONDS / TIME_STEP)):
        beam_solver.step(TIME_STEP)
        tips.append(tip_sag(body, beam_solver.vertices.numpy() - rest))
    return np.array([sag, crossing_rate(np.array(tips)) / (2.0 * TIME_STEP)])


def crossing_rate(values):
    """Changes of sign per sample, between the first and the last."""
    before = np.flatnonzero(values[:-1] * values[1:] < 0)
    times = before + values[before] / (values[before] - values[before + 1])
    return (len(times) - 1) / (times[-1] - times[0])


def row(name, ratio):
    """A row of the table that this program prints: lattice, ν, and differences in percent."""
    body = beam(*SPACINGS[name])
    mu = MODULUS / (2.0 * (1.0 + ratio))
    lame = MODULUS * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
    own, converged = elements(body, lame, mu)
    material = Material(MODULUS, ratio, DENSITY, damping=6.0)
    energy = material_energy(body.mesh.rest_vertices, body.mesh.tets, material)
    ours, pose, mode = network(body, energy)
    moved = solver(body, material, pose, mode)
    off = [100.0 * (each - 1.0) for each in (ours / own, ours / converged, moved / ours)]
    columns = [1000.0 * converged[0], converged[1], *off[0], *off[1], *off[2]]
    return [name.upper() if name != "kuhn" else "Kuhn", ratio, *(round(c, 4) for c in columns)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lattices", nargs="+", choices=SPACINGS, default=list(SPACINGS))
    parser.add_argument("--ratios", nargs="+", type=float, default=RATIOS)
    options = parser.parse_args()
    for name in options.lattices:
        for ratio in options.ratios:
            print(json.dumps(row(name, ratio)), flush=True)


if __name__ == "__main__":
    main()
