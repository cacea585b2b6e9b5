"""The solver's error on a model's own mesh, held at its foot and pushed sideways.

The push is a sideways gravity g under which the body would, if it stayed linear, move by
PUSH of its size at most:

    K u = M e_x,   g = PUSH size / max |u_i|

with K the energy's Hessian at rest.  Error of motion is then that of the stiffness: what
gives way by a tenth too much is held as if E were a tenth lower.  (Downwards a standing
object buckles, and where to is a matter of chance.)

Shapes: V vertices.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse.linalg import splu

from ...deform import lowest_pins
from ...geometry import TetMesh
from .bodies import Held
from .energy import Energy
from .error import DEFAULT_MATERIAL, SCENES, Case

PUSH = 0.05  # of the size
BOUND = 0.1  # of the motion, under load: then E is held within about a tenth
SOFTEST = 1e-12  # of the stiffest pivot: what rounding leaves of no stiffness
ASIDE = np.array([1.0, 0.0, 0.0])


def body_of(mesh: TetMesh) -> Held:
    """A mesh that stands on its foot, as the solver's float32 has it."""
    rest = mesh.rest_vertices.astype(np.float32).astype(np.float64)
    return Held(replace(mesh, rest_vertices=rest), lowest_pins(rest, mesh.tets))


def response(energy: Energy, rest, held, direction):
    """Where a body that stays linear moves, for each m/s² in that direction.  [V, 3] s²

    Args:
        rest: [V, 3] m
        held: [V] bool

    Raises:
        RuntimeError: Some of it can move without resistance, or nothing can move.
    """
    if held.all():
        raise RuntimeError("all of the body is held")
    dofs = (3 * np.flatnonzero(~held)[:, None] + np.arange(3)).ravel()
    load = (energy.masses[:, None] * direction).ravel()[dofs]
    loose = "some of the body moves without resistance"
    try:
        factors = splu(energy.hessian(rest)[dofs][:, dofs].tocsc())
    except RuntimeError:  # a pivot of exactly 0
        raise RuntimeError(loose) from None
    pivots = np.abs(factors.U.diagonal())
    if pivots.min() <= SOFTEST * pivots.max():
        raise RuntimeError(loose)
    moved = np.zeros(rest.size)
    moved[dofs] = factors.solve(load)
    return moved.reshape(-1, 3)


def cases(name: str, body: Held, material=DEFAULT_MATERIAL) -> list[Case]:
    """The static and the dynamic scene of a body, pushed.

    Raises:
        RuntimeError: Some of the body can move without resistance.
    """
    rest = body.mesh.rest_vertices
    still = Case(name, body, None, "static", solid=material)
    most = np.linalg.norm(response(still.energy, rest, body.clamped, ASIDE), axis=1).max()
    strength = PUSH * float(np.ptp(rest, axis=0).max()) / float(most)
    gravity = tuple((strength * ASIDE).tolist())
    return [Case(name, body, None, scene, gravity, material) for scene in SCENES]
