"""The solver's state on a device: arrays that stay the same for its whole life.

A frame reads and writes these and nothing else.  Whatever a user changes (handles, pins,
material, time step, which parts are at rest) changes their contents, never their sizes,
so that a recorded frame goes on being right.

Shapes: V vertices, C constraints of one type, of which the first offsets[-1] are in use.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from . import integration


class VertexArrays(NamedTuple):
    """One entry per vertex.

    Attributes:
        vertices: Positions at the frame's start.  [V] vec3
        deltas: The way from there; between frames, what float32 rounded away.  [V] vec3
        previous: Deltas at the substep's start.  [V] vec3
        velocities: [V] vec3
        inverse_masses: 0 = kinematic.  [V]
        anchors: Where targets were at the frame's start; of springs only.  [V] vec3
        targets: Where kinematic vertices and springs' ends are at its end.  [V] vec3
        springs: a = 1/(k h²) or NO_SPRING, and the longest move w F h².  [V] vec2
    """

    vertices: wp.array
    deltas: wp.array
    previous: wp.array
    velocities: wp.array
    inverse_masses: wp.array
    anchors: wp.array
    targets: wp.array
    springs: wp.array


class ConstraintArrays(NamedTuple):
    """One entry per constraint in use, sorted by color, in the order that kernels take them.

    Attributes:
        vertices: [C] vec2i or vec4i
        spans: Differences of its vertices at the frame's start.  [C] or [3 C] vec3
        rest_values: L or 6 V0.  [C]
        regularization: a.  [C]
        offsets: Color c is offsets[c]:offsets[c + 1]; it may be empty.  [color_count + 1]
    """

    vertices: wp.array
    spans: wp.array
    rest_values: wp.array
    regularization: wp.array
    offsets: wp.array


def vertex_arrays(count, device) -> VertexArrays:
    """All zero, without springs."""

    def zeros(dtype=wp.vec3):
        return wp.zeros(count, dtype=dtype, device=device)

    springs = wp.full(count, wp.vec2(integration.NO_SPRING, 0.0), dtype=wp.vec2, device=device)
    x, d, previous, v, anchors, targets = (zeros() for _ in range(6))
    return VertexArrays(x, d, previous, v, zeros(float), anchors, targets, springs)


def upload(array, dtype, device):
    """A new array on the device; floating-point numbers become float32."""
    if np.issubdtype(array.dtype, np.floating):
        array = array.astype(np.float32)
    return wp.array(np.ascontiguousarray(array), dtype=dtype, device=device)


class ConstraintList:
    """The constraints of one type that are in use, on the device.

    Attributes:
        constraints: All of them, an EdgeConstraints or a VolumeConstraints.
        in_use: Indices into it, ascending.  [N] int
        offsets: As in `arrays`, on the host.
        arrays: ConstraintArrays with room for all.
    """

    def __init__(self, constraints, rest_values, dtype, device):
        self.constraints = constraints
        self.arrays = None
        self._rest_values = rest_values
        self._dtype = dtype
        count, width = constraints.vertices.shape
        span_count = count * (width - 1)
        self.in_use = np.arange(count)
        self.offsets = constraints.offsets
        self.arrays = ConstraintArrays(
            upload(constraints.vertices, dtype, device),
            wp.zeros(span_count, dtype=wp.vec3, device=device),
            upload(rest_values, float, device),
            wp.zeros(count, dtype=float, device=device),
            upload(np.asarray(constraints.offsets, np.int32), int, device),
        )

    def select(self, movable) -> bool:
        """Use the constraints that have a movable vertex ([V] bool); whether that is new."""
        keep = movable[self.constraints.vertices].any(axis=1)
        in_use = np.flatnonzero(keep)
        if np.array_equal(in_use, self.in_use):
            return False
        self.in_use = in_use
        self.offsets = np.append(0, np.cumsum(keep))[self.constraints.offsets]
        _write(self.arrays.vertices, self.constraints.vertices[in_use])
        _write(self.arrays.rest_values, self._rest_values[in_use])
        _write(self.arrays.offsets, self.offsets)
        return True

    def set_regularization(self, values):
        """Take a of all constraints.  [C]"""
        _write(self.arrays.regularization, values[self.in_use])


def _write(array, values):
    """Put values at the beginning of a device array."""
    if len(values):
        kind = np.float32 if np.issubdtype(values.dtype, np.floating) else np.int32
        array[: len(values)].assign(np.ascontiguousarray(values, kind))
