"""Tangles of a mesh: inverted tets, and edges that tets wrap more than once.

In any pose of a real body, the dihedral angles of the tets around an edge add up to at most 2π.
A collapsed body can open again with every volume positive and a sum of 4π around a
few edges, like the sheets of a Riemann surface around a branch point.  The energy has a
minimum there, so projections do not lead out of it.  Volumes and sums together detect every
tangle (Lipman, "Bijective Mappings of Meshes with Boundary and the Degree in Mesh
Processing", 2014).

    θ = Σ over tets around an edge of atan2(|(e × a) × (e × b)|, (e × a)·(e × b))

Here e is the vector along the edge, a and b those from its first end to the tet's two other
corners.

A body can also hang upside down at its pins, like an umbrella that the wind has turned inside out,
and balance there for many seconds.  Some of its edges are then longer than STRETCH times their rest
lengths.  That is a tangle only if neither weight nor pins can explain it, so the caller
says whether such edges count.

Shapes: V vertices, T tets, E edges of tets, F = 6 T pairs of an edge and a tet, P parts
(connected components of the mesh).
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from ..geometry import EDGES, signed_volumes
from .constraints import UNLIMITED

wp.set_module_options({"enable_backward": False})

OTHERS = np.array([[2, 3], [1, 3], [1, 2], [0, 3], [0, 2], [0, 1]])  # corners not in EDGES
SLACK = 0.2 * np.pi  # beyond 2π: a notch may close a little too far
STRETCH = 2.0
SQUEEZED = 0.5  # of its volume: a tet with less counts as squeezed


class Fans(NamedTuple):
    """The tets around each edge."""

    ends: np.ndarray  # [E, 2] int32
    offsets: np.ndarray  # [E + 1] int32; edge e has the pairs offsets[e]:offsets[e + 1]
    others: np.ndarray  # [F, 2] int32, the corners of these tets that aren't ends
    limits: np.ndarray  # [E] the largest θ that is no tangle
    lengths: np.ndarray  # [E] at rest


def fans(rest_vertices, tets) -> Fans:
    """The fans of a mesh whose tets [T, 4] all have a volume."""
    pairs = np.sort(tets[:, EDGES].reshape(-1, 2), axis=1).astype(np.int64)
    keys = pairs[:, 0] * len(rest_vertices) + pairs[:, 1]
    order = np.argsort(keys, kind="stable")
    begins = np.flatnonzero(np.diff(keys[order], prepend=-1))
    offsets = np.append(begins, len(order))
    ends = pairs[order[begins]]
    others = tets[:, OTHERS].reshape(-1, 2)[order]
    at_rest = angle_sums(rest_vertices, ends, offsets, others)
    limits = np.maximum(2.0 * np.pi, at_rest) + SLACK  # an edge may be wrapped at rest
    lengths = np.linalg.norm(rest_vertices[ends[:, 0]] - rest_vertices[ends[:, 1]], axis=1)
    return Fans(*(a.astype(np.int32) for a in (ends, offsets, others)), limits, lengths)


def angle_sums(vertices, ends, offsets, others):
    """θ of each edge.  [E]"""
    first, second = np.repeat(ends, np.diff(offsets), axis=0).T
    along = vertices[second] - vertices[first]
    a, b = (np.cross(along, vertices[others[:, i]] - vertices[first]) for i in (0, 1))
    angles = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
    return np.add.reduceat(angles, offsets[:-1])


@wp.kernel(grid_stride=False)
def count_inverted_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V]
    tets: wp.array(dtype=wp.vec4i),  # [T]
    rest_volumes: wp.array(dtype=float),  # [T] 6 V0
    parts: wp.array(dtype=int),  # [V]
    counts: wp.array2d(dtype=int),  # [4, P] in and out
):
    corners = tets[wp.tid()]
    origin = vertices[corners[0]]
    e1 = vertices[corners[1]] - origin
    e2 = vertices[corners[2]] - origin
    e3 = vertices[corners[3]] - origin
    volume = wp.dot(wp.cross(e1, e2), e3)
    if not volume > SQUEEZED * rest_volumes[wp.tid()]:
        wp.atomic_add(counts, 3, parts[corners[0]], 1)
    if not volume > 0.0:  # NaN counts as inverted
        wp.atomic_add(counts, 0, parts[corners[0]], 1)
    if not wp.isfinite(volume):
        wp.atomic_add(counts, 2, parts[corners[0]], 1)


@wp.kernel(grid_stride=False)
def count_wrapped_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V]
    ends: wp.array(dtype=wp.vec2i),  # [E]
    offsets: wp.array(dtype=int),  # [E + 1]
    others: wp.array(dtype=wp.vec2i),  # [F]
    limits: wp.array(dtype=float),  # [E]
    lengths: wp.array(dtype=float),  # [E]
    stretch: float,  # longer edges, in rest lengths, count too
    parts: wp.array(dtype=int),  # [V]
    counts: wp.array2d(dtype=int),  # [4, P] in and out
):
    edge = wp.tid()
    first = ends[edge][0]
    origin = vertices[first]
    along = vertices[ends[edge][1]] - origin
    total = float(0.0)
    for k in range(offsets[edge], offsets[edge + 1]):
        a = wp.cross(along, vertices[others[k][0]] - origin)
        b = wp.cross(along, vertices[others[k][1]] - origin)
        total += wp.atan2(wp.length(wp.cross(a, b)), wp.dot(a, b))
    if total > limits[edge] or wp.length(along) > stretch * lengths[edge]:
        wp.atomic_add(counts, 1, parts[first], 1)


class Feedback:
    """Results of a frame on their way to the host: the vertices' motion, and counts of tangles.

    The host reads them when the next frame begins.  On CUDA the frame has ended by then, so the
    host doesn't wait for the device.
    """

    def __init__(self, rest_vertices, tets, parts, motion):
        """Take a mesh, and the array that frames write their motion to (FrameArrays).

        Args:
            tets: Those that have a volume.  [T, 4]
            parts: The part of each vertex.  [V]
        """
        self._device = device = motion.device
        self._mesh = rest_vertices, tets
        self._tets = wp.array(tets, dtype=wp.vec4i, device=device)
        rest_volumes = 6.0 * signed_volumes(rest_vertices, tets)
        self._rest_volumes = wp.array(rest_volumes, dtype=float, device=device)
        self._parts = wp.array(parts, dtype=int, device=device)
        self._fans = None  # the first count builds them
        self._counts = wp.zeros((4, int(parts.max()) + 1), dtype=int, device=device)
        self._sources = self._copies = [motion, self._counts]
        if device.is_cuda:
            self._copies = [wp.zeros_like(a, device="cpu", pinned=True) for a in self._sources]
        self._on_host = [copy.numpy() for copy in self._copies]
        self._expected = 0  # how many of them are on their way
        self._only_inverted = False
        self._copied = wp.Event(device) if device.is_cuda else None

    def end(self, vertices, count: bool, overlong: bool = False, inverted: bool = False):
        """A frame ends in this state.

        Args:
            vertices: [V] vec3 on the device
            count: Whether to count tangles in it.
            overlong: Whether overlong edges count as wrapped.
            inverted: Whether to count inverted and squeezed tets, if not all tangles.
        """
        self._only_inverted = inverted and not count
        if count or inverted:
            self._counts.zero_()
            inputs = [vertices, self._tets, self._rest_volumes, self._parts, self._counts]
            wp.launch(count_inverted_kernel, len(self._tets), inputs, device=self._device)
        if count:
            self._count_wrapped(vertices, STRETCH if overlong else UNLIMITED)
        self._expected = 2 if count or inverted else 1
        if self._copied is not None:
            for k in range(self._expected):
                wp.copy(self._copies[k], self._sources[k])
            self._device.stream.record_event(self._copied)

    def read(self):
        """Motion [m]; inverted and squeezed tets [2, P]; tangles [3, P]; None for what isn't new.

        Tangles are inverted tets, wrapped edges, and tets that aren't finite.
        """
        if self._expected and self._copied is not None:
            wp.synchronize_event(self._copied)
        expected, self._expected = self._expected, 0
        motion, counts = self._on_host
        motion = float(motion.max()) if expected > 0 else None
        counts = counts.copy() if expected > 1 else None
        if counts is None:
            return motion, None, None
        return motion, counts[::3], None if self._only_inverted else counts[:3]

    def drop(self):
        """Forget copies that are on their way: the state that they are about has changed."""
        self._expected = 0

    def _count_wrapped(self, vertices, stretch):
        if self._fans is None:
            dtypes = Fans(wp.vec2i, int, wp.vec2i, float, float)
            pairs = zip(fans(*self._mesh), dtypes, strict=True)
            self._fans = Fans(
                *(wp.array(array, dtype=dtype, device=self._device) for array, dtype in pairs)
            )
        inputs = [vertices, *self._fans, stretch, self._parts, self._counts]
        wp.launch(count_wrapped_kernel, len(self._fans.ends), inputs, device=self._device)
