"""Checks of the solver's arguments.  Each raises a ValueError that tells the user what to do.

Shapes: V vertices, K handles, C constraints.
"""

import math

import numpy as np

FARTHEST = 1e9  # m and m/s; products of four lengths have to fit into float32
LONGEST_TIME = 1e6  # s, of a step; the squares of longer ones leave float32


def number(what, value, positive=False):
    """Check a number: finite, and 0 or more, or positive."""
    if not (math.isfinite(value) and value >= 0.0) or (positive and value == 0.0):
        wanted = "a positive number" if positive else "0 or more"
        raise ValueError(f"the {what} is {value}; give {wanted}")


def time_step(dt):
    """Check the length of a time step."""
    if not 0.0 < dt <= LONGEST_TIME:
        most = f"{LONGEST_TIME:g}"
        raise ValueError(f"a time step of {dt} s; give a positive number up to {most}")


def per_vertex(values, vertex_count, what, dtype=float):
    """A copy as an array.  [V]"""
    values = np.array(values, dtype)
    if values.shape != (vertex_count,):
        raise ValueError(f"{what} of shape {values.shape}; the mesh has {vertex_count} vertices")
    return values


def vectors(values, count, what, of):
    """Finite float32 vectors, clipped to FARTHEST.  [count, 3]"""
    values = np.asarray(values, np.float32)
    if values.shape != (count, 3):
        raise ValueError(f"the {what}s have shape {values.shape}; there are {count} {of}s")
    finite = np.isfinite(values)
    if not finite.all():
        wrong = int(np.argmin(finite.all(axis=1)))
        raise ValueError(f"the {what} of {of} {wrong} is {values[wrong]}; give finite ones")
    return np.clip(values, -FARTHEST, FARTHEST)


def factors(values, vertex_count):
    """Positive factors of the stiffness.  [V]"""
    values = per_vertex(values, vertex_count, "stiffness factors")
    wrong = np.flatnonzero(~(np.isfinite(values) & (values > 0.0)))
    if len(wrong):
        value = values[wrong[0]]
        raise ValueError(f"vertex {wrong[0]} has a stiffness factor of {value}; give positive ones")
    return values


def masses(values, vertex_count):
    """Masses of 0 or more, in float64.  [V]"""
    values = per_vertex(values, vertex_count, "masses")
    wrong = np.flatnonzero(~(np.isfinite(values) & (values >= 0.0)))
    if len(wrong):
        raise ValueError(f"vertex {wrong[0]} has a mass of {values[wrong[0]]} kg; give 0 or more")
    return values


def compliances(values, count, what):
    """A number or an array, as one compliance of 0 or more for each constraint.  [C] float64"""
    values = np.asarray(values, float)
    if values.shape not in ((), (count,)):
        raise ValueError(f"compliances of shape {values.shape} for {count} {what}")
    wrong = values[~(values >= 0.0)]
    if wrong.size:
        raise ValueError(f"a compliance of the {what} is {wrong.flat[0]}; give 0 or more")
    return np.broadcast_to(values, count)


def handles(ids, vertex_count):
    """Ids of vertices that exist.  [K] int"""
    ids = np.asarray(ids, np.int64).reshape(-1)
    if len(ids) and not (0 <= ids.min() and ids.max() < vertex_count):
        raise ValueError(
            f"handles {ids.min()} to {ids.max()}; the mesh has {vertex_count} vertices"
        )
    return ids


def springs(stiffness, force_limit, handle_count):
    """Stiffness [N/m], finite, and force limit [N] of each handle, both positive.  [K, 2]"""
    springs = np.empty((handle_count, 2))
    springs[:, 0], springs[:, 1] = stiffness, force_limit
    if not (np.isfinite(springs[:, 0]).all() and (springs > 0.0).all()):
        raise ValueError(
            f"springs of {stiffness} N/m that pull with up to {force_limit} N; give positive "
            "numbers, a finite stiffness"
        )
    return springs
