"""Damp the motion of parts that nothing holds, except their rigid motion.

A part's rigid motion has the part's momentum and angular momentum:

    c = Σ m x / Σ m,   u = Σ m v / Σ m,   ω = I⁻¹ Σ m (x − c) × (v − u),
    I = Σ m (|r|² − r rᵀ),  r = x − c

Once a frame, the rest of the velocities decays: v ← s + (v − s) exp(−δ dt) with
s = u + ω × (x − c).  That changes neither momentum nor angular momentum.

Units: m, m/s, kg, rad/s.  Shapes: V vertices, P parts (connected components of the mesh).
"""

import numpy as np
import warp as wp

from .arrays import VertexArrays

THREADS = 256  # of a part on CUDA
SMALLEST_TURN = 1e-6  # of the trace of I: what lies on a line doesn't turn about it,
SMALLEST_ARM = 1e-6  # m: nor a point about itself

wp.set_module_options({"enable_backward": False})


@wp.kernel(grid_stride=False)
def damp_kernel(
    state: VertexArrays,
    members: wp.array(dtype=int),  # [V] vertices by part
    offsets: wp.array(dtype=int),  # [P + 1]
    parts: wp.array(dtype=int),  # those to damp
    decay: wp.array(dtype=float),  # [1] exp(-δ dt)
):
    i, lane = wp.tid()
    begin, end = offsets[parts[i]] + lane, offsets[parts[i] + 1]
    total, middle, momentum = wp.float64(0.0), wp.vec3d(), wp.vec3d()
    k = int(begin)
    while k < end:
        m = wp.float64(1.0) / wp.float64(state.inverse_masses[members[k]])
        total += m
        middle += m * wp.vec3d(state.vertices[members[k]])
        momentum += m * wp.vec3d(state.velocities[members[k]])
        k += wp.block_dim()
    total = wp.tile_sum(wp.tile(total))[0]
    c = wp.tile_sum(wp.tile(middle, preserve_type=True))[0] / total
    u = wp.tile_sum(wp.tile(momentum, preserve_type=True))[0] / total
    moment, inertia = wp.vec3d(), wp.mat33d()
    k = int(begin)
    while k < end:
        m = wp.float64(1.0) / wp.float64(state.inverse_masses[members[k]])
        r = wp.vec3d(state.vertices[members[k]]) - c
        moment += m * wp.cross(r, wp.vec3d(state.velocities[members[k]]) - u)
        inertia += m * (wp.dot(r, r) * wp.identity(n=3, dtype=wp.float64) - wp.outer(r, r))
        k += wp.block_dim()
    moment = wp.tile_sum(wp.tile(moment, preserve_type=True))[0]
    inertia = wp.tile_sum(wp.tile(inertia, preserve_type=True))[0]
    least = wp.float64(wp.static(SMALLEST_TURN)) * wp.trace(inertia)
    least += wp.float64(wp.static(SMALLEST_ARM**2)) * total
    spin = wp.inverse(inertia + least * wp.identity(n=3, dtype=wp.float64)) * moment
    if not (wp.isfinite(c) and wp.isfinite(u) and wp.isfinite(spin)):
        return
    k = int(begin)
    while k < end:
        r = wp.vec3d(state.vertices[members[k]]) - c
        s = wp.vec3(u + wp.cross(spin, r))
        state.velocities[members[k]] = s + decay[0] * (state.velocities[members[k]] - s)
        k += wp.block_dim()


class FreeParts:
    """The parts of a mesh that nothing holds.

    Args:
        part_of: [V]
    """

    def __init__(self, state: VertexArrays, part_of):
        self._device = state.vertices.device
        self._decay = wp.zeros(1, dtype=float, device=self._device)
        self._arrays = [
            state,
            wp.array(np.argsort(part_of, kind="stable"), dtype=int, device=self._device),
            wp.array(np.append(0, np.cumsum(np.bincount(part_of))), dtype=int, device=self._device),
        ]
        self._launch = None

    def select(self, free, decay: float):
        """Damp these parts ([P] bool) from now on, by `decay` a frame."""
        self._launch = None
        self._decay.fill_(decay)
        if free.any():
            parts = wp.array(np.flatnonzero(free), dtype=int, device=self._device)
            self._launch = wp.launch_tiled(
                damp_kernel,
                dim=len(parts),
                inputs=[*self._arrays, parts, self._decay],
                block_dim=THREADS,
                device=self._device,
                record_cmd=True,
            )

    def damp(self) -> bool:
        """A frame begins: damp its free parts; whether there are any."""
        if self._launch is None:
            return False
        self._launch.launch()
        return True
