"""What happens to vertices around the constraints: handles, inertia, the frame's end.

    kinematic:  d ← (s + 1)/n · (target − x),   s = 0..n−1 the substep
    free:       v ← v exp(−δ h) + h g,  |v| ≤ v_max,  d ← d + h v
    v ← (d − d before the substep)/h
    at the frame's end:  x ← x + d

Here x is the position at the frame's start and d the way from there; see constraints.py
for why they are apart.

Units: x, d [m], v [m/s], h [s], δ damping [1/s], g [m/s²].  Shapes: V vertices, K handles.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel(grid_stride=False)
def predict_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V] at the frame's start
    deltas: wp.array(dtype=wp.vec3),  # [V] in and out
    velocities: wp.array(dtype=wp.vec3),  # [V]
    inverse_masses: wp.array(dtype=float),  # [V] 0 = kinematic
    targets: wp.array(dtype=wp.vec3),  # [V] where kinematic vertices go
    timing: wp.array(dtype=float),  # [3] h, exp(-δ h), v_max
    gravity: wp.vec3,
    fraction: float,  # of the frame that is over after this substep
    previous: wp.array(dtype=wp.vec3),  # [V] out
):
    i = wp.tid()
    delta = deltas[i]
    previous[i] = delta
    if inverse_masses[i] > 0.0:
        v = timing[1] * velocities[i] + timing[0] * gravity
        speed = wp.length(v)
        if speed > timing[2]:
            v = (timing[2] / speed) * v
        deltas[i] = delta + timing[0] * v
    else:
        deltas[i] = fraction * (targets[i] - vertices[i])


@wp.kernel(grid_stride=False)
def update_velocities_kernel(
    deltas: wp.array(dtype=wp.vec3),  # [V]
    previous: wp.array(dtype=wp.vec3),  # [V]
    timing: wp.array(dtype=float),  # [3] h, exp(-δ h), v_max
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
    motion: wp.array(dtype=float),  # [1] in and out: the farthest that a vertex moved
):
    i = wp.tid()
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
    targets: wp.array(dtype=wp.vec3),  # [V] out
):
    i = wp.tid()
    if newly_held[i]:
        targets[i] = vertices[i]


@wp.kernel(grid_stride=False)
def move_kernel(
    ids: wp.array(dtype=int),  # [K]
    places: wp.array(dtype=wp.vec3),  # [K]
    targets: wp.array(dtype=wp.vec3),  # [V] out
):
    k = wp.tid()
    targets[ids[k]] = places[k]
