"""What happens to vertices around the constraints: handles, inertia, the frame's end.

    kinematic:  d ← (s + 1)/n · (target − x),   s = 0..n−1 the substep
    free:       v ← v exp(−δ h) + h g,  |v| ≤ v_max,  d ← d + h v
    after the constraints, where there are any of these:
    spring:     u = anchor + (s + 1)/n · (target − anchor) − x − d,   a = 1/(k h²),
                d ← d + u min(w/(w + a), w F h²/|u|)
    ground:     where x + d is p below it, d ← up by p, and of the way along the ground
                since the substep's start at most (friction · p) is undone
    v ← (d − d before the substep)/h
    at the frame's end:  x ← x + d,   anchor ← target

Here x is the position at the frame's start and d the way from there; see constraints.py
for why they are apart.  A spring is a distance constraint of length 0 and stiffness k
that pulls with at most the force F.

Units: x, d [m], v [m/s], h [s], δ damping [1/s], g [m/s²], k [N/m], F [N], w [1/kg].
Shapes: V vertices, K handles.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})

NO_SPRING = -1.0  # in place of a, which is never negative
NO_GROUND = -3e38  # below every vertex; finite, because fast arithmetic may ignore infinities
UNLIMITED = 3e38  # a longest move that no spring reaches


class Timing(NamedTuple):
    """What all vertices share, in the order of the kernels' array `timing`.

    Attributes:
        substep: h [s].
        decay: exp(-δ h).
        speed_limit: v_max [m/s].
        gravity_x, gravity_y, gravity_z: [m/s²]
        ground: Height z of the ground [m]; NO_GROUND if there is none.
        friction: Coulomb's coefficient on the ground.
    """

    substep: float
    decay: float
    speed_limit: float
    gravity_x: float
    gravity_y: float
    gravity_z: float
    ground: float = NO_GROUND
    friction: float = 0.0


def spring_coefficients(stiffness, force_limit, inverse_masses, substep):
    """a = 1/(k h²) [1/kg] and the longest move w F h² [m] of a spring.  [K, 2]

    Args:
        stiffness: k [N/m].  [K]
        force_limit: F [N].  [K]
        inverse_masses: w.  [K]
    """
    a = 1.0 / (np.asarray(stiffness) * substep**2)
    longest = inverse_masses * np.minimum(force_limit, UNLIMITED) * substep**2
    longest = np.minimum(longest, UNLIMITED)
    return np.stack(np.broadcast_arrays(a, longest), axis=-1)


@wp.kernel(grid_stride=False)
def predict_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V] at the frame's start
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    velocities: wp.array(dtype=wp.vec3),  # [V]
    inverse_masses: wp.array(dtype=float),  # [V] 0 = kinematic
    targets: wp.array(dtype=wp.vec3),  # [V] where kinematic vertices go
    timing: wp.array(dtype=float),  # [8] Timing
    fraction: float,  # of the frame that is over after this substep
    previous: wp.array(dtype=wp.vec3),  # [V] out
):
    i = wp.tid()
    delta = deltas[i]
    previous[i] = delta
    if inverse_masses[i] > 0.0:
        gravity = wp.vec3(timing[3], timing[4], timing[5])
        v = timing[1] * velocities[i] + timing[0] * gravity
        speed = wp.length(v)
        if speed > timing[2]:
            v = (timing[2] / speed) * v
        deltas[i] = delta + timing[0] * v
    else:
        deltas[i] = fraction * (targets[i] - vertices[i])


@wp.kernel(grid_stride=False)
def pull_springs_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V] at the frame's start
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    inverse_masses: wp.array(dtype=float),  # [V] 0 = kinematic
    anchors: wp.array(dtype=wp.vec3),  # [V] where the springs' ends were at the frame's start
    targets: wp.array(dtype=wp.vec3),  # [V] where they are at its end
    springs: wp.array(dtype=wp.vec2),  # [V] a or NO_SPRING, longest move
    fraction: float,  # of the frame that is over after this substep
):
    i = wp.tid()
    a = springs[i][0]
    w = inverse_masses[i]
    if a >= 0.0 and w > 0.0:
        # The way from the frame's start is formed first: it is short, and so exact.
        start = anchors[i] - vertices[i]
        way = start + fraction * (targets[i] - anchors[i]) - deltas[i]
        move = (w / (w + a)) * way
        length = wp.length(move)
        if length > springs[i][1]:
            move = (springs[i][1] / length) * move
        deltas[i] = deltas[i] + move


@wp.kernel(grid_stride=False)
def push_from_ground_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V] at the frame's start
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    previous: wp.array(dtype=wp.vec3),  # [V] deltas at the substep's start
    inverse_masses: wp.array(dtype=float),  # [V] 0 = kinematic
    timing: wp.array(dtype=float),  # [8] Timing
):
    i = wp.tid()
    delta = deltas[i]
    push = (timing[6] - vertices[i][2]) - delta[2]
    if push > 0.0 and inverse_masses[i] > 0.0:
        along = wp.vec2(delta[0] - previous[i][0], delta[1] - previous[i][1])
        length = wp.length(along)
        kept = float(0.0)
        if length > timing[7] * push:
            kept = 1.0 - timing[7] * push / length
        deltas[i] = wp.vec3(
            previous[i][0] + kept * along[0], previous[i][1] + kept * along[1], delta[2] + push
        )


@wp.kernel(grid_stride=False)
def update_velocities_kernel(
    deltas: wp.array(dtype=wp.vec3),  # [V]
    previous: wp.array(dtype=wp.vec3),  # [V]
    timing: wp.array(dtype=float),  # [8] Timing
    velocities: wp.array(dtype=wp.vec3),  # [V] out
):
    i = wp.tid()
    velocities[i] = (deltas[i] - previous[i]) / timing[0]


@wp.kernel(grid_stride=False)
def end_frame_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V] in and out
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    inverse_masses: wp.array(dtype=float),  # [V] 0 = kinematic
    targets: wp.array(dtype=wp.vec3),  # [V]
    anchors: wp.array(dtype=wp.vec3),  # [V] out
    motion: wp.array(dtype=float),  # [1] in and out: the farthest that a vertex moved
):
    i = wp.tid()
    anchors[i] = targets[i]
    start = vertices[i]
    moved = wp.length(deltas[i])
    if inverse_masses[i] > 0.0:
        vertices[i] = start + deltas[i]
        # What the addition rounded away isn't lost.
        deltas[i] = (start - vertices[i]) + deltas[i]
    else:
        vertices[i] = targets[i]
        deltas[i] = wp.vec3()
    if moved > motion[0]:  # a plain read spares most threads the atomic
        wp.atomic_max(motion, 0, moved)


@wp.kernel(grid_stride=False)
def hold_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V]
    newly_held: wp.array(dtype=bool),  # [V]
    anchors: wp.array(dtype=wp.vec3),  # [V] out
    targets: wp.array(dtype=wp.vec3),  # [V] out
):
    i = wp.tid()
    if newly_held[i]:
        anchors[i] = vertices[i]
        targets[i] = vertices[i]


@wp.kernel(grid_stride=False)
def move_kernel(
    ids: wp.array(dtype=int),  # [K]
    places: wp.array(dtype=wp.vec3),  # [K]
    targets: wp.array(dtype=wp.vec3),  # [V] out
):
    k = wp.tid()
    targets[ids[k]] = places[k]
