"""The solver: n substeps a frame, each projecting every constraint once.

One frame of length dt is n substeps of length h = dt/n (Macklin et al., "Small Steps in
Physics Simulation", 2019): move (integration.py), project edges, then volumes, color by
color (constraints.py), take velocities from the way gone.

Changing handles, pins, targets, dt or stiffness changes the contents of arrays, never
the sequence of launches; on CUDA the sequence is a captured graph, one launch per color.
On the CPU a launch runs serially, so one launch per constraint type, sorted by color, is
the same Gauss–Seidel sweep.

Units: SI; model space is one metre wide.  Shapes: V vertices, K handles.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import warp as wp

from . import constraints, integration
from .material import Material


@dataclass(frozen=True)
class XpbdOptions:
    """How time is stepped; fixed for the life of a solver.

    Attributes:
        substep_count: n; the stiffness that can be held grows with n².
        gravity: g [m/s²].
        speed_limit: v_max in object sizes per second; without it a release after an
            extreme drag throws vertices through each other.
        sleep_motion: In object sizes; a frame that moves no vertex farther is still.
        sleep_frames: The solver sleeps after as many still frames.
    """

    substep_count: int = 20
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    speed_limit: float = 20.0
    sleep_motion: float = 1e-5
    sleep_frames: int = 30
    rescue: bool = True

    def __post_init__(self):
        if self.substep_count < 1:
            raise ValueError(f"{self.substep_count} substeps a frame; give 1 or more")


class ConstraintArrays(NamedTuple):
    """On the device, in the order in which the kernels take them."""

    vertices: wp.array
    spans: wp.array
    rest_values: wp.array
    regularization: wp.array


class XpbdSolver:
    """Positions of one mesh over time.

    Pinned vertices stay where they are, grabbed ones go where move() says, and both have
    no inverse mass; a vertex that is pinned and grabbed stays pinned.

    Attributes:
        vertices: Current positions, the same array for ever.  [V] vec3 on the device
        velocities: [V] vec3 on the device
        pinned: [V] bool
        object_size: The longest side of the rest pose's bounding box [m].
    """

    def __init__(
        self,
        rest_vertices,
        tets,
        material: Material,
        pinned,
        options: XpbdOptions | None = None,
        device="cpu",
    ):
        self.options = options or XpbdOptions()
        self.device = wp.get_device(device)
        # Rounded as on the device, so that lengths at rest are exact.
        self.rest_vertices = np.array(rest_vertices, np.float32).astype(np.float64)
        self.tets = np.asarray(tets)
        self.pinned = np.array(pinned, bool)
        vertex_count = len(self.rest_vertices)
        if self.pinned.shape != (vertex_count,):
            raise ValueError(
                f"the pin mask has shape {self.pinned.shape}; the mesh has {vertex_count} vertices"
            )
        self.object_size = float(np.ptp(self.rest_vertices, axis=0).max())
        self.edges = constraints.edge_constraints(self.rest_vertices, self.tets)
        self.volumes = constraints.volume_constraints(self.rest_vertices, self.tets)
        self._dt = 1.0 / 60.0
        self._handles = np.empty(0, np.int64)

        self._allocate(vertex_count)
        self._schedules = {}  # one sequence of launches with volumes, one without
        self.set_material(material)
        self.reset()

    def _allocate(self, vertex_count):
        for name in ("vertices", "velocities", "_deltas", "_previous", "_targets"):
            setattr(self, name, wp.zeros(vertex_count, dtype=wp.vec3, device=self.device))
        self._inverse_masses = self._zeros(vertex_count)
        self._timing = self._zeros(3)
        self._motion = self._zeros(1)
        self._motion_on_host = wp.zeros(1, device="cpu", pinned=self.device.is_cuda)
        self._motion_copied = wp.Event(self.device) if self.device.is_cuda else None
        edges, tets = self.edges, self.volumes
        self._edge_arrays = ConstraintArrays(
            self._upload(edges.vertices, wp.vec2i),
            self._zeros(len(edges.vertices), wp.vec3),
            self._upload(edges.rest_lengths, float),
            self._zeros(len(edges.vertices)),
        )
        self._tet_arrays = ConstraintArrays(
            self._upload(tets.vertices, wp.vec4i),
            self._zeros(3 * len(tets.vertices), wp.vec3),
            self._upload(tets.rest_volumes, float),
            self._zeros(len(tets.vertices)),
        )

    def _zeros(self, shape, dtype=float):
        return wp.zeros(shape, dtype=dtype, device=self.device)

    def _upload(self, array, dtype):
        if np.issubdtype(array.dtype, np.floating):
            array = array.astype(np.float32)
        return wp.array(np.ascontiguousarray(array), dtype=dtype, device=self.device)

    # -- material, pins, handles -------------------------------------------------------

    def set_material(self, material: Material):
        """Take another material; positions and velocities stay."""
        self.material = material
        self._compliances = (
            self.edges.compliances(material.shear_modulus),
            self.volumes.compliances(material.bulk_modulus) if material.bulk_modulus > 0 else None,
        )
        masses = constraints.lumped_masses(self.rest_vertices, self.tets, material.density)
        # A vertex without a tet has no mass; it stays where it is.
        self._free_inverse_masses = np.divide(1.0, masses, where=masses > 0, out=0.0 * masses)
        self._update_inverse_masses()

    def set_compliances(self, edges, volumes):
        """α of edges [m/N] and volumes [m⁵/N], None for no volumes, in place of the material's."""
        edges = np.broadcast_to(np.asarray(edges, np.float64), len(self.edges.vertices))
        if volumes is not None:
            volumes = np.broadcast_to(np.asarray(volumes, np.float64), len(self.volumes.vertices))
        self._compliances = edges, volumes
        self._update_coefficients()
        self._wake()

    def set_pinned(self, mask):
        """Pin these vertices where they are now, and free all others.  [V] bool"""
        mask = np.array(mask, bool)
        if mask.shape != self.pinned.shape:
            raise ValueError(
                f"the pin mask has shape {mask.shape}; the mesh has {len(self.pinned)} vertices"
            )
        held_anew = mask & ~self.pinned
        self.pinned = mask
        self._hold(held_anew)

    def grab(self, ids):
        """Make these vertices handles, in place of those grabbed before.  [K] int"""
        ids = np.asarray(ids, np.int64).reshape(-1)
        if len(ids) and not (0 <= ids.min() and ids.max() < len(self.pinned)):
            raise ValueError(
                f"handles {ids.min()} to {ids.max()}; the mesh has {len(self.pinned)} vertices"
            )
        self._handles = ids
        held_anew = np.zeros(len(self.pinned), bool)
        held_anew[ids] = True
        self._hold(held_anew & ~self.pinned)

    def move(self, targets):
        """Where the handles, in grab()'s order, shall be after the next step.  [K, 3]"""
        targets = np.asarray(targets, np.float32).reshape(-1, 3)
        if len(targets) != len(self._handles):
            raise ValueError(f"{len(targets)} targets for {len(self._handles)} handles")
        free = ~self.pinned[self._handles]
        if free.any():
            wp.launch(
                integration.move_kernel,
                dim=int(free.sum()),
                inputs=[
                    self._upload(self._handles[free].astype(np.int32), int),
                    self._upload(targets[free], wp.vec3),
                    self._targets,
                ],
                device=self.device,
            )

    def release(self):
        """Let all handles go; they keep their velocity and get their mass back."""
        self.grab([])

    def _hold(self, held_anew):
        wp.launch(
            integration.hold_kernel,
            dim=len(held_anew),
            inputs=[
                self.vertices,
                wp.array(held_anew, dtype=bool, device=self.device),
                self._targets,
            ],
            device=self.device,
        )
        self._update_inverse_masses()

    def _update_inverse_masses(self):
        kinematic = self.pinned.copy()
        kinematic[self._handles] = True
        self._host_inverse_masses = np.where(kinematic, 0.0, self._free_inverse_masses)
        self._inverse_masses.assign(self._host_inverse_masses)
        self._update_coefficients()
        self._wake()

    # -- state -------------------------------------------------------------------------

    def reset(self):
        """Rest pose, zero velocity.  Handles stay grabbed, at their rest positions."""
        self.set_state(self.rest_vertices)
        # Without gravity the rest pose is an equilibrium.
        if not any(self.options.gravity):
            self._still_frames = self.options.sleep_frames

    def set_state(self, vertices, velocities=None):
        """Start from these positions and velocities (zero if left out).  [V, 3]"""
        vertices = np.asarray(vertices, np.float32)
        self.vertices.assign(vertices)
        self._targets.assign(vertices)
        self._deltas.zero_()
        if velocities is None:
            self.velocities.zero_()
        else:
            self.velocities.assign(np.asarray(velocities, np.float32))
        self._wake()

    @property
    def settled(self) -> bool:
        """True while the solver sleeps: nothing is grabbed and nothing moves."""
        return len(self._handles) == 0 and self._still_frames >= self.options.sleep_frames

    def stiffness_ratio(self) -> float:
        """The median of r = α/(w h²) over edges that can move.

        Below 1 the substeps, not Young's modulus, decide how stiff the object is; below
        0.1 the compliance floor softens it.
        """
        w = self._free_inverse_masses[self.edges.vertices].sum(axis=1)
        h = self._dt / self.options.substep_count
        alpha = self.edges.compliances(self.material.shear_modulus)
        return float(np.median(alpha[w > 0] / (w[w > 0] * h * h)))

    # -- time --------------------------------------------------------------------------

    def step(self, dt):
        """Advance by one frame of dt seconds."""
        if not (math.isfinite(dt) and dt > 0.0):
            raise ValueError(f"a time step of {dt} s; give a positive number")
        if dt != self._dt:
            self._dt = dt
            self._update_coefficients()
        self._count_still_frames()
        if self.settled:
            return
        self._motion.zero_()
        schedule = self._schedule(volumes=self._compliances[1] is not None)
        if self.device.is_cuda:
            wp.capture_launch(schedule)
            wp.copy(self._motion_on_host, self._motion)
            self.device.stream.record_event(self._motion_copied)
        else:
            for launch in schedule:
                launch.launch()
            wp.copy(self._motion_on_host, self._motion)
        self._motion_pending = True

    def _wake(self):
        self._still_frames = 0
        self._motion_pending = False

    def _count_still_frames(self):
        # The frame before is judged now: on CUDA it is over, so that nothing waits.
        if not self._motion_pending:
            return
        self._motion_pending = False
        if self._motion_copied is not None:
            wp.synchronize_event(self._motion_copied)
        motion = float(self._motion_on_host.numpy()[0])
        still = motion <= self.options.sleep_motion * self.object_size
        self._still_frames = self._still_frames + 1 if still else 0

    def _update_coefficients(self):
        """What follows from dt, material and kinematic vertices, in float64 on the host."""
        material, w = self.material, self._host_inverse_masses
        h = self._dt / self.options.substep_count
        self._timing.assign(
            [h, math.exp(-material.damping * h), self.options.speed_limit * self.object_size]
        )
        edges, volumes = self._compliances
        self._edge_arrays.regularization.assign(self.edges.regularization(edges, w, h))
        if volumes is not None:
            self._tet_arrays.regularization.assign(self.volumes.regularization(volumes, w, h))

    def _schedule(self, volumes):
        """One frame: a captured graph on CUDA, a list of recorded launches on the CPU."""
        if volumes not in self._schedules:
            launches = self._record(volumes)
            if self.device.is_cuda:
                with wp.ScopedCapture(device=self.device) as capture:
                    for launch in launches:
                        launch.launch()
                launches = capture.graph
            self._schedules[volumes] = launches
        return self._schedules[volumes]

    def _record(self, volumes):
        def record(kernel, dim, *inputs):
            return wp.launch(kernel, dim, inputs, device=self.device, record_cmd=True)

        def by_color(kernel, offsets, *inputs):
            colors = offsets if self.device.is_cuda else offsets[[0, -1]]
            spans = zip(colors[:-1].tolist(), colors[1:].tolist(), strict=True)
            return [record(kernel, last - first, *inputs, first) for first, last in spans]

        count = len(self.rest_vertices)
        x, d, v = self.vertices, self._deltas, self.velocities
        w, targets, timing = self._inverse_masses, self._targets, self._timing
        gravity = wp.vec3(*self.options.gravity)
        edges, tets = self._edge_arrays, self._tet_arrays

        begin = [record(constraints.edge_spans_kernel, len(edges.vertices), x, *edges[:2])]
        project = by_color(constraints.project_edges_kernel, self.edges.offsets, d, w, *edges)
        if volumes:
            dim = (len(tets.vertices), 3)
            begin.append(record(constraints.tet_spans_kernel, dim, x, *tets[:2]))
            project += by_color(
                constraints.project_volumes_kernel, self.volumes.offsets, d, w, *tets
            )
        finish = record(integration.update_velocities_kernel, count, d, self._previous, timing, v)
        launches = begin
        for substep in range(self.options.substep_count):
            fraction = (substep + 1) / self.options.substep_count
            inputs = [x, d, v, w, targets, timing, gravity, fraction, self._previous]
            launches += [record(integration.predict_kernel, count, *inputs), *project, finish]
        launches.append(record(integration.end_frame_kernel, count, x, d, w, targets, self._motion))
        return launches
