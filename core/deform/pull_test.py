"""Measure what a body's substeps hold where they can't hold its material.

There all constraints are at their floor, and Young's modulus does not matter any more.  How stiff
the body is then depends on its shape, its mesh and its pins: six bodies were 1.1 to 2.4 times as
stiff as the estimate says (held_stiffness.py).  So it is pulled sideways twice by a small load,
soft enough to be held, and stiff.  What it yields, over the load, gives the one number that the
estimate lacks.

Each pull ends by dynamic relaxation: where the kinetic energy is largest, forces are in balance,
so the velocities are taken away there, until that changes nothing any more.
"""

from dataclasses import replace

import numpy as np

from .constraints import lumped_masses
from .xpbd_options import TIME_STEP

SOFT, STIFF = 8.0, 0.02  # r of the two pulls
SIDEWAYS = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0])
STRAIN = 1e-5  # that the load would cause in a bar of the object's size
CHANGE = 3e-3  # of the way between two rests
MOST_FRAMES = 400  # of a pull
MOST = 5.0  # what a larger or smaller result is worth: nothing


def floor_share(solver, part_of) -> float:
    """The E that a load meets over the estimate, where all constraints are at their floor.

    It is 1 for a body without pins, and where the result is no credible number (MOST).

    Args:
        solver: A solver of this body alone; it is changed.
        part_of: The part of each vertex; those without pins are left out.  [V] int
    """
    has_pins = np.zeros(part_of.max() + 1, bool)
    has_pins[part_of[solver.pinned]] = True
    solver.set_pinned(solver.pinned | ~has_pins[part_of])
    ratio, material = solver.stiffness_ratio(), solver.material
    if not has_pins.any() or not ratio > 0.0:
        return 1.0
    masses = lumped_masses(solver.rest_vertices, solver.tets, material.density)
    estimates, ways = [], []
    for wanted in SOFT, STIFF:
        modulus = material.young_modulus * ratio / wanted
        solver.set_material(replace(material, young_modulus=modulus, damping=0.0))
        estimates.append(solver.estimated_young_modulus())
        load = STRAIN * estimates[-1] / (material.density * solver.object_size)
        ways.append(_way(solver, load, masses) / load)
    (soft, stiff), (far, near) = estimates, ways
    with np.errstate(divide="ignore", invalid="ignore"):
        share = soft * np.float64(far) / near / stiff
    return float(share) if 1.0 / MOST < share < MOST else 1.0


def _way(solver, load, masses):
    """How far the load moves the mass, in its direction [kg m]."""
    solver.set_options(replace(solver.options, gravity=tuple(load * SIDEWAYS)))
    solver.reset()
    fastest, way = 0.0, np.inf
    for _ in range(MOST_FRAMES):
        solver.step(TIME_STEP)
        speeds = solver.velocities.numpy().astype(np.float64)
        kinetic = masses @ (speeds**2).sum(axis=1)
        if kinetic < fastest:
            vertices = solver.vertices.numpy().astype(np.float64)
            before, way = way, masses @ ((vertices - solver.rest_vertices) @ SIDEWAYS)
            if abs(way - before) < CHANGE * abs(way):
                break
            solver.set_state(vertices)
            kinetic = 0.0
        fastest = kinetic
    return way
