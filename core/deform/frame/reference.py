"""One frame of the solver in float64 NumPy: what every kernel has to agree with.

The order within a substep is the definition: move, edges color by color, volumes color
by color, springs, ground, velocities.  See constraints.py and integration.py.

Shapes: V vertices, E edges, T tets.
"""

from dataclasses import dataclass

import numpy as np

from ..constraints import EdgeConstraints, VolumeConstraints, project_edges, project_volumes
from ..xpbd_options import Timing

TINY = 1e-200  # in place of a length of 0


@dataclass(frozen=True)
class Frame:
    """What a frame takes besides positions and velocities.

    Attributes:
        timing: h and what all vertices share.
        substep_count: n.
        inverse_masses: w, 0 = kinematic.  [V]
        anchors: Where targets were at the frame's start.  [V, 3]
        targets: Where kinematic vertices and springs' ends are at its end.  [V, 3]
        edges: Those in use.
        edge_regularization: a.  [E]
        volumes: Those in use; None leaves them out.
        volume_regularization: a.  [T]
        springs: a, negative where there is none, and the longest move.  [V, 2]
    """

    timing: Timing
    substep_count: int
    inverse_masses: np.ndarray
    anchors: np.ndarray
    targets: np.ndarray
    edges: EdgeConstraints
    edge_regularization: np.ndarray
    volumes: VolumeConstraints | None = None
    volume_regularization: np.ndarray | None = None
    springs: np.ndarray | None = None


def step(frame: Frame, vertices, velocities):
    """Positions and velocities after one frame.  2 x [V, 3]"""
    x, v = vertices, velocities
    for substep in range(frame.substep_count):
        fraction = (substep + 1) / frame.substep_count
        before = x
        x = _predicted(frame, x, v, vertices, fraction)
        x = _projected(frame, x)
        if frame.springs is not None:
            x = _pulled(frame, x, fraction)
        x = _above_ground(frame, x, before)
        v = (x - before) / frame.timing.substep
    return x, v


def _predicted(frame, x, v, start, fraction):
    timing = frame.timing
    gravity = np.array([timing.gravity_x, timing.gravity_y, timing.gravity_z])
    v = timing.decay * v + timing.substep * gravity
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    v = np.where(speed > timing.speed_limit, timing.speed_limit / np.maximum(speed, TINY), 1.0) * v
    way = start + fraction * (frame.targets - start)
    return np.where((frame.inverse_masses > 0)[:, None], x + timing.substep * v, way)


def _projected(frame, x):
    w, edges, tets = frame.inverse_masses, frame.edges, frame.volumes
    for first, last in zip(edges.offsets[:-1], edges.offsets[1:], strict=True):
        color, a = slice(first, last), frame.edge_regularization[first:last]
        ends, lengths = edges.vertices[color], edges.rest_lengths[color]
        x = project_edges(x, w, ends, lengths, a, np.arange(first, last))
    if tets is not None:
        for first, last in zip(tets.offsets[:-1], tets.offsets[1:], strict=True):
            color, a = slice(first, last), frame.volume_regularization[first:last]
            x = project_volumes(x, w, tets.vertices[color], tets.rest_volumes[color], a)
    return x


def _pulled(frame, x, fraction):
    w, (a, longest) = frame.inverse_masses, frame.springs.T
    on = (a >= 0) & (w > 0)
    goal = frame.anchors + fraction * (frame.targets - frame.anchors)
    move = np.where(on, w / np.where(on, w + a, 1.0), 0.0)[:, None] * (goal - x)
    length = np.linalg.norm(move, axis=1)
    shorter = np.where(length > longest, longest / np.maximum(length, TINY), 1.0)
    return x + shorter[:, None] * move


def _above_ground(frame, x, before):
    free = frame.inverse_masses > 0
    push = np.where(free, np.maximum(frame.timing.ground - x[:, 2], 0.0), 0.0)
    along = (x - before)[:, :2]
    length = np.linalg.norm(along, axis=1)
    undone = np.minimum(1.0, frame.timing.friction * push / np.maximum(length, TINY))
    x = x.copy()
    x[:, 2] += push
    x[:, :2] -= undone[:, None] * along
    return x
