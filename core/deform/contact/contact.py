"""Contact on the host: build the tables that never change, and find the contacts of each frame.

Shapes: V vertices, T tets, G clusters, P parts of the mesh.
"""

import numpy as np
import warp as wp

from ...base.recorded import Recorded
from ...geometry import components, edges
from ..arrays import VertexArrays, contact_arrays
from ..xpbd_options import DEFAULT_INTEGRATOR, FIRST_INTEGRATOR
from . import boxes, detection, listing
from .boxes import ASLEEP, AWAKE, OUT, ContactShape
from .clusters import make_clusters
from .detection import EACH_FACE, MOST, NO_FACE, ONE_WAY
from .surface import exits, make_surface

# In mean edges at rest:
MARGIN = 0.25  # a point that comes nearer than this to a face within a frame is a contact
TOLERANCE = 0.1  # a point less deep than this behind a face is in front of it
REST_GAP = 1.0  # a component's clusters that are nearer to each other at rest don't collide
SOFT_DEPTH, FIRST_SOFT_DEPTH = 0.01, 0.1  # a point that is less deep leaves a body more slowly
SPEED = 5.0  # per second: a point leaves a body that it is in

GUESS = 1.5  # times the last motion that is known: what a vertex may move in a frame
SURPRISE = 0.1  # margins that it may move besides
STEP = 1.0 / 64.0  # margins, the unit of distances between boxes

NOTHING = np.empty(0, np.int64)


class Contact:
    """Finds where a mesh touches itself.

    Attributes:
        arrays: ContactArrays with the contacts of this frame; None before the first search.
        first: Whether bodies collide as with the first integrator.
    """

    def __init__(self, rest_vertices, tets, state: VertexArrays, frame=None):
        """Take a mesh at rest; the first search prepares what searches need.

        Args:
            rest_vertices: [V, 3]
            tets: Positively oriented, none of them flat.  [T, 4]
            frame: A CpuFrame or CudaFrame, which takes `arrays` when they are made.
        """
        self._mesh, self._state, self._frame = (rest_vertices, tets), state, frame
        self._device = state.vertices.device
        self.arrays = None
        self._dt = None  # of the frame that is watched
        self._moods_of = None  # the parts that are awake and those that are out, as on the device
        self._watched = self._arriving = self._touching = self._listed = False
        # How far the nearest boxes were apart, how far vertices may have gone since, and went in
        # the last frame that is known [m].
        self._clearance = self._travel = self._motion = 0.0
        self.first = DEFAULT_INTEGRATOR == FIRST_INTEGRATOR
        self._entered = False  # whether samples may have faces by which they leave bodies
        self._launches = {}
        self._listing = None

    def take(self, integrator: str):
        """With the first integrator bodies lie deeper in each other, and each face counts."""
        first = integrator == FIRST_INTEGRATOR
        if first != self.first:
            self.first = first
            self.arrays = self._dt = self._moods_of = None  # so the next search builds
            self.look_again()

    def quiet(self, dt: float) -> bool:
        """Whether nothing can touch in the next dt seconds, as far as is known already."""
        known = self._watched and not self._arriving and dt == self._dt
        if known and not self._near(1):
            self._listed = False
            return True
        return False

    def find(self, dt: float, awake, out):
        """List the contacts of the next dt seconds.

        Args:
            awake, out: Which components are worked on, and which are left out.  2 × [P] bool

        Returns:
            The components that touch something.  [N]
        """
        if self.arrays is None:
            self._build()
        self._set_moods(awake, out)
        if not self._arriving and self._near(1):
            self._watched = False
        if not self._watched or dt != self._dt:
            self.watch(dt)
        if self._arriving:
            self._read()
        self._listed = self._touching
        if not self._touching:
            return NOTHING
        self._entered = True
        self._listing(self._list)
        return np.unique(self._parts[self._overlapped > 0])

    def found(self) -> bool:
        """Whether the last frame had contacts; waits for the device."""
        return self._listed and bool(self.arrays.counts.numpy()[0] > 0)

    def moved(self, motion: float):
        """Take the farthest move of a vertex in a frame that ended [m]."""
        self._motion = motion
        self._travel += motion

    def watch(self, dt: float):
        """Look for clusters that touch in the next dt seconds, for the next `find`.

        Not before vertices may have met whose boxes were apart: how far they went in the frame
        that ends now, and will go in the next one, is guessed from the frame before.
        """
        if dt != self._dt:
            self._dt = dt
            self._launches.clear()  # they were recorded with the dt before
            self._listing = Recorded(self._device)
            self._watched = False
        if self._watched and not self._near(2):
            return
        shape, state, count = self._shape, self._state, len(self._parts)
        lanes = boxes.lane_count(self._device)
        inputs = shape, state, dt, self._margin, lanes, self._boxes
        self._launch(boxes.box_kernel, count * lanes, *inputs)
        step = STEP * self._margin
        inputs = shape, self._moods, self._boxes, lanes, step, self._touched, self._overlaps
        self._launch(boxes.touch_kernel, count * lanes, *inputs)
        if self._copied is not None:
            wp.copy(self._copy, self._touched)
            self._device.stream.record_event(self._copied)
        self._watched = self._arriving = True

    def _near(self, frames):
        """Whether vertices may have met, so many frames after those whose motion is known."""
        ahead = GUESS * self._motion + SURPRISE * self._margin
        return self._clearance <= 2.0 * (self._travel + frames * ahead)

    def _read(self):
        """Take the results of `watch`."""
        if self._copied is not None:
            wp.synchronize_event(self._copied)
        self._arriving = False
        count = len(self._parts)
        self._overlapped, steps = self._on_host[:count], self._on_host[count:]
        self._touching = bool(self._overlapped.any())
        self._clearance = float(steps.min()) * STEP * self._margin
        self._travel = 0.0

    def look_again(self):
        """Something has changed: what `watch` has seen is void."""
        self._watched = self._listed = False

    def forget(self):
        """Vertices were moved by hand: also forget the faces by which samples leave bodies."""
        self.look_again()
        if self._entered:
            self._exits.fill_(NO_FACE)
            self._entered = False

    def _build(self):
        (rest_vertices, tets), device = self._mesh, self._device
        ends = rest_vertices[edges(tets)]
        edge = float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean())
        self._margin, self._tolerance = MARGIN * edge, TOLERANCE * edge
        clusters = make_clusters(rest_vertices, tets, REST_GAP * edge)
        surface = make_surface(rest_vertices, tets, clusters)
        self._shape = _on_device(rest_vertices, clusters, surface, device)
        part_of = components(len(rest_vertices), tets)
        self._parts = part_of[clusters.vertices[clusters.vertex_offsets[:-1]]]  # [G]
        count, samples = len(self._parts), len(surface.ends)
        leaves = len(clusters.tet_offsets) - 1
        self._boxes = wp.zeros((6, count), dtype=float, device=device)
        self._small_boxes = [
            wp.zeros((small, 2), dtype=wp.vec3, device=device)
            for small in (leaves, len(surface.faces), len(tets))
        ]
        integers = {"dtype": int, "device": device}
        self._moods = wp.zeros(count, **integers)
        self._overlaps = wp.zeros((count, count), **integers)
        self._touched = wp.zeros(2 * count, **integers)
        self._copy, self._copied = self._touched, None
        if device.is_cuda:
            self._copy = wp.zeros_like(self._touched, device="cpu", pinned=True)
            self._copied = wp.Event(device)
        self._on_host = self._copy.numpy()
        self._exits = wp.full(samples, NO_FACE, **integers)
        self._found = wp.zeros(samples, dtype=wp.vec4i, device=device)
        self._counts, self._ends = (wp.zeros(samples, **integers) for _ in range(2))
        self.arrays = contact_arrays(len(rest_vertices), MOST * samples, device)
        self._entries = self.arrays.entries
        if device.is_cuda:  # threads enter them in any order
            self._entries = wp.zeros_like(self.arrays.entries)
        soft_depth = FIRST_SOFT_DEPTH if self.first else SOFT_DEPTH
        self.arrays.limits.assign(np.array([soft_depth, SPEED], np.float32) * edge)
        if self._frame is not None:
            self._frame.set_contacts(self.arrays)

    def _set_moods(self, awake, out):
        moods_of = awake.tobytes(), out.tobytes()
        if moods_of == self._moods_of:
            return
        self._moods_of = moods_of
        moods = np.where(out, OUT, np.where(awake, AWAKE, ASLEEP))
        self._moods.assign(moods[self._parts].astype(np.int32))
        self._watched = False

    def _list(self):
        shape, state, contacts, counts = self._shape, self._state, self.arrays, self._counts
        inputs = shape, state, self._touched, self._dt, self._margin, *self._small_boxes
        self._launch(boxes.small_box_kernel, len(self._small_boxes[0]), *inputs)
        where = *self._small_boxes, self._touched, self._overlaps
        lanes = detection.lane_count(self._device)
        alike = EACH_FACE if self.first else ONE_WAY
        limits = self._dt, self._margin, self._tolerance, alike, lanes
        inputs = shape, state, *where, *limits, self._exits, self._found, counts, contacts.counts
        self._launch(detection.find_kernel, len(counts) * lanes, *inputs)
        wp.utils.array_scan(counts, self._ends, inclusive=True)
        contacts.offsets.zero_()
        inputs = shape, state, self._found, counts, self._ends, contacts
        self._launch(listing.list_kernel, len(counts), *inputs)
        wp.utils.array_scan(contacts.offsets, contacts.offsets, inclusive=True)
        self._launch(listing.enter_kernel, MOST * len(counts), contacts, self._entries)
        if self._device.is_cuda:
            self._launch(listing.sort_kernel, 5 * MOST * len(counts), self._entries, contacts)

    def _launch(self, kernel, dim, *inputs):
        """Launch a kernel; its inputs other than dt are always the same."""
        if kernel not in self._launches:
            self._launches[kernel] = wp.launch(
                kernel, dim, list(inputs), device=self._device, record_cmd=True
            )
        self._launches[kernel].launch()


def _on_device(rest_vertices, clusters, surface, device) -> ContactShape:
    values = clusters._asdict() | surface._asdict()
    leaf_counts = np.diff(clusters.leaf_offsets)
    values |= {
        "rest": rest_vertices,
        "exits": exits(rest_vertices, surface),
        "leaf_clusters": np.repeat(np.arange(len(leaf_counts)), leaf_counts),
    }
    shape = ContactShape()
    for name, variable in ContactShape.vars.items():
        setattr(shape, name, wp.array(values[name], dtype=variable.type.dtype, device=device))
    return shape


def contact_modules() -> list[str]:
    """Names of the Warp modules whose kernels contact launches."""
    return [boxes.__name__, detection.__name__, listing.__name__]
