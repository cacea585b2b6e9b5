"""The shape to which a body returns: the mesh's own, or one that was taken from a pose.

Springs and volumes have the rest values of that shape.  If the material yields, edges keep some of
their strain: beyond the yield strain y, an edge's rest length L follows its length l,

    L ← l / (1 + y) if l > (1 + y) L,   L ← l / (1 − y) if l < (1 − y) L,

within FLOW_LIMIT of its length in the rest shape.  This is done once a frame.  Rest volumes do not
change, so the flow keeps the volume.

Lengths in m.  Shapes: V vertices, E edges, C edges in use.
"""

import math

import numpy as np
import warp as wp

from ..geometry import signed_volumes
from .arrays import ConstraintArrays, ConstraintList

FLOW_LIMIT = 2.0  # times longer or shorter
SMALLEST_REST = 0.1  # of a constraint's rest value in the mesh's own shape

wp.set_module_options({"enable_backward": False})


@wp.kernel(grid_stride=False)
def flow_kernel(
    vertices: wp.array(dtype=wp.vec3),  # [V]
    edges: ConstraintArrays,  # rest_values in, out
    first_rest_lengths: wp.array(dtype=float),  # [C]
    yield_strain: float,
):
    k = wp.tid()
    if edges.vertices[k, 0] >= vertices.shape[0]:
        return  # not used
    u = vertices[edges.vertices[k, 0]] - vertices[edges.vertices[k, 1]]
    length, rest = wp.length(u), edges.rest_values[k]
    strain = length / rest - 1.0
    if wp.abs(strain) > yield_strain and wp.isfinite(length):
        kept = length / (1.0 + wp.clamp(strain, -yield_strain, yield_strain))
        first = first_rest_lengths[k]
        limit = float(wp.static(FLOW_LIMIT))
        edges.rest_values[k] = wp.clamp(kept, first / limit, first * limit)


class RestShape:
    """The rest shape of one body, and the rest values on the device that follow from it.

    Attributes:
        vertices: [V, 3] float64

    Args:
        edges, volumes: The lists of all constraints.
        positions: Of the body, on the device.  [V] vec3
    """

    def __init__(self, vertices, edges: ConstraintList, volumes: ConstraintList, positions):
        self.vertices = vertices
        self._edges, self._volumes, self._positions = edges, volumes, positions
        self._flow = None

    def take(self, vertices):
        """Return to these positions [V, 3] from now on.

        Edges and tets that have collapsed in them keep a tenth of their own lengths and volumes.
        """
        self.vertices = vertices.astype(np.float32).astype(np.float64)
        self.restore()

    def restore(self):
        """Forget what yielded."""
        tets = self._volumes.constraints.vertices
        self._set(self._edges, self._lengths())
        self._set(self._volumes, 6.0 * signed_volumes(self.vertices, tets))

    def _set(self, constraints, values):
        own = constraints.constraints.rest_values
        constraints.set_rest_values(np.maximum(values, SMALLEST_REST * own))

    def _lengths(self):
        first, second = self.vertices[self._edges.constraints.vertices].swapaxes(0, 1)
        return np.linalg.norm(first - second, axis=1)

    @property
    def yields(self) -> bool:
        """Whether edges yield, so that the body may come to rest in another shape."""
        return self._flow is not None

    def prepare(self, yield_strain: float):
        """Let the edges in use yield beyond this strain; infinite: they don't."""
        self._flow = None
        if math.isinf(yield_strain):
            return
        lengths = wp.empty_like(self._edges.arrays.rest_values)
        self._edges.put(lengths, self._lengths())
        self._flow = wp.launch(
            flow_kernel,
            len(lengths),
            [self._positions, self._edges.arrays, lengths, yield_strain],
            device=self._positions.device,
            record_cmd=True,
        )

    def flow(self):
        """A frame is over: let edges yield, if they do."""
        if self._flow is not None:
            self._flow.launch()
