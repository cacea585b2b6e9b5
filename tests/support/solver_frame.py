"""A frame of the solver in float64: the definition's substep, with all that core/deform/frame adds.

Shapes: V vertices, E edges, T tets.
"""

from dataclasses import dataclass

import numpy as np
from resting import RigidMotion

from deformrf.core.definition.contact import Contacts, push_apart
from deformrf.core.definition.solver import (
    TINY,
    Constraints,
    extrapolated,
    limited,
    project_edges,
    project_volumes,
)
from deformrf.core.deform import FIRST_INTEGRATOR
from deformrf.core.deform.colliders import SPHERE
from deformrf.core.deform.constraints import (
    LEAVING_SPEED,
    PRESS_SHARE,
    EdgeConstraints,
    VolumeConstraints,
)
from deformrf.core.deform.xpbd_options import Timing


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
    contacts: Contacts | None = None


def defined(constraints, regularization) -> Constraints:
    """The program's constraints with their a [C], for the definition."""
    of_both = constraints.vertices, constraints.rest_values
    return Constraints(*of_both, regularization, constraints.offsets)


def settings_of(solver, dt):
    """What follows for a frame of dt [s] from a solver's settings: arguments of Frame."""
    material, options, integrator = solver.material, solver.options, solver.integrator
    w = solver._holds.inverse_masses
    timing = options.timing(dt, material.damping, solver.object_size, integrator.theta)
    sparse = integrator.sparse_floor if solver.volumes.sparse else integrator.floor
    of_edges, of_volumes = material.compliances(solver.edges, solver.volumes)
    if options.integrator != FIRST_INTEGRATOR:
        of_edges = of_edges / solver.edges.sheet_ratios.at(material.held_poisson_ratio)
    a_of = {"inverse_masses": w, "reach": timing.reach}
    settings = {
        "timing": timing,
        "substep_count": options.substeps(dt),
        "inverse_masses": w,
        "edges": solver.edges,
        "edge_regularization": solver.edges.regularization(
            of_edges, floor=integrator.floor, **a_of
        ),
    }
    if of_volumes is not None:
        a = solver.volumes.regularization(of_volumes, floor=sparse, **a_of)
        settings |= {"volumes": solver.volumes, "volume_regularization": a}
    return settings


def step(frame: Frame, vertices, velocities):
    """Positions and velocities after one frame.  2 × [V, 3]"""
    x, v, w, timing = vertices, velocities, frame.inverse_masses, frame.timing
    presses = np.zeros(len(x)) if frame.presses is None else frame.presses
    edges, volumes = defined(frame.edges, frame.edge_regularization), None
    if frame.volumes is not None:
        volumes = defined(frame.volumes, frame.volume_regularization)
    if frame.free_parts is not None:
        v = _damped(frame, x, v)
    for substep in range(frame.substep_count):
        fraction, before = (substep + 1) / frame.substep_count, x
        share = (substep + timing.theta) / frame.substep_count
        path = vertices + share * (frame.targets - vertices)
        v = limited(_driven(frame, v), timing.speed_limit)
        x = np.where((w > 0)[:, None], x + timing.reach * v, path)
        x = project_edges(x, w, edges)
        if volumes is not None:
            x = project_volumes(x, w, volumes)
        if frame.springs is not None:
            x = _pulled(frame, x, share)
        late_fall = timing.air * gravity(timing)
        x, v = extrapolated(before, x, v, timing.substep, timing.theta, late_fall)
        v = np.where((w > 0.0)[:, None], v, (x - before) / timing.substep)
        if frame.contacts is not None:
            of_substep = w, timing.substep, timing.friction
            x, before, v = push_apart(frame.contacts, x, before, v, *of_substep)
        if timing.theta < 1.0:
            continue  # there is neither a ground nor a collider
        x, before, presses = _above_ground(frame, x, before, presses)
        for row in frame.colliders:
            x = _outside(frame, row, x, before, fraction)
        v = (x - before) / timing.substep
    return x, v


def gravity(timing):
    return np.array([timing.gravity_x, timing.gravity_y, timing.gravity_z])


def _damped(frame, x, v):
    """Velocities at the frame's start, those of free parts damped.  [V, 3]"""
    v = v.copy()
    for part in np.unique(frame.free_parts[frame.free_parts >= 0]):
        members = frame.free_parts == part
        rigid = rigid_velocities(x[members], v[members], 1.0 / frame.inverse_masses[members])
        v[members] = rigid + frame.timing.decay**frame.substep_count * (v[members] - rigid)
    return v


def rigid_velocities(vertices, velocities, masses):
    """s of rigid_motion.py, of the vertices of one part, in float64.  [V, 3]"""
    return RigidMotion.of(vertices, velocities, masses).at(vertices)


def _driven(frame, v):
    """Velocities after damping, gravity and the air of a substep."""
    timing, decay = frame.timing, frame.timing.decay
    if frame.free_parts is not None:
        decay = np.where(frame.free_parts >= 0, 1.0, decay)[:, None]
    v = decay * v + timing.reach * gravity(timing)
    return timing.air * v + np.array([timing.gust_x, timing.gust_y, timing.gust_z])


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


def way_out(row, center, points):
    """Unit vectors [N, 3] and distances [N] that lead points out of a collider; 0 outside.

    Args:
        row: As on the device.  [COLLIDER_SIZE]
        center: Where the collider is now.  [3]
        points: [N, 3]
    """
    arms, half = points - center, np.asarray(row[7:])
    if row[0] == SPHERE:
        lengths = np.linalg.norm(arms, axis=1)
        up = np.array([0.0, 0.0, 1.0])
        units = np.where((lengths > 0)[:, None], arms / np.maximum(lengths, 1e-300)[:, None], up)
        return units, np.maximum(half[0] - lengths, 0.0)
    depths = half - np.abs(arms)
    axis = depths.argmin(axis=1)
    every = np.arange(len(points))
    units = np.zeros_like(arms)
    units[every, axis] = np.where(arms[every, axis] < 0.0, -1.0, 1.0)
    return units, np.maximum(depths[every, axis], 0.0)
