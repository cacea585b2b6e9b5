"""XPBD with one long substep a frame and many iterations, to compare with many substeps.

The multiplier λ of each constraint is stored over the m iterations of a frame (Macklin
2016, eq. 18):

    Δλ = (−C − a λ) / (Σ w_i |g_i|² + a),   λ ← λ + Δλ,   x_i ← x_i + w_i Δλ g_i

with the solver's constraints, colors, floor under a if wanted, limit of volume corrections,
and positions as frame's start plus delta.  A color is a launch on CUDA, where a frame is one
captured graph; on the CPU one launch sweeps all colors.

Pinned vertices stay; there are no handles.  An edge of no length stays as it is.

Units: SI.  Shapes: V vertices, E edges, T tets.
"""

import math

import numpy as np
import warp as wp

from deformrf.core.definition.solver import STEP_LIMIT
from deformrf.core.deform import (
    SECOND_SOFTENING,
    SWEEP_SOFTENING,
    edge_constraints,
    lumped_masses,
    upload,
    volume_constraints,
)

LARGEST = 1e30  # in place of an infinite compliance

wp.set_module_options({"enable_backward": False})


@wp.kernel(grid_stride=False)
def predict_kernel(
    velocities: wp.array(dtype=wp.vec3),  # [V]
    inverse_masses: wp.array(dtype=float),  # [V]
    push: wp.vec3,  # h g
    decay: float,  # exp(−δ h)
    speed_limit: float,
    h: float,
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    previous: wp.array(dtype=wp.vec3),  # [V] out
):
    i = wp.tid()
    previous[i] = deltas[i]
    if inverse_masses[i] > 0.0:
        v = decay * velocities[i] + push
        speed = wp.length(v)
        if speed > speed_limit:
            v = (speed_limit / speed) * v
        deltas[i] = deltas[i] + h * v


@wp.kernel(grid_stride=False)
def edges_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V] at the frame's start
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    inverse_masses: wp.array(dtype=float),  # [V]
    ends: wp.array(dtype=wp.vec2i),  # [E]
    rest_lengths: wp.array(dtype=float),  # [E]
    regularization: wp.array(dtype=float),  # [E] a
    multipliers: wp.array(dtype=float),  # [E] in and out
    offset: int,
):
    edge = wp.tid() + offset
    i = ends[edge][0]
    j = ends[edge][1]
    wi = inverse_masses[i]
    wj = inverse_masses[j]
    along = (vertices[i] - vertices[j]) + (deltas[i] - deltas[j])
    length = wp.length(along)
    if wi + wj > 0.0 and length > 0.0:
        a = regularization[edge]
        gap = rest_lengths[edge] - length - a * multipliers[edge]
        change = gap / (wi + wj + a)
        multipliers[edge] = multipliers[edge] + change
        deltas[i] = deltas[i] + (wi * change / length) * along
        deltas[j] = deltas[j] - (wj * change / length) * along


@wp.kernel(grid_stride=False)
def volumes_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V] at the frame's start
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    inverse_masses: wp.array(dtype=float),  # [V]
    tets: wp.array(dtype=wp.vec4i),  # [T]
    rest_volumes: wp.array(dtype=float),  # [T] 6 V0
    regularization: wp.array(dtype=float),  # [T] a
    multipliers: wp.array(dtype=float),  # [T] in and out
    offset: int,
):
    tet = wp.tid() + offset
    c = tets[tet]
    e1 = (vertices[c[1]] - vertices[c[0]]) + (deltas[c[1]] - deltas[c[0]])
    e2 = (vertices[c[2]] - vertices[c[0]]) + (deltas[c[2]] - deltas[c[0]])
    e3 = (vertices[c[3]] - vertices[c[0]]) + (deltas[c[3]] - deltas[c[0]])
    w = wp.vec4(
        inverse_masses[c[0]], inverse_masses[c[1]], inverse_masses[c[2]], inverse_masses[c[3]]
    )
    g1 = wp.cross(e2, e3)
    g2 = wp.cross(e3, e1)
    g3 = wp.cross(e1, e2)
    g0 = -(g1 + g2 + g3)
    squared = wp.vec4(wp.dot(g0, g0), wp.dot(g1, g1), wp.dot(g2, g2), wp.dot(g3, g3))
    a = regularization[tet]
    weighted = wp.dot(w, squared) + a
    if weighted > a:
        change = (rest_volumes[tet] - wp.dot(g1, e1) - a * multipliers[tet]) / weighted
        longest = wp.abs(change) * wp.sqrt(wp.max(wp.cw_mul(wp.cw_mul(w, w), squared)))
        limit = STEP_LIMIT * wp.cbrt(rest_volumes[tet])
        if longest > limit:
            change *= limit / longest
        multipliers[tet] = multipliers[tet] + change
        deltas[c[0]] = deltas[c[0]] + (w[0] * change) * g0
        deltas[c[1]] = deltas[c[1]] + (w[1] * change) * g1
        deltas[c[2]] = deltas[c[2]] + (w[2] * change) * g2
        deltas[c[3]] = deltas[c[3]] + (w[3] * change) * g3


@wp.kernel(grid_stride=False)
def finish_kernel(
    h: float,
    previous: wp.array(dtype=wp.vec3),  # [V]
    vertices: wp.array(dtype=wp.vec3),  # [V] in and out
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    velocities: wp.array(dtype=wp.vec3),  # [V] out
):
    i = wp.tid()
    velocities[i] = (deltas[i] - previous[i]) / h
    start = vertices[i]
    vertices[i] = start + deltas[i]
    deltas[i] = (start - vertices[i]) + deltas[i]  # what the addition rounded away


class IterationSolver:
    """As XpbdSolver, for what the comparison needs.

    Attributes:
        vertices: [V] vec3 on the device
    """

    def __init__(
        self, rest_vertices, tets, material, pinned, options, iteration_count, floor, device
    ):
        """`options.substep_count` isn't used: there is one.  `floor` is r_min."""
        rest = np.array(rest_vertices, np.float32).astype(np.float64)
        self.options, self.material, self.device = options, material, wp.get_device(device)
        self.iteration_count, self.floor = iteration_count, floor
        self.edges, self.volumes = edge_constraints(rest, tets), volume_constraints(rest, tets)
        masses = lumped_masses(rest, tets, material.density)
        self._host_inverse_masses = np.where(pinned, 0.0, 1.0 / masses)
        self._speed_limit = options.speed_limit * float(np.ptp(rest, axis=0).max())
        self.vertices = upload(rest, wp.vec3, self.device)
        self._velocities, self._deltas, self._previous = (
            wp.zeros(len(rest), dtype=wp.vec3, device=self.device) for _ in range(3)
        )
        self._inverse_masses = upload(self._host_inverse_masses, float, self.device)
        self.set_compliances(*material.compliances(self.edges, self.volumes))

    def set_compliances(self, edges, volumes):
        """α of edges [m/N] and of volumes [m⁵/N], each a number or one a constraint."""
        self._compliances, self._dt = (edges, volumes), None

    def step(self, dt):
        """Advance by one frame of dt seconds."""
        if dt != self._dt:
            self._dt = dt
            self._frame = self._record(dt)
        if self.device.is_cuda:
            wp.capture_launch(self._frame)
        else:
            for action in self._frame:
                action()

    def _record(self, h):
        """A frame: a graph on CUDA, a list of calls on the CPU."""
        x, d, v, w = self.vertices, self._deltas, self._velocities, self._inverse_masses
        push = wp.vec3(*(h * g for g in self.options.gravity))
        decay = math.exp(-self.material.damping * h)
        inputs = [v, w, push, decay, self._speed_limit, h, d, self._previous]
        frame = [self._launch(predict_kernel, len(x), inputs)]
        sweep, self._kept = [], []  # a recorded launch doesn't keep its arrays alive
        kinds = [
            (edges_kernel, self.edges, wp.vec2i),
            (volumes_kernel, self.volumes, wp.vec4i),
        ]
        for (kernel, table, dtype), alpha in zip(kinds, self._compliances, strict=True):
            if alpha is None:
                continue
            w_on_host = self._host_inverse_masses
            # Many sweeps with stored multipliers solve for the compliances as they are.
            once = self.iteration_count == 1
            softening = (SWEEP_SOFTENING, SECOND_SOFTENING) if once else (0.0, 0.0)
            regularization = table.regularization(alpha, w_on_host, h, self.floor, softening)
            regularization = np.minimum(regularization, LARGEST)  # ∞ times a multiplier of 0
            multipliers = wp.zeros(len(table.vertices), dtype=float, device=self.device)
            kept = (table.vertices, dtype), (table.rest_values, float)
            arrays = [upload(a, t, self.device) for a, t in kept]
            inputs = [x, d, w, *arrays, upload(regularization, float, self.device), multipliers]
            self._kept += inputs
            offsets = table.offsets if self.device.is_cuda else table.offsets[[0, -1]]
            for first, last in zip(offsets[:-1].tolist(), offsets[1:].tolist(), strict=True):
                sweep.append(self._launch(kernel, last - first, [*inputs, first]))
            frame.append(multipliers.zero_)
        frame += sweep * self.iteration_count
        frame.append(self._launch(finish_kernel, len(x), [h, self._previous, x, d, v]))
        if not self.device.is_cuda:
            return frame
        with wp.ScopedCapture(device=self.device) as capture:
            for action in frame:
                action()
        return capture.graph

    def _launch(self, kernel, dim, inputs):
        return wp.launch(kernel, dim, inputs, device=self.device, record_cmd=True).launch
