"""One frame of the solver in float64 NumPy: every kernel has to agree with it.

A frame is n substeps of length h.  The order within a substep is part of the definition:

1.  Prediction.  kinematic:  x ← start + (s + 1)/n · (target − start),   s = 0..n−1
                 free:       v ← v exp(−δ h) + h g,   v ← wind + (v − wind) exp(−c h),
                             |v| ≤ v_max,  x ← x + h v
2.  Edges color by color, then volumes color by color (constraints.py).
3.  Springs.     u = anchor + (s + 1)/n · (target − anchor) − x,   a = 1/(k h²),
                 x ← x + u min(w/(w + a), w F h²/|u|)
4.  Contacts, all at once (contact/reference.py).
5.  Ground.      A vertex that is p below it moves up by p; p = 0 above it.  With the running
                 mean p̄ ← p̄ + (p − p̄) PRESS_SHARE it moves back along the ground by at most
                 friction · p̄ of its way in this substep.  One that began the substep more than
                 LEAVING_SPEED h below gets no higher than by that way, and no velocity from it.
6.  Colliders.   One after another: a vertex that is p inside moves out by p, and back across
                 that way by at most friction · p of its way relative to the collider.
7.  Velocities.  v ← (x − x before the substep)/h
At the frame's end: anchor ← target.  In parts that nothing holds, damping acts once, at the
frame's start, and spares their rigid motion (rigid_motion.py); there δ is 0 in 1.

In float32 the kernels (substep.h) keep x as the position at the frame's start plus a small
delta d, and a difference x_i − x_j as its span at the frame's start plus d_i − d_j.  With x
itself, the roundings of 20 substeps shake a resting body by 0.2 % of its size for ever
(measured).

Units: x [m], v [m/s], h [s], δ damping [1/s], c air drag [1/s], g [m/s²], k [N/m], F [N],
w [1/kg].
Shapes: V vertices, E edges, T tets.
"""

from dataclasses import dataclass

import numpy as np

from ...geometry import signed_volumes
from ..colliders import way_out
from ..constraints import (
    COLLAPSED,
    LEAVING_SPEED,
    PRESS_SHARE,
    STEP_LIMIT,
    EdgeConstraints,
    VolumeConstraints,
    volume_gradients,
)
from ..contact.reference import ContactList, pushed
from ..rigid_motion import rigid_velocities
from ..xpbd_options import Timing

TINY = 1e-200  # in place of a length of 0


@dataclass(frozen=True)
class Frame:
    """The input of a frame besides positions and velocities."""

    timing: Timing
    substep_count: int  # n
    inverse_masses: np.ndarray  # [V] w, 0 = kinematic
    anchors: np.ndarray  # [V, 3] targets at the frame's start
    targets: np.ndarray  # [V, 3] of kinematic vertices and springs at its end
    edges: EdgeConstraints  # those in use
    edge_regularization: np.ndarray  # [E] a
    volumes: VolumeConstraints | None = None  # None leaves them out
    volume_regularization: np.ndarray | None = None  # [T] a
    springs: np.ndarray | None = None  # [V, 2] a, negative without a spring; the longest move
    colliders: np.ndarray | tuple = ()  # rows as on the device, see colliders.py
    presses: np.ndarray | None = None  # [V] p̄ at the frame's start; None is 0
    free_parts: np.ndarray | None = None  # [V] each vertex's part, -1 if something holds it
    contacts: ContactList | None = None


def step(frame: Frame, vertices, velocities):
    """Positions and velocities after one frame.  2 × [V, 3]"""
    x, v = vertices, velocities
    presses = np.zeros(len(x)) if frame.presses is None else frame.presses
    if frame.free_parts is not None:
        v = _damped(frame, x, v)
    for substep in range(frame.substep_count):
        fraction = (substep + 1) / frame.substep_count
        before = x
        x = _predicted(frame, x, v, vertices, fraction)
        x = _projected(frame, x)
        if frame.springs is not None:
            x = _pulled(frame, x, fraction)
        if frame.contacts is not None:
            timing = frame.timing
            inputs = frame.inverse_masses, timing.substep, timing.friction
            x, before = pushed(frame.contacts, x, before, *inputs)
        x, before, presses = _above_ground(frame, x, before, presses)
        for row in frame.colliders:
            x = _outside(frame, row, x, before, fraction)
        v = (x - before) / frame.timing.substep
    return x, v


def _damped(frame, x, v):
    """Velocities at the frame's start, those of free parts damped.  [V, 3]"""
    v = v.copy()
    for part in np.unique(frame.free_parts[frame.free_parts >= 0]):
        members = frame.free_parts == part
        rigid = rigid_velocities(x[members], v[members], 1.0 / frame.inverse_masses[members])
        v[members] = rigid + frame.timing.decay**frame.substep_count * (v[members] - rigid)
    return v


def _predicted(frame, x, v, start, fraction):
    timing = frame.timing
    gravity = np.array([timing.gravity_x, timing.gravity_y, timing.gravity_z])
    decay = timing.decay
    if frame.free_parts is not None:
        decay = np.where(frame.free_parts >= 0, 1.0, decay)[:, None]
    v = decay * v + timing.substep * gravity
    v = timing.air * v + np.array([timing.gust_x, timing.gust_y, timing.gust_z])
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    v = np.where(speed > timing.speed_limit, timing.speed_limit / np.maximum(speed, TINY), 1.0) * v
    way = start + fraction * (frame.targets - start)
    return np.where((frame.inverse_masses > 0)[:, None], x + timing.substep * v, way)


def _projected(frame, x):
    w, edges, tets = frame.inverse_masses, frame.edges, frame.volumes
    for first, last in zip(edges.offsets[:-1], edges.offsets[1:], strict=True):
        color, a = slice(first, last), frame.edge_regularization[first:last]
        ends, lengths = edges.vertices[color], edges.rest_values[color]
        x = project_edges(x, w, ends, lengths, a, np.arange(first, last))
    if tets is not None:
        for first, last in zip(tets.offsets[:-1], tets.offsets[1:], strict=True):
            color, a = slice(first, last), frame.volume_regularization[first:last]
            x = project_volumes(x, w, tets.vertices[color], tets.rest_values[color], a)
    return x


def _pulled(frame, x, fraction):
    w, (a, longest) = frame.inverse_masses, frame.springs.T
    on = (a >= 0) & (w > 0)
    goal = frame.anchors + fraction * (frame.targets - frame.anchors)
    move = np.where(on, w / np.where(on, w + a, 1.0), 0.0)[:, None] * (goal - x)
    length = np.linalg.norm(move, axis=1)
    shorter = np.where(length > longest, longest / np.maximum(length, TINY), 1.0)
    return x + shorter[:, None] * move


def _above_ground(frame, x, before, presses):
    free = frame.inverse_masses > 0
    leaving = LEAVING_SPEED * frame.timing.substep
    deep = before[:, 2] < frame.timing.ground - leaving
    lowest = np.where(deep, before[:, 2] + leaving, frame.timing.ground)
    push = np.where(free, np.maximum(lowest - x[:, 2], 0.0), 0.0)
    presses = presses + PRESS_SHARE * (push - presses)
    along = (x - before)[:, :2]
    length = np.linalg.norm(along, axis=1)
    undone = np.minimum(1.0, frame.timing.friction * presses / np.maximum(length, TINY))
    x = x.copy()
    x[:, 2] += push
    x[:, :2] -= np.where(free, undone, 0.0)[:, None] * along
    before = before.copy()
    before[:, 2] = np.where(deep & (push > 0.0), x[:, 2], before[:, 2])
    return x, before, presses


def _outside(frame, row, x, before, fraction):
    way = np.subtract(row[4:7], row[1:4])
    units, push = way_out(row, row[1:4] + fraction * way, x)
    push = np.where(frame.inverse_masses > 0, push, 0.0)[:, None]
    x = x + push * units
    slid = x - before - way / frame.substep_count
    slid -= (slid * units).sum(axis=1, keepdims=True) * units
    length = np.linalg.norm(slid, axis=1, keepdims=True)
    return x - np.minimum(1.0, frame.timing.friction * push / np.maximum(length, TINY)) * slid


def project_edges(vertices, inverse_masses, ends, rest_lengths, regularization, ids):
    """Positions after a projection of the edges of one color.  [V, 3]

    Args:
        regularization: a.  [E]
        ids: Index of each edge in the sorted list.  [E]
    """
    first, second = ends[:, 0], ends[:, 1]
    w = inverse_masses[first] + inverse_masses[second]
    along = vertices[first] - vertices[second]
    length = np.linalg.norm(along, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        direction = np.where(
            (length > COLLAPSED * rest_lengths)[:, None],
            along / length[:, None],
            fallback_directions(ids),
        )
        multiplier = (rest_lengths - length) / (w + regularization)
    move = np.where(w > 0, multiplier, 0.0)[:, None] * direction
    moved = vertices.copy()
    moved[first] += inverse_masses[first, None] * move
    moved[second] -= inverse_masses[second, None] * move
    return moved


def fallback_directions(ids):
    """A fixed pseudo-random unit vector for each edge id.  [E, 3]"""
    bits = (ids.astype(np.uint32) + np.uint32(1)) * np.uint32(2654435761)
    bits ^= bits >> np.uint32(16)
    bits *= np.uint32(2246822519)
    bits ^= bits >> np.uint32(13)
    z = (bits & np.uint32(0xFFFF)) / 32768.0 - 1.0
    angle = (bits >> np.uint32(16)) * (2.0 * np.pi / 65536.0)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def project_volumes(vertices, inverse_masses, tets, rest_volumes, regularization):
    """Positions after a projection of the tets of one color.  [V, 3]

    Args:
        rest_volumes: 6 V0.  [T]
        regularization: a.  [T]
    """
    gradients = volume_gradients(vertices, tets)
    w = inverse_masses[tets]
    squared = (gradients**2).sum(-1)
    constraint = 6.0 * signed_volumes(vertices, tets) - rest_volumes
    with np.errstate(invalid="ignore", divide="ignore"):
        multiplier = -constraint / ((w * squared).sum(1) + regularization)
    multiplier[~(w > 0).any(axis=1)] = 0.0
    longest = np.abs(multiplier) * (w * np.sqrt(squared)).max(1)
    limit = STEP_LIMIT * np.cbrt(rest_volumes)
    multiplier *= np.minimum(1.0, limit / np.maximum(longest, 1e-300))
    moved = vertices.copy()
    moved[tets] += multiplier[:, None, None] * w[:, :, None] * gradients
    return moved
