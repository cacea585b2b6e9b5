"""A frame as a sequence of launches: recorded on the CPU, captured as a graph on CUDA.

On CUDA there is one launch per color.  On the CPU a launch runs serially, so one launch
per constraint type, sorted by color, is the same Gauss–Seidel sweep.
"""

import warp as wp

from . import constraints, integration
from .arrays import ConstraintList, VertexArrays


class Launches:
    """Runs frames of one solver."""

    def __init__(
        self,
        state: VertexArrays,
        edges: ConstraintList,
        volumes: ConstraintList,
        timing: wp.array,
        motion: wp.array,
    ):
        """Take the arrays to work on: timing as in Timing, motion as in end_frame_kernel."""
        self._state, self._edges, self._volumes = state, edges, volumes
        self._timing, self._motion = timing, motion
        self._device = timing.device
        self._schedules = {}

    def forget(self):
        """Constraints have come into use or gone out of it: their numbers are in launches."""
        self._schedules.clear()

    def run(self, substep_count: int, volumes: bool, springs: bool, ground: bool) -> None:
        """One frame; what isn't needed isn't launched."""
        key = substep_count, volumes, springs, ground
        if key not in self._schedules:
            launches = self._record(*key)
            if self._device.is_cuda:
                with wp.ScopedCapture(device=self._device) as capture:
                    for launch in launches:
                        launch.launch()
                launches = capture.graph
            self._schedules[key] = launches
        if self._device.is_cuda:
            wp.capture_launch(self._schedules[key])
        else:
            for launch in self._schedules[key]:
                launch.launch()

    def _record(self, substep_count, volumes, springs, ground):
        state, timing = self._state, self._timing
        x, d, previous, v, w, anchors, targets, spring_values = state
        count = len(x)

        def record(kernel, dim, *inputs):
            return wp.launch(kernel, dim, inputs, device=self._device, record_cmd=True)

        def by_color(kernel, constraint_list):
            offsets = constraint_list.offsets
            colors = offsets if self._device.is_cuda else offsets[[0, -1]]
            inputs = d, w, *constraint_list.arrays[:4]
            return [
                record(kernel, last - first, *inputs, first)
                for first, last in zip(colors[:-1].tolist(), colors[1:].tolist(), strict=True)
                if last > first
            ]

        edges = self._edges
        launches = []
        if len(edges.in_use):  # CUDA refuses to launch no threads
            dim = len(edges.in_use)
            launches.append(record(constraints.edge_spans_kernel, dim, x, *edges.arrays[:2]))
        project = by_color(constraints.project_edges_kernel, edges)
        if volumes and len(self._volumes.in_use):
            dim = (len(self._volumes.in_use), 3)
            inputs = x, *self._volumes.arrays[:2]
            launches.append(record(constraints.tet_spans_kernel, dim, *inputs))
            project += by_color(constraints.project_volumes_kernel, self._volumes)
        for substep in range(substep_count):
            fraction = (substep + 1) / substep_count
            inputs = x, d, v, w, targets, timing, fraction, previous
            launches += [record(integration.predict_kernel, count, *inputs), *project]
            if springs:
                inputs = x, d, w, anchors, targets, spring_values, fraction
                launches.append(record(integration.pull_springs_kernel, count, *inputs))
            if ground:
                inputs = x, d, previous, w, timing
                launches.append(record(integration.push_from_ground_kernel, count, *inputs))
            inputs = d, previous, timing, v
            launches.append(record(integration.update_velocities_kernel, count, *inputs))
        inputs = x, d, w, targets, anchors, self._motion
        launches.append(record(integration.end_frame_kernel, count, *inputs))
        return launches
