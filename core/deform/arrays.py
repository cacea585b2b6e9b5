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

CPU_GROUP = 8  # constraints that a CPU projects at once
CUDA_GROUP = 32  # threads of a warp


class VertexArrays(NamedTuple):
    """One entry per vertex.

    Attributes:
        vertices: Positions at the frame's start.  [V] vec3
        deltas: The way from there; between frames, what float32 rounded away.  [V] vec3
        velocities: [V] vec3
        inverse_masses: 0 = kinematic.  [V]
        anchors: Where targets were at the frame's start; of springs only.  [V] vec3
        targets: Where kinematic vertices and springs' ends are at its end.  [V] vec3
        springs: a = 1/(k h²) or NO_SPRING, and the longest move w F h².  [V] vec2
    """

    vertices: wp.array
    deltas: wp.array
    velocities: wp.array
    inverse_masses: wp.array
    anchors: wp.array
    targets: wp.array
    springs: wp.array


class ConstraintArrays(NamedTuple):
    """One entry per constraint in use, sorted by color.

    A color begins at a multiple of a group (CPU_GROUP, CUDA_GROUP) and fills whole groups;
    entries that aren't used have vertex V, which no array but a frame's own has.

    Attributes:
        vertices: [C] vec2i or vec4i
        ids: Where it stands in the list of all constraints.  [C] int
        rest_values: L or 6 V0.  [C]
        regularization: a.  [C]
        offsets: Color c is offsets[c]:offsets[c + 1]; it may be empty.  [color_count + 1]
    """

    vertices: wp.array
    ids: wp.array
    rest_values: wp.array
    regularization: wp.array
    offsets: wp.array


@wp.struct
class FrameArrays:
    """All of it, as the kernels of a frame take it; edge_ and tet_ are ConstraintArrays."""

    vertices: wp.array(dtype=wp.vec3)
    deltas: wp.array(dtype=wp.vec3)
    velocities: wp.array(dtype=wp.vec3)
    inverse_masses: wp.array(dtype=float)
    anchors: wp.array(dtype=wp.vec3)
    targets: wp.array(dtype=wp.vec3)
    springs: wp.array(dtype=wp.vec2)
    timing: wp.array(dtype=float)  # integration.Timing
    motion: wp.array(dtype=float)  # feedback.py
    edge_vertices: wp.array(dtype=wp.vec2i)
    edge_ids: wp.array(dtype=int)
    edge_rest: wp.array(dtype=float)
    edge_regularization: wp.array(dtype=float)
    edge_offsets: wp.array(dtype=int)
    tet_vertices: wp.array(dtype=wp.vec4i)
    tet_rest: wp.array(dtype=float)
    tet_regularization: wp.array(dtype=float)
    tet_offsets: wp.array(dtype=int)
    vertex_count: int
    edge_room: int  # entries of ConstraintArrays
    tet_room: int
    edge_color_count: int
    tet_color_count: int


def frame_arrays(state: VertexArrays, edges, volumes, timing, motion) -> FrameArrays:
    """Everything in one struct; edges and volumes are ConstraintLists."""
    frame = FrameArrays()
    for name, array in state._asdict().items():
        setattr(frame, name, array)
    frame.timing, frame.motion = timing, motion
    for kind, arrays in (("edge", edges.arrays), ("tet", volumes.arrays)):
        setattr(frame, f"{kind}_vertices", arrays.vertices)
        setattr(frame, f"{kind}_rest", arrays.rest_values)
        setattr(frame, f"{kind}_regularization", arrays.regularization)
        setattr(frame, f"{kind}_offsets", arrays.offsets)
        setattr(frame, f"{kind}_room", len(arrays.vertices))
        setattr(frame, f"{kind}_color_count", len(arrays.offsets) - 1)
    frame.edge_ids = edges.arrays.ids
    frame.vertex_count = len(state.vertices)
    return frame


def vertex_arrays(count, device) -> VertexArrays:
    """All zero, without springs."""

    def zeros(dtype=wp.vec3):
        return wp.zeros(count, dtype=dtype, device=device)

    springs = wp.full(count, wp.vec2(integration.NO_SPRING, 0.0), dtype=wp.vec2, device=device)
    x, d, v, anchors, targets = (zeros() for _ in range(5))
    return VertexArrays(x, d, v, zeros(float), anchors, targets, springs)


def upload(array, dtype, device):
    """A new array on the device; floating-point numbers become float32."""
    if np.issubdtype(array.dtype, np.floating):
        array = array.astype(np.float32)
    return wp.array(np.ascontiguousarray(array), dtype=dtype, device=device)


class ConstraintList:
    """The constraints of one type that are in use, on the device.

    Attributes:
        constraints: All of them, an EdgeConstraints or a VolumeConstraints.
        in_use: Indices into it, by color.  [N] int
        vertices: As in `arrays`, on the host.  [C, 2 or 4] int32
        arrays: ConstraintArrays with room for all.
    """

    def __init__(self, constraints, rest_values, dtype, vertex_count, device, by_class=False):
        """Take constraints; `by_class` puts translates side by side within a color."""
        self.constraints = constraints
        self._by_class = by_class
        self._rest_values = rest_values
        self._unused = vertex_count
        self._group = CUDA_GROUP if device.is_cuda else CPU_GROUP
        offsets = constraints.offsets
        self._colors = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
        room = int(self._whole_groups(np.diff(offsets)).sum())
        self.vertices = np.empty((room, constraints.vertices.shape[1]), np.int32)
        self.arrays = ConstraintArrays(
            wp.zeros(room, dtype=dtype, device=device),
            wp.zeros(room, dtype=int, device=device),
            wp.zeros(room, dtype=float, device=device),
            wp.zeros(room, dtype=float, device=device),
            wp.zeros(len(offsets), dtype=int, device=device),
        )
        self.in_use = None
        self.select(np.ones(vertex_count, bool))

    def _whole_groups(self, counts):
        return -(-counts // self._group) * self._group

    def select(self, movable) -> bool:
        """Use the constraints that have a movable vertex ([V] bool); whether that is new."""
        in_use = np.flatnonzero(movable[self.constraints.vertices].any(axis=1))
        if self._by_class:
            keys = in_use, self.constraints.classes[in_use], self._colors[in_use]
            in_use = in_use[np.lexsort(keys)]
        if self.in_use is not None and np.array_equal(in_use, self.in_use):
            return False
        self.in_use = in_use
        counts = np.bincount(self._colors[in_use], minlength=len(self.arrays.offsets) - 1)
        starts = np.append(0, np.cumsum(self._whole_groups(counts)))
        within = np.arange(len(in_use)) - np.repeat(np.append(0, np.cumsum(counts))[:-1], counts)
        self._places = np.repeat(starts[:-1], counts) + within
        self.vertices[:] = self._unused
        self.vertices[self._places] = self.constraints.vertices[in_use]
        self.arrays.vertices.assign(self.vertices)
        self._put(self.arrays.ids, in_use)
        self._put(self.arrays.rest_values, self._rest_values[in_use])
        self.arrays.offsets.assign(starts.astype(np.int32))
        return True

    def set_regularization(self, values):
        """Take a of all constraints.  [C]

        Where nothing can move and nothing gives, a is 0; any other number keeps 0/0 away.
        """
        values = values[self.in_use]
        self._put(self.arrays.regularization, np.where(values > 0.0, values, 1.0))

    def _put(self, array, values):
        """Fill an array, with 1 in unused entries: no division by zero happens there."""
        kind = np.float32 if np.issubdtype(values.dtype, np.floating) else np.int32
        filled = np.ones(len(self.vertices), kind)
        filled[self._places] = values
        array.assign(filled)
