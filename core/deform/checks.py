"""What a caller hands to the solver: right shapes and finite numbers, or a sentence.

Shapes: V vertices, K handles, C constraints.
"""

import numpy as np

FARTHEST = 1e9  # m, m/s; the products of four lengths have to fit into float32


def pin_mask(mask, vertex_count):
    """A copy.  [V] bool

    Raises:
        ValueError: It has another shape.
    """
    mask = np.array(mask, bool)
    if mask.shape != (vertex_count,):
        raise ValueError(
            f"the pin mask has shape {mask.shape}; the mesh has {vertex_count} vertices"
        )
    return mask


def vectors(values, count, what, of):
    """Float32, none of them beyond FARTHEST.  [count, 3]

    Raises:
        ValueError: They have another shape, or one is NaN or infinite.
    """
    values = np.asarray(values, np.float32)
    if values.shape != (count, 3):
        raise ValueError(f"the {what}s have shape {values.shape}; there are {count} {of}s")
    wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(wrong):
        raise ValueError(f"the {what} of {of} {wrong[0]} is {values[wrong[0]]}; give finite ones")
    return np.clip(values, -FARTHEST, FARTHEST)


def masses(values, vertex_count):
    """Float64.  [V]

    Raises:
        ValueError: They have another shape, or one is negative, NaN or infinite.
    """
    values = np.asarray(values, float)
    if values.shape != (vertex_count,):
        raise ValueError(
            f"the masses have shape {values.shape}; the mesh has {vertex_count} vertices"
        )
    wrong = np.flatnonzero(~(np.isfinite(values) & (values >= 0.0)))
    if len(wrong):
        raise ValueError(f"vertex {wrong[0]} has a mass of {values[wrong[0]]} kg; give 0 or more")
    return values


def compliances(values, count, what):
    """One per constraint.  [C] float64

    Args:
        values: [C] or a number
        what: The constraints, as the message names them.

    Raises:
        ValueError: They have another shape, or one is negative or NaN.
    """
    values = np.asarray(values, float)
    if values.shape not in ((), (count,)):
        raise ValueError(f"compliances of shape {values.shape} for {count} {what}")
    wrong = values[~(values >= 0.0)]
    if wrong.size:
        raise ValueError(f"a compliance of the {what} is {wrong.flat[0]}; give 0 or more")
    return np.broadcast_to(values, count)


def handles(ids, vertex_count):
    """[K] int

    Raises:
        ValueError: There is no such vertex.
    """
    ids = np.asarray(ids, np.int64).reshape(-1)
    if len(ids) and not (0 <= ids.min() and ids.max() < vertex_count):
        raise ValueError(
            f"handles {ids.min()} to {ids.max()}; the mesh has {vertex_count} vertices"
        )
    return ids


def springs(stiffness, force_limit, handle_count):
    """Stiffness [N/m] and force limit [N] of each handle.  [K, 2]

    Raises:
        ValueError: One isn't positive, or a stiffness is infinite.
    """
    springs = np.empty((handle_count, 2))
    springs[:, 0], springs[:, 1] = stiffness, force_limit
    if not (np.isfinite(springs[:, 0]).all() and (springs > 0.0).all()):
        raise ValueError(
            f"springs of {stiffness} N/m that pull with up to {force_limit} N; give positive "
            "numbers, a finite stiffness"
        )
    return springs
