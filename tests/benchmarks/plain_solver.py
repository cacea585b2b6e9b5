"""Substeps that keep positions as plain float32, to compare with base plus delta.

Each substep is the reference's, in float64; then positions are rounded to float32, and
velocities are taken from the rounded ones:

    v = (fl(x) − fl(x_before)) / h

so that what is lost is lost to the way in which positions are kept and to nothing else.  The
rounding of x, 6e-8 of it, is divided by h: the shorter the substeps, the more it matters.

Shapes: V vertices.
"""

import numpy as np
import solver_frame
import warp as wp

from deformrf.core.deform import TIME_STEP, edge_constraints, lumped_masses, volume_constraints


class PlainSolver:
    """As XpbdSolver, for what the comparison needs.

    Attributes:
        vertices: [V] vec3
    """

    def __init__(self, rest_vertices, tets, material, pinned, options):
        rest = np.array(rest_vertices, np.float32).astype(np.float64)
        self.edges, self.volumes = edge_constraints(rest, tets), volume_constraints(rest, tets)
        masses = lumped_masses(rest, tets, material.density)
        self._inverse_masses = np.divide(1.0, masses, out=0.0 * masses, where=masses > 0)
        self._inverse_masses[pinned] = 0.0
        self._timing = options.timing(
            TIME_STEP, material.damping, float(np.ptp(rest, axis=0).max())
        )
        self._substep_count = options.substep_count
        self._positions, self._velocities = rest, np.zeros_like(rest)
        self.vertices = wp.array(rest, dtype=wp.vec3, device="cpu")
        self.set_compliances(*material.compliances(self.edges, self.volumes))

    def set_compliances(self, edges, volumes):
        """α of edges [m/N] and of volumes [m⁵/N], each a number or one a constraint."""
        w, h = self._inverse_masses, self._timing.substep
        has_volumes = volumes is not None
        self._frame = solver_frame.Frame(
            timing=self._timing,
            substep_count=1,
            inverse_masses=w,
            anchors=self._positions,
            targets=self._positions,
            edges=self.edges,
            edge_regularization=self.edges.regularization(edges, w, h),
            volumes=self.volumes if has_volumes else None,
            volume_regularization=self.volumes.regularization(volumes, w, h)
            if has_volumes
            else None,
        )

    def step(self, dt):
        """Advance by one frame, which has to be TIME_STEP long."""
        assert dt == TIME_STEP, dt
        x, v = self._positions, self._velocities
        for _ in range(self._substep_count):
            before = x
            x, _ = solver_frame.step(self._frame, x, v)
            x = x.astype(np.float32).astype(np.float64)
            v = (x - before) / self._timing.substep
        self._positions, self._velocities = x, v
        self.vertices.assign(x)
