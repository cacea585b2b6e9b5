"""The solver: n substeps a frame, each projecting every constraint once.

One frame of length dt is n substeps of length h = dt/n (Macklin et al., "Small Steps in
Physics Simulation", 2019); core/definition/solver.py defines a substep.  This module runs on the
host, in float64: it converts the user's actions into the contents of arrays (arrays.py), and
chooses the parts of the mesh to work on.  frame/ runs frames on these arrays.

Units: SI; model space is one meter wide.  Shapes: V vertices, E edges, T tets, K handles.
A part is a connected component of the mesh.
"""

import math

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from ..base.device import start_warp
from ..geometry import components
from . import checks, constraints
from .arrays import ConstraintList, frame_arrays
from .colliders import ColliderRows
from .contact.contact import Contact, contact_modules
from .frame.cpu import CpuFrame, takes_halves
from .frame.cuda import CudaFrame, runs_in_block
from .halves import cut
from .held_stiffness import HELD_SHARE, HeldStiffness
from .holds import Holds
from .inversion import InversionGuard
from .material import Material
from .pull_test import floor_share
from .recovery import Recovery
from .rest_shape import RestShape
from .rigid_motion import FreeParts, flight
from .tangles import Feedback
from .xpbd_options import (
    FIRST_INTEGRATOR,
    INTEGRATORS,
    TIME_STEP,
    Integrator,
    XpbdOptions,
)

EVERYWHERE = slice(None)


class XpbdSolver:
    """Positions of one mesh over time.

    Pinned vertices stay where they are.  Grabbed ones follow move(), exactly or pulled by
    springs; a vertex that is pinned and grabbed stays pinned.  A part of the mesh is left out
    of the computation until something touches it.

    Attributes:
        options: See set_options.
        edges, volumes: All constraints, sorted by color.
        vertices: Current positions, always in the same array.  [V] vec3 on the device
        velocities: [V] vec3 on the device
        object_size: The longest side of the rest pose's bounding box [m].
        rescue: What is done about tangles: whether a try is `running`, or all are `given_up`.
    """

    def __init__(
        self,
        rest_vertices: ArrayLike,
        tets: ArrayLike,
        material: Material,
        pinned: ArrayLike,
        options: XpbdOptions | None = None,
        device: str = "cpu",
    ):
        """Take a mesh at rest.

        Args:
            rest_vertices: [V, 3] m
            tets: [T, 4]
            pinned: [V] bool
            device: Warp's name, "cpu" or "cuda:0".

        Raises:
            ValueError: `pinned` has another shape, all tets are flat, or a vertex has too
                many constraints for a GPU.
        """
        start_warp()
        self.options = options or XpbdOptions()
        self.device = wp.get_device(device)
        # Rounded as on the device, so that rest lengths are exact.
        self.rest_vertices = np.array(rest_vertices, np.float32).astype(np.float64)
        self.tets = np.array(tets)
        count = len(self.rest_vertices)
        pinned = checks.per_vertex(pinned, count, "a pin mask", bool)
        self.object_size = float(np.ptp(self.rest_vertices, axis=0).max())
        self.edges = constraints.edge_constraints(self.rest_vertices, self.tets)
        self.volumes = constraints.volume_constraints(self.rest_vertices, self.tets)
        on_gpu, lists = self.device.is_cuda, (self.edges, self.volumes)
        halves = cut(self.rest_vertices, *lists) if not on_gpu and takes_halves() else None
        self._part_of = components(count, self.tets)  # [V]
        self._active = np.zeros(self._part_of.max() + 1, bool)  # by part
        self._dt = TIME_STEP
        self._stiffness = np.ones(count)  # factors of Young's modulus  [V]
        self._pulled = None  # what floor_share depends on, and its value

        common = count, self.device, on_gpu and runs_in_block(count), halves
        self._lists = [ConstraintList(one, *common) for one in lists]
        arrays = frame_arrays(count, *(one.arrays for one in self._lists), self.device)
        self._state, self._timing, self._motion = arrays.state, arrays.timing, arrays.motion
        self.vertices: wp.array = arrays.state.vertices
        self.velocities: wp.array = arrays.state.velocities
        self._placed = None  # where set_state has put the vertices, if no step has passed  [V, 3]
        self._rest_shape = RestShape(self.rest_vertices, *self._lists, self.vertices)
        self._holds = Holds(pinned, arrays.state)
        self._free_parts = FreeParts(arrays.state, self._part_of)
        self._guard = InversionGuard(self.volumes, self._part_of)
        self._colliders = ColliderRows(arrays.colliders)
        self._colliders.put(self.options.colliders)
        self._feedback = self._make_feedback()
        on_cuda = arrays, self.rest_vertices, self.device
        self._frame = CudaFrame(*on_cuda) if on_gpu else CpuFrame(arrays, halves)
        self._contact = Contact(self.rest_vertices, self.volumes.vertices, self._state, self._frame)
        self._contact.take(self.options.integrator)
        body = self._holds, self._rest_shape, self._contact, self._part_of, self.object_size
        self._recovery = Recovery(arrays.state, *body, lambda: self._run(False, 0, False))
        self.rescue = self._recovery.rescue
        self.set_material(material)
        self.reset()

    # -- material, masses --------------------------------------------------------------

    def set_material(self, material: Material) -> None:
        """Take another material; positions and velocities stay."""
        self.material, self._given = material, False
        edges, volumes = material.compliances(self.edges, self.volumes)
        if volumes is not None:
            volumes = self.volumes.softened(volumes, self._stiffness)
        self._compliances = self.edges.softened(edges, self._stiffness), volumes
        self._guard.take(material, self._stiffness)
        self.set_masses(constraints.lumped_masses(self.rest_vertices, self.tets, material.density))

    def set_stiffness(self, factors: ArrayLike | None) -> None:
        """Multiply Young's modulus by these numbers at the vertices; None: by 1.  [V]"""
        count = len(self.pinned)
        self._stiffness = np.ones(count) if factors is None else checks.factors(factors, count)
        self.set_material(self.material)

    @property
    def compliances(self) -> tuple[ArrayLike, ArrayLike | None]:
        """α of the edges [m/N] and volumes [m⁵/N]; set_compliances() changes them.  [E], [T]

        Where the mesh is thin, the first call takes seconds (sheets.py).  Young's modulus and the
        number of substeps are told by those of Material.compliances, which need no fit.
        """
        edges, volumes = self._compliances
        if self._thin_differ:
            edges = edges / self.edges.sheet_ratios.at(self.material.held_poisson_ratio)
        return edges, volumes

    @property
    def ready(self) -> bool:
        """Whether the next step need not wait seconds until thin parts are fitted."""
        return self.edges.sheet_ratios.ready or not self._thin_differ

    @property
    def _thin_differ(self):
        """Whether thin parts have factors of their own: with the material's compliances alone."""
        return not self._given and self.options.integrator != FIRST_INTEGRATOR

    def set_compliances(self, edges: ArrayLike, volumes: ArrayLike | None) -> None:
        """Take these instead of the material's, until set_material is called.

        Args:
            edges: α [m/N].  [E] or a number
            volumes: α [m⁵/N].  [T] or a number; None leaves volume constraints out
        """
        edge_alphas = checks.compliances(edges, len(self.edges.vertices), "edges")
        if volumes is not None:
            volumes = checks.compliances(volumes, len(self.volumes.vertices), "volumes")
        self._compliances, self._given = (edge_alphas, volumes), True
        self._guard.take(None)
        self._touch()

    def set_masses(self, masses: ArrayLike) -> None:
        """Take masses [kg] instead of the material's, until set_material; 0 is kinematic.  [V]"""
        self._holds.set_masses(checks.masses(masses, len(self.rest_vertices)))
        self._touch()

    def set_options(self, options: XpbdOptions) -> None:
        """Take other options; positions and velocities stay, and colliders that are the same."""
        if options.colliders != self.options.colliders:
            self._colliders.put(options.colliders)
        self.options = options
        self._contact.take(options.integrator)
        self._touch()

    def move_colliders(self, centers: ArrayLike) -> None:
        """Set the centers of the options' colliders after the next step [m].  [C, 3]"""
        self._colliders.move(centers)
        self._still_frames = 0
        if not self._active.all():
            self._activate()

    def set_rest_shape(self, vertices: ArrayLike | None = None) -> None:
        """Take these positions as the shape to which the body returns; None is the mesh's own.

        Positions and velocities stay, and so do the constraints' stiffnesses.

        Args:
            vertices: [V, 3] m
        """
        if vertices is None:
            vertices = self.rest_vertices
        vertices = checks.vectors(vertices, len(self.pinned), "position", "vertex")
        self._rest_shape.take(vertices)
        self._feedback = self._make_feedback()
        self._touch()

    def _make_feedback(self):
        return Feedback(self.rest_shape, self.volumes.vertices, self._part_of, self._motion)

    @property
    def rest_shape(self) -> np.ndarray:
        """The shape to which the body returns; set_rest_shape() changes it.  [V, 3]"""
        return self._rest_shape.vertices

    @property
    def rest_lengths(self) -> np.ndarray:
        """Of all edges, as they are after yielding [m]; set_rest_lengths() changes them.  [E]"""
        return self._lists[0].rest_values.copy()

    def set_rest_lengths(self, lengths: ArrayLike) -> None:
        self._lists[0].set_rest_values(np.asarray(lengths, float))

    # -- pins, handles -----------------------------------------------------------------

    @property
    def pinned(self) -> np.ndarray:
        """Which vertices are pinned; set_pinned() changes it.  [V] bool"""
        return self._holds.pinned

    def set_pinned(self, mask: ArrayLike) -> None:
        """Pin these vertices where they are now, and free all others.  [V] bool"""
        mask = checks.per_vertex(mask, len(self.pinned), "a pin mask", bool)
        changed = mask != self.pinned
        self._holds.pin(mask)
        self._touch(changed)

    def grab(
        self, ids: ArrayLike, stiffness: ArrayLike | None = None, force_limit: ArrayLike = math.inf
    ) -> None:
        """Make these vertices the handles, in place of those grabbed before.

        Args:
            ids: [K] int
            stiffness: Stiffness of the springs to their targets [N/m], a number or [K];
                None moves them there exactly, with any force.
            force_limit: The largest force of a spring [N], a number or [K].
        """
        ids = checks.handles(ids, len(self.pinned))
        self._holds.grab(ids, stiffness, force_limit)
        self._touch(ids)

    def move(self, targets: ArrayLike) -> None:
        """Set the positions of the handles, in grab()'s order, after the next step.  [K, 3]"""
        self._holds.move(targets)

    def release(self) -> None:
        """Release all handles; they keep their velocity and get their mass back."""
        self.grab([])

    # -- state -------------------------------------------------------------------------

    def reset(self) -> None:
        """Return to the rest shape at zero velocity; handles stay grabbed there."""
        self._rest_shape.restore()
        self.set_state(self.rest_shape)
        # Where nothing acts on it, the rest pose is an equilibrium.
        acts = self.options.load is not None or self.options.ground is not None
        if not acts and len(self._holds.handles) == 0:
            self.rescue.report(np.zeros(1, int))
            self.fall_asleep()

    def set_state(self, vertices: ArrayLike, velocities: ArrayLike | None = None) -> None:
        """Start from these positions [m] and velocities [m/s] (zero by default).  [V, 3]"""
        vertices = checks.vectors(vertices, len(self.pinned), "position", "vertex")
        self._holds.set_positions(vertices)
        if self._placed is None:  # else nothing has written to them since
            self._state.deltas.zero_()
            self._state.presses.zero_()
        self._placed = vertices
        self.velocities.zero_()
        self._contact.forget()
        self._free_parts.forget()
        self._guard.reset()
        if velocities is not None:
            velocities = checks.vectors(velocities, len(self.pinned), "velocity", "vertex")
            self.velocities.assign(velocities)
        self._touch()

    def stand(self, vertices: ArrayLike) -> None:
        """Stand still at these positions [m]; if they are those of now, nothing wakes.  [V, 3]"""
        now = self.vertices.numpy() if self._placed is None else self._placed
        self.velocities.zero_()
        if not np.array_equal(vertices, now):
            self.set_state(vertices)

    @property
    def settled(self) -> bool:
        """Whether the solver sleeps: nothing is grabbed and nothing moves."""
        awake = self._still_frames < self.options.sleep_frames or len(self._holds.handles) > 0
        return not awake and (not self.options.rescue or self._recovery.may_sleep())

    def stiffness_ratio(self) -> float:
        """The median of r = α/(w h²) over edges that can move; nan if none can.

        Below some 0.66 most constraints are at the floor of definition/solver.py: the substeps, not
        Young's modulus, decide how stiff the object is.
        """
        return self._held_stiffness().ratio(self._substep)

    @property
    def integrator(self) -> Integrator:
        """How substeps move on, by the stiffness, and by what needs damping to come to rest."""
        if self.options.ground is not None or self.options.colliders or self.rescue.ratio:
            return INTEGRATORS[self.options.integrator][-1]
        return self._held_stiffness().integrator(self._substep)

    def estimated_young_modulus(self) -> float:
        """The E of the material that a load meets with these substeps, by an estimate [Pa].

        Where they hold less than HELD_SHARE of E, bodies are up to 2.4 times as stiff.
        """
        return self._held_stiffness().young_modulus(self._substep)

    def held_young_modulus(self) -> float:
        """The E of the material that a load meets with these substeps [Pa].

        Where they don't hold it, the body is pulled, once for its pins, which takes some tenths of
        a second, and some seconds if its thin parts have to be fitted first (pull_test.py).
        """
        estimated = self.estimated_young_modulus()
        wanted = HELD_SHARE * self.material.young_modulus
        if not estimated < wanted or not self._thin_differ:
            return estimated
        held = self.pinned | (self._holds.free_inverse_masses == 0.0)
        if self._pulled is None or self._pulled[0] != held.tobytes():
            free = {"contact": False, "rescue": False, "sleep_motion": 0.0}
            options = XpbdOptions(integrator=self.options.integrator, **free)
            body = self.rest_vertices, self.tets, Material(), held, options, str(self.device)
            other = XpbdSolver(*body)
            other.edges = self.edges  # thin parts are fitted once
            self._pulled = held.tobytes(), floor_share(other, self._part_of)
        return self._held_stiffness().young_modulus(self._substep, self._pulled[1])

    def substeps_that_hold(self) -> int:
        """The least number of substeps per 1/60 s with which a load meets HELD_SHARE of E.

        It is one of automatic_counts(), the last if none is enough.  It follows from mesh, masses
        and material, and is the same on each device.
        """
        return self._held_stiffness().least_count(len(self.edges.vertices))

    @property
    def _substep(self):
        return self._dt / self.options.substeps(self._dt)

    def _held_stiffness(self):
        w = np.where(self.pinned, 0.0, self._holds.free_inverse_masses)
        body = self.edges, self.volumes, *self._compliances
        return HeldStiffness.of(self.material, self.options, *body, w)

    # -- time --------------------------------------------------------------------------

    def step(self, dt: float) -> None:
        """Advance by one frame of dt seconds; a dt other than before costs new coefficients."""
        checks.time_step(dt)
        self._read_feedback()
        if self.settled:
            return
        self._placed = None
        if dt != self._dt:
            self._dt = dt
            self._stale = True
        count_due = False
        if self.options.rescue and len(self._holds.handles) == 0:
            lies = self.options.ground is not None
            held = self.options.load, self.material.damping, self.options.air_drag, lies
            count_due = self._recovery.begin(dt, *held)
        concerned = self._recovery.follow()
        if concerned is not None:
            self._activate(concerned)
        touching = self.options.contact and self._find_contacts()
        if self._stale:
            self._prepare()
        self._run(self._free_parts.damp(), self._colliders.begin(), touching)
        if self.options.contact:
            self._contact.watch(dt)
        self._colliders.end()
        if not self.rescue.running:
            self._rest_shape.flow()
        returns = count_due and self._recovery.returns_to_rest
        self._feedback.end(self.vertices, count_due, returns, self._guard.begin(dt))

    def _run(self, damped_free, collider_count, touching):
        """One frame of the vertices.

        Args:
            damped_free: Whether the motion of free parts is damped already.
        """
        self._frame.run(
            self.options.substeps(self._dt),
            self._compliances[1] is not None or self.rescue.ratio is not None,
            self._holds.springs is not None,
            self.options.ground is not None,
            damped_free,
            collider_count,
            touching,
        )

    def _find_contacts(self):
        """Whether parts touch in this frame; wakes those that a part in motion touches."""
        if not self._stale and self._contact.quiet(self._dt):
            return False
        out = self.rescue.without_contact(self._active)
        touched = self._contact.find(self._dt, self._active, out)
        if len(touched) > 0 and not self._active[touched].all():
            self._activate(np.isin(self._part_of, touched))
        return len(touched) > 0

    def _read_feedback(self):
        """Take the results of the frame before."""
        motion, volumes, counts = self._feedback.read()
        if counts is not None:
            self._recovery.report(counts)
        if volumes is not None and self._guard.report(*volumes):
            self._stale = True
        if motion is None:
            return
        self._contact.moved(motion)
        still = motion <= self.options.sleep_motion * self.object_size
        self._still_frames = self._still_frames + 1 if still else 0
        if self.settled:
            self.fall_asleep()

    def fall_asleep(self) -> None:
        """Take it that nothing moves: no part is worked on until the user touches it."""
        self._still_frames = self.options.sleep_frames
        self._active[:] = False
        self.velocities.zero_()
        self._stale = True

    def _touch(self, vertices=EVERYWHERE):
        """The user did something to these vertices (ids or a mask): wake their parts."""
        self._still_frames = 0
        self._feedback.drop()
        self._contact.look_again()
        self._recovery.touch()
        self._guard.touch()
        self._activate(vertices)

    def _activate(self, vertices=EVERYWHERE):
        """Work on the parts of these vertices from now on; with gravity, on all parts."""
        if any(self.options.gravity):
            vertices = EVERYWHERE
        self._active[self._part_of[vertices]] = True
        self._stale = True

    def _prepare(self):
        """Update the lists and coefficients that follow from all settings."""
        self._stale = False
        integrator = self.integrator
        of_material = self.material.damping, self.object_size, integrator.theta
        timing = self.options.timing(self._dt, *of_material)
        self._timing.assign(timing)
        w, reach = self._holds.inverse_masses, timing.reach
        movable = (self._holds.free_inverse_masses > 0) & ~self.pinned
        movable &= self._active[self._part_of]
        of_edges, of_volumes = self.compliances
        of_constraints = of_edges, self._guard.guarded(of_volumes)
        sparse = integrator.sparse_floor if self.volumes.sparse else integrator.floor
        floors = integrator.floor, np.where(self._guard.guards, integrator.floor, sparse)
        for one, compliances, floor in zip(self._lists, of_constraints, floors, strict=True):
            whole = self.rescue.ratio is not None or compliances is None
            one.select(movable, True if whole else np.isfinite(compliances))
            if self.rescue.ratio is not None:
                one.set_regularization(self.rescue.ratio * one.constraints.weights(w))
            elif compliances is not None:
                values = one.constraints.regularization(compliances, w, reach, floor)
                one.set_regularization(values)
        self._holds.prepare_springs(reach)
        self._rest_shape.prepare(self.material.yield_strain)
        held = np.bincount(self._part_of, self._holds.held)
        air = flight(self.options, timing, self._dt, len(self._active))
        free = self._active & (held == 0) & (self.material.damping > 0.0 or air is not None)
        self._state.free.assign(free[self._part_of].astype(np.int32))
        self._free_parts.select(free, math.exp(-self.material.damping * self._dt), air)


def kernel_modules(device: wp.DeviceLike) -> list[str]:
    """Names of the Warp modules whose kernels a solver launches, to compile before the first frame.

    On CUDA a frame's main kernel, which depends on the mesh's size, is a module of its own
    that is not among them.
    """
    frame = CudaFrame if str(device).startswith("cuda") else CpuFrame
    of_frames = Feedback.__module__, FreeParts.__module__, frame.__module__
    return [*of_frames, *contact_modules()]
