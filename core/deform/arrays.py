"""The solver's state on a device: arrays that are allocated once and keep their sizes.

A frame reads and writes these arrays and nothing else.  If the user changes something (handles,
pins, material, time step, sleeping parts), only their contents change, so a recorded
launch stays valid.

Shapes: V vertices, C constraints of one type, n = 2 (edges) or 4 (tets) vertices of each,
N contacts.
"""

import numpy as np
import warp as wp

from .colliders import COLLIDER_SIZE, MOST_COLLIDERS
from .constraints import NO_SPRING, ColoredConstraints
from .halves import SECTIONS
from .xpbd_options import Timing

CPU_GROUP = 8  # constraints that a CPU projects at once
CUDA_GROUP = 32  # threads of a warp
MOST_THREADS = 8  # of a frame on a CPU


@wp.struct
class VertexArrays:
    """One entry per vertex.  [V]"""

    vertices: wp.array(dtype=wp.vec3)  # positions at the frame's start
    deltas: wp.array(dtype=wp.vec3)  # displacements since then; between frames, rounding errors
    velocities: wp.array(dtype=wp.vec3)  # m/s
    inverse_masses: wp.array(dtype=float)  # 0 = kinematic
    anchors: wp.array(dtype=wp.vec3)  # targets at the frame's start, for springs
    targets: wp.array(dtype=wp.vec3)  # of kinematic vertices and springs at the frame's end
    springs: wp.array(dtype=wp.vec2)  # a = 1/(k h²) or NO_SPRING, and the longest move w F h²
    presses: wp.array(dtype=float)  # how far the ground pushes in a substep, a running mean [m]
    free: wp.array(dtype=int)  # 1 in parts that nothing holds (rigid_motion.py), else 0


@wp.struct
class ConstraintArrays:
    """One entry per constraint in use, sorted by color.

    A color begins at a multiple of a group (CPU_GROUP, CUDA_GROUP) and fills whole groups.
    The vertices of unused entries are V, one more than the last vertex, and have no mass.
    """

    vertices: wp.array2d(dtype=int)  # [C, n]
    ids: wp.array(dtype=int)  # [C] index in the list of all constraints
    rest_values: wp.array(dtype=float)  # [C] L or 6 V0
    regularization: wp.array(dtype=float)  # [C] a
    offsets: wp.array(dtype=int)  # [most colors + 1] color c is offsets[c]:offsets[c + 1]
    color_count: wp.array(dtype=int)  # [1] how many colors have constraints in use
    sections: wp.array(dtype=int)  # [4 · most colors + 1] where those of halves.py begin


@wp.struct
class ContactArrays:
    """The contacts of a frame (contact/detection.py), and each vertex's share in them.

    A contact is a point (1 − share) x_p + share x_q in front of a triangle a b c, or inside the
    body behind it.  Its vertices are p, q, a, b, c.
    """

    counts: wp.array(dtype=int)  # [2] how many contacts there are, and vertices in them
    vertices: wp.array2d(dtype=int)  # [N, 5]
    shares: wp.array(dtype=float)  # [N]
    spans: wp.array2d(dtype=float)  # [N, 9] b − a, c − a, point − a at the frame's start
    bevels: wp.array2d(dtype=float)  # [N, 9] and rims and tops (contact/surface.py)
    limits: wp.array(dtype=float)  # [2] soft_depth and speed of core/definition/contact.py
    offsets: wp.array(dtype=int)  # [V + 1] vertex i is in the entries offsets[i]:offsets[i + 1]
    entries: wp.array(dtype=int)  # [5 N] 8 × contact + place among its vertices, rising
    touched: wp.array(dtype=int)  # [V] the vertices in contacts
    results: wp.array2d(dtype=float)  # [N, 16] of a substep, see frame/contact.h
    loads: wp.array(dtype=int)  # [V] the sum of a vertex's weights in active contacts


@wp.struct
class FrameArrays:
    """Everything that a frame reads and writes."""

    state: VertexArrays
    edges: ConstraintArrays
    volumes: ConstraintArrays
    contacts: ContactArrays  # empty until contact is first looked for
    timing: wp.array(dtype=float)  # the numbers of a Timing
    colliders: wp.array2d(dtype=float)  # [MOST_COLLIDERS, COLLIDER_SIZE] see colliders.py
    motion: wp.array(dtype=float)  # [MOST_THREADS] the farthest move of a vertex, by thread [m]


def zeros(struct, device, **shapes):
    """A struct of arrays of these shapes, filled with zeros."""
    arrays = struct()
    for name, shape in shapes.items():
        dtype = struct.vars[name].type.dtype
        setattr(arrays, name, wp.zeros(shape, dtype=dtype, device=device))
    return arrays


def frame_arrays(vertex_count, edges: ConstraintArrays, volumes: ConstraintArrays, device):
    """FrameArrays at rest in the origin, without springs."""
    frame = zeros(
        FrameArrays,
        device,
        timing=len(Timing._fields),
        colliders=(MOST_COLLIDERS, COLLIDER_SIZE),
        motion=MOST_THREADS,
    )
    frame.state = zeros(VertexArrays, device, **dict.fromkeys(VertexArrays.vars, vertex_count))
    frame.state.springs.fill_(wp.vec2(NO_SPRING, 0.0))
    frame.edges, frame.volumes = edges, volumes
    frame.contacts = contact_arrays(1, 0, device)
    return frame


def contact_arrays(vertex_count, capacity, device):
    """ContactArrays without a contact, with space for so many."""
    return zeros(
        ContactArrays,
        device,
        counts=2,
        vertices=(capacity, 5),
        shares=capacity,
        spans=(capacity, 9),
        bevels=(capacity, 9),
        limits=2,
        offsets=vertex_count + 1,
        entries=5 * capacity,
        touched=vertex_count,
        results=(capacity, 16),
        loads=vertex_count,
    )


class ConstraintList:
    """The constraints of one type that are in use, on the device.

    Attributes:
        in_use: Indices of constraints, by color.  [N] int
        arrays: ConstraintArrays with space for all constraints.
    """

    def __init__(
        self, constraints: ColoredConstraints, vertex_count, device, by_class=False, halves=None
    ):
        """Use all constraints.

        Args:
            by_class: Put translates side by side within a color.
            halves: Put the sections of these Halves one after another within a color.
        """
        self.constraints = constraints
        count = len(constraints.vertices)
        self._classes = constraints.classes if by_class else np.zeros(count, int)
        self._sections = np.zeros(count, int) if halves is None else halves.sections(constraints)
        self._unused = vertex_count
        self._group = CUDA_GROUP if device.is_cuda else CPU_GROUP
        offsets = constraints.offsets
        self._colors = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
        capacity = int(self._whole_groups(self._counts(np.arange(count))).sum())
        self.arrays = zeros(
            ConstraintArrays,
            device,
            vertices=(capacity, constraints.vertices.shape[1]),
            ids=capacity,
            rest_values=capacity,
            regularization=capacity,
            offsets=len(offsets),
            color_count=1,
            sections=SECTIONS * (len(offsets) - 1) + 1,
        )
        self.in_use = None
        self._rest_values = constraints.rest_values.copy()  # of all, as last known
        self.select(np.ones(vertex_count, bool))

    @property
    def rest_values(self):
        """L or 6 V0 of all constraints, as they are on the device.  [C]"""
        if self.in_use is not None:
            on_device = self.arrays.rest_values.numpy()[self._places]
            changed = on_device != self._rest_values[self.in_use].astype(np.float32)
            self._rest_values[self.in_use[changed]] = on_device[changed]
        return self._rest_values

    def set_rest_values(self, values):
        """Take rest values of all constraints.  [C]"""
        self._rest_values = values.copy()
        self.put(self.arrays.rest_values, values)

    def _counts(self, in_use):
        """How many constraints each section of each color has in use."""
        places = SECTIONS * self._colors[in_use] + self._sections[in_use]
        return np.bincount(places, minlength=SECTIONS * (len(self.constraints.offsets) - 1))

    def _whole_groups(self, counts):
        return -(-counts // self._group) * self._group

    def select(self, movable, stiff=True):
        """Use the constraints that have a movable vertex [V] and are stiff [C].  bool"""
        in_use = np.flatnonzero(movable[self.constraints.vertices].any(axis=1) & stiff)
        keys = self._classes, self._sections, self._colors
        in_use = in_use[np.lexsort([in_use, *(key[in_use] for key in keys)])]
        if self.in_use is not None and np.array_equal(in_use, self.in_use):
            return
        rest_values = self.rest_values
        self.in_use = in_use
        counts = self._counts(in_use)
        starts = np.append(0, np.cumsum(self._whole_groups(counts)))
        unused_before = starts[:-1] - (np.cumsum(counts) - counts)  # entries before each section
        self._places = np.arange(len(in_use)) + np.repeat(unused_before, counts)
        self.put(self.arrays.vertices, self.constraints.vertices, self._unused)
        self.put(self.arrays.ids, np.arange(len(rest_values)))
        self.put(self.arrays.rest_values, rest_values)
        begins, end = starts[:-1].reshape(-1, SECTIONS), starts[-1]
        used = np.diff(begins[:, 0], append=end) > 0  # colors that have constraints in use
        self.arrays.color_count.assign(np.array([used.sum()], np.int32))
        for array, values in (
            (self.arrays.offsets, begins[used, 0]),
            (self.arrays.sections, begins[used].ravel()),
        ):
            filled = np.full(len(array), end)
            filled[: len(values)] = values
            array.assign(filled.astype(np.int32))

    def set_regularization(self, values):
        """Take a of all constraints.  [C]

        a is 0 only where no vertex can move and the compliance is 0; 1 avoids 0/0 there.
        """
        self.put(self.arrays.regularization, np.where(values > 0.0, values, 1.0))

    def put(self, array, values, unused=1):
        """Fill an array with values of all constraints [C]; 1 elsewhere avoids divisions by 0."""
        filled = np.full(array.shape, unused, wp.dtype_to_numpy(array.dtype))
        filled[self._places] = values[self.in_use]
        array.assign(filled)
