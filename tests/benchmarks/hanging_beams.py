"""Load cases of beams that hang under gravity, of a material or of edges of one compliance."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from beams import beam

from deformrf.core.geometry import A15, BCC, KUHN
from deformrf.wings.lab.dynamics.measure import HeldMesh, LoadCase

LATTICES = {"a15": A15, "bcc": BCC, "kuhn": KUHN}
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class EvenSprings(LoadCase):
    """A body whose edges all have the same compliance, without volume constraints.

    At compliance 0 the reference is the rest pose: a body that is infinitely stiff does not
    move, so what is left is the compliance of one iteration and of its floor.
    """

    compliance: float = 0.0  # of every edge [m/N]

    @property
    def energy(self):
        energy = super().energy
        return replace(
            energy,
            stiffnesses=np.full(len(energy.edges), 1.0 / self.compliance),
            tets=energy.tets[:0],
            volumes=energy.volumes[:0],
            volume_stiffnesses=energy.volume_stiffnesses[:0],
        )

    @cached_property
    def reference(self):
        return (self.body.rest[None], 0.0) if self.compliance == 0.0 else super().reference

    def solver(self, substep_count, device):
        solver = super().solver(substep_count, device)
        solver.set_compliances(self.compliance, None)
        return solver


def beam_case(lattice, spacing, compliance, scene) -> LoadCase:
    """A clamped beam under gravity; compliance is None for the default material."""
    body = beam(LATTICES[lattice], spacing)
    rounded = body.mesh.rest_vertices.astype(np.float32).astype(np.float64)
    held = HeldMesh(rounded, body.mesh.tets, body.clamped)
    if compliance is None:
        return LoadCase(held, scene, GRAVITY)
    return EvenSprings(held, scene, GRAVITY, compliance=compliance)
