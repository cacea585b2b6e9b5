"""Damp the motion of parts that nothing holds, except their rigid motion.

A part's rigid motion has the part's momentum and angular momentum:

    c = Σ m x / Σ m,   u = Σ m v / Σ m,   ω = I⁻¹ Σ m (x − c) × (v − u),
    I = Σ m (|r|² − r rᵀ),  r = x − c

Once a frame, the rest of the velocities decays: v ← s + (v − s) exp(−δ dt) with
s = u + ω × (x − c).  That changes neither momentum nor angular momentum.

A part that lies on something comes to rest.  What it lies on is known from its momentum: with the
velocity u' and the spin ω' that it had after the last frame's start, and without a touch, it would
have the velocity A u' + B now (gravity, the air's drag and the wind).  So

    N = min((u − A u' − B) · e − 0.001 g dt, g dt)⁺      of all supports, over the mass; e up [m/s]

    u ← u + clip(−½ ū_e, 0.02 N) + clip(−½ (ū − ū_e), 0.002 N)      ū the mean of u' and u
    z ← clip(z − 0.03 I ω̄, b)        a bristle, b = 0.03 R N Σ m
    ω ← ω + I⁻¹ clip(z − ½ I ω̄, b)                              |clip(p, b)| ≤ b; ū_e = ū · e e

R is the radius of gyration, R² = tr I / (2 Σ m).  The spin's resistance is that of a rolling body:
a torque of the load times a small length, 0.03 R, as of rubber on a hard floor.  Along e, a support
loses a fiftieth of the load as a body rises and sinks on it; across, 0.002 adds to friction and
holds what shakes without sliding.  No more than the weight counts, so bounces keep their height.
The bristle carries a steady torque without motion, as static friction does.
A part that touches nothing has N = 0: it keeps u and ω.

Units: m, m/s, kg, rad/s.  Shapes: V vertices, P parts (connected components of the mesh).
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from .arrays import VertexArrays, zeros
from .xpbd_options import FIRST_INTEGRATOR, Timing, XpbdOptions

THREADS = 256  # of a part on CUDA
SMALLEST_TURN = 1e-6  # of the trace of I: what lies on a line doesn't turn about it,
SMALLEST_ARM = 1e-6  # m: nor a point about itself
ROLLING = 0.03  # R, the length with which a load resists rolling
SINKING, SHAKING = 0.02, 0.002  # of a load: what resists motion along e, and across
LEAST_LOAD = 1e-3  # of the weight: less is rounding
DRAG = 0.5  # of a frame's motion that they stop, if they can
BRISTLE = 0.03  # of a frame's turn that bends the bristle

wp.set_module_options({"enable_backward": False})


@wp.struct
class RigidMotion:
    """Of a part, from its vertices' positions and velocities."""

    mass: wp.float64  # Σ m
    middle: wp.vec3d  # c
    velocity: wp.vec3d  # u
    spin: wp.vec3d  # ω
    inertia: wp.mat33d  # I, and a little more


@wp.func
def rigid_motion(state: VertexArrays, members: wp.array(dtype=int), begin: int, end: int):
    """The motion of the part with these members; a block's threads share them."""
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
    inertia = inertia + least * wp.identity(n=3, dtype=wp.float64)
    return RigidMotion(total, c, u, wp.inverse(inertia) * moment, inertia)


@wp.func
def is_finite(motion: RigidMotion):
    return wp.isfinite(motion.middle) and wp.isfinite(motion.velocity) and wp.isfinite(motion.spin)


@wp.func
def damp_others(
    state: VertexArrays,
    members: wp.array(dtype=int),
    begin: int,
    end: int,
    motion: RigidMotion,
    decay: float,
    velocity: wp.vec3d,
    spin: wp.vec3d,
):
    """Damp what isn't rigid motion, and replace that by another velocity and spin."""
    k = int(begin)
    while k < end:
        r = wp.vec3d(state.vertices[members[k]]) - motion.middle
        s = wp.vec3(motion.velocity + wp.cross(motion.spin, r))
        other = state.velocities[members[k]] - s
        state.velocities[members[k]] = wp.vec3(velocity + wp.cross(spin, r)) + decay * other
        k += wp.block_dim()


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
    now = rigid_motion(state, members, begin, end)
    if is_finite(now):
        damp_others(state, members, begin, end, now, decay[0], now.velocity, now.spin)


@wp.struct
class Support:
    """What the rest of free parts depends on."""

    numbers: wp.array(dtype=wp.float64)  # [2] A, g dt
    flight: wp.array(dtype=wp.vec3d)  # [2] B, e


@wp.struct
class PartArrays:
    """What is kept of each part from frame to frame.  [P]"""

    velocities: wp.array(dtype=wp.vec3d)  # u'
    spins: wp.array(dtype=wp.vec3d)  # ω'
    bristles: wp.array(dtype=wp.vec3d)  # z [kg m²/s]
    known: wp.array(dtype=int)  # 0: u' and ω' are not known


class Flight(NamedTuple):
    """What a frame makes of the velocity u of a part that touches nothing: A u + B."""

    factor: float  # A
    gain: np.ndarray  # [3] B [m/s]
    up: np.ndarray  # [3] e, against gravity
    weight: float  # g dt [m/s]


def flight(options: XpbdOptions, timing: Timing, dt: float, part_count: int) -> Flight | None:
    """The flight of a frame of dt [s]; None if parts never rest on anything.

    That is so without gravity, where nothing is down, and with the first integrator.
    """
    gravity = np.array(options.gravity)
    size = float(np.linalg.norm(gravity))
    others = options.contact and part_count > 1
    lies = options.ground is not None or len(options.colliders) > 0 or others
    if options.integrator == FIRST_INTEGRATOR or size == 0.0 or not lies:
        return None
    factor, gain = 1.0, np.zeros(3)
    gust = np.array([timing.gust_x, timing.gust_y, timing.gust_z])
    for _ in range(options.substeps(dt)):
        factor *= timing.air
        gain = timing.air * (gain + timing.substep * gravity) + gust
    return Flight(factor, gain, -gravity / size, size * dt)


@wp.func
def clip(p: wp.vec3d, most: wp.float64):
    length = wp.length(p)
    if length > most:
        return (most / length) * p
    return p


@wp.kernel(grid_stride=False)
def rest_kernel(
    state: VertexArrays,
    members: wp.array(dtype=int),  # [V] vertices by part
    offsets: wp.array(dtype=int),  # [P + 1]
    parts: wp.array(dtype=int),  # those to damp
    decay: wp.array(dtype=float),  # [1] exp(-δ dt)
    support: Support,
    kept: PartArrays,
):
    i, lane = wp.tid()
    part = parts[i]
    begin, end = offsets[part] + lane, offsets[part + 1]
    velocity, spin = wp.vec3d(kept.velocities[part]), wp.vec3d(kept.spins[part])
    bristle = wp.vec3d(kept.bristles[part])
    known = kept.known[part]
    now = rigid_motion(state, members, begin, end)
    if not is_finite(now):
        return
    u, w = wp.vec3d(now.velocity), wp.vec3d(now.spin)
    if known > 0:
        up = support.flight[1]
        lift = wp.dot(u - support.numbers[0] * velocity - support.flight[0], up)
        lift -= wp.float64(wp.static(LEAST_LOAD)) * support.numbers[1]
        load = wp.clamp(lift, wp.float64(0.0), support.numbers[1])
        radius = wp.sqrt(wp.float64(0.5) * wp.trace(now.inertia) / now.mass)
        most_spin = wp.float64(wp.static(ROLLING)) * radius * load * now.mass
        part_of_mean = wp.float64(wp.static(0.5 * DRAG))
        stopped = part_of_mean * (u + velocity)
        along = wp.dot(stopped, up) * up
        turned = wp.float64(0.5) * (now.inertia * (w + spin))
        bristle = clip(bristle - wp.float64(wp.static(BRISTLE)) * turned, most_spin)
        held = clip(bristle - wp.float64(wp.static(DRAG)) * turned, most_spin)
        u -= clip(along, wp.float64(wp.static(SINKING)) * load)
        u -= clip(stopped - along, wp.float64(wp.static(SHAKING)) * load)
        w += wp.inverse(now.inertia) * held
    damp_others(state, members, begin, end, now, decay[0], u, w)
    if lane == 0:
        kept.velocities[part] = u
        kept.spins[part] = w
        kept.bristles[part] = bristle
        kept.known[part] = 1


class FreeParts:
    """The parts of a mesh that nothing holds.

    Args:
        part_of: [V]
    """

    def __init__(self, state: VertexArrays, part_of):
        self._device = device = state.vertices.device
        counts = np.bincount(part_of)
        self._decay = wp.zeros(1, dtype=float, device=device)
        self._arrays = [
            state,
            wp.array(np.argsort(part_of, kind="stable"), dtype=int, device=device),
            wp.array(np.append(0, np.cumsum(counts)), dtype=int, device=device),
        ]
        self._support = zeros(Support, device, numbers=2, flight=2)
        self._kept = zeros(PartArrays, device, **dict.fromkeys(PartArrays.vars, len(counts)))
        self._launch = None

    def select(self, free, decay: float, flight: Flight | None = None):
        """Damp these parts ([P] bool) from now on, by `decay` a frame.

        Args:
            flight: How a part moves that touches nothing; None if there is nothing to rest on.
        """
        self._launch = None
        self._decay.fill_(decay)
        if not free.any():
            return
        parts = wp.array(np.flatnonzero(free), dtype=int, device=self._device)
        kernel, inputs = damp_kernel, [*self._arrays, parts, self._decay]
        if flight is not None:
            self._support.numbers.assign(np.array([flight.factor, flight.weight]))
            self._support.flight.assign(np.array([flight.gain, flight.up]))
            self._kept.known.zero_()
            kernel, inputs = rest_kernel, [*inputs, self._support, self._kept]
        self._launch = wp.launch_tiled(
            kernel,
            dim=len(parts),
            inputs=inputs,
            block_dim=THREADS,
            device=self._device,
            record_cmd=True,
        )

    def forget(self):
        """Vertices were moved by hand: bristles are straight."""
        self._kept.bristles.zero_()

    def damp(self) -> bool:
        """A frame begins: damp its free parts; whether there are any."""
        if self._launch is None:
            return False
        self._launch.launch()
        return True
