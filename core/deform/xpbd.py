"""The solver: n substeps a frame, each projecting every constraint once.

One frame of length dt is n substeps of length h = dt/n (Macklin et al., "Small Steps in
Physics Simulation", 2019): move (integration.py), project edges, then volumes, color by
color (constraints.py), springs and ground, take velocities from the way gone.

This is the part on the host: what a user does becomes contents of arrays (arrays.py),
in float64 up to there.  frame_cpu.py and frame_cuda.py run a frame on them.

Units: SI; model space is one metre wide.  Shapes: V vertices, K handles.
"""

import math

import numpy as np
import warp as wp

from ..geometry import components
from . import checks, constraints
from .arrays import ConstraintList, frame_arrays
from .feedback import Feedback
from .frame import CpuFrame, CudaFrame, runs_in_block
from .material import Material
from .rescue import Rescue, distortion, way_back
from .tangles import TangleCounter
from .xpbd_options import TIME_STEP, XpbdOptions

PINS_OFF = 0.01  # object sizes that pins may be away from where they were to each other


class XpbdSolver:
    """Positions of one mesh over time.

    Pinned vertices stay where they are.  Grabbed ones go where move() says, exactly, or
    are pulled there by springs; a vertex that is pinned and grabbed stays pinned.  A part
    of the mesh that nothing has touched is left out until something does.

    Attributes:
        options: See set_options.
        edges, volumes: All constraints, sorted by color.
        vertices: Current positions, the same array for ever.  [V] vec3 on the device
        velocities: [V] vec3 on the device
        pinned: [V] bool
        object_size: The longest side of the rest pose's bounding box [m].
        inverted_count: How many tets were inverted when they were last counted.
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
        self.pinned = checks.pin_mask(pinned, len(self.rest_vertices))
        self.object_size = float(np.ptp(self.rest_vertices, axis=0).max())
        self.edges = constraints.edge_constraints(self.rest_vertices, self.tets)
        self.volumes = constraints.volume_constraints(self.rest_vertices, self.tets)
        self._free_inverse_masses = np.zeros(len(self.rest_vertices))
        self._part_of = components(len(self.rest_vertices), self.tets)  # [V]
        self._active = np.zeros(self._part_of.max() + 1, bool)  # by part
        self._dt = TIME_STEP
        self._handles = np.empty(0, np.int64)
        self._handle_targets = None  # as last given to move()
        self._springs = None  # stiffness and force limit of each handle, [K, 2]; None: exact
        self.inverted_count = 0
        self._rescue = Rescue()
        self._pins_fit = None  # whether pins are to each other as at rest; None: find out
        self._softened = None  # the ratio of the rescue that the coefficients are for
        self._rescued = np.zeros(len(self.rest_vertices), bool)
        self._rescue_path = None  # where targets begin and where they end, each [V, 3]

        self._allocate()
        self.set_material(material)
        self.reset()

    def _allocate(self):
        device, edges, volumes = self.device, self.edges, self.volumes
        count = len(self.rest_vertices)
        common = count, device, device.is_cuda and runs_in_block(count)
        self._edge_list = ConstraintList(edges, edges.rest_lengths, *common)
        self._volume_list = ConstraintList(volumes, volumes.rest_volumes, *common)
        arrays = frame_arrays(count, self._edge_list.arrays, self._volume_list.arrays, device)
        self._state, self._timing = arrays.state, arrays.timing
        self.vertices, self.velocities = self._state.vertices, self._state.velocities
        tangles = TangleCounter(self.rest_vertices, volumes.vertices, self._part_of, device)
        self._feedback = Feedback(tangles, arrays.motion, device)
        self._frame = (
            CudaFrame(arrays, self.rest_vertices, device) if device.is_cuda else CpuFrame(arrays)
        )

    # -- material, masses --------------------------------------------------------------

    def set_material(self, material: Material):
        """Take another material; positions and velocities stay."""
        self.material = material
        self._compliances = (
            self.edges.compliances(material.shear_modulus),
            self.volumes.compliances(material.bulk_modulus) if material.bulk_modulus > 0 else None,
        )
        self._set_masses(constraints.lumped_masses(self.rest_vertices, self.tets, material.density))

    def set_compliances(self, edges, volumes):
        """Take these instead of the material's, until set_material is called.

        Args:
            edges: α [m/N].  [E] or a number
            volumes: α [m⁵/N].  [T] or a number; None leaves volume constraints out
        """
        edge_alphas = checks.compliances(edges, len(self.edges.vertices), "edges")
        if volumes is not None:
            volumes = checks.compliances(volumes, len(self.volumes.vertices), "volumes")
        self._compliances = edge_alphas, volumes
        self._touch(everything=True)

    def set_masses(self, masses):
        """Masses [kg] instead of the material's, until set_material; 0 stays in place.  [V]"""
        self._set_masses(checks.masses(masses, len(self.pinned)))

    def _set_masses(self, masses):
        self._hold((masses == 0.0) & (self._free_inverse_masses > 0.0))
        self._free_inverse_masses = np.divide(1.0, masses, where=masses > 0, out=0.0 * masses)
        self._update_inverse_masses()
        self._touch(everything=True)

    def set_options(self, options: XpbdOptions):
        """Step time in another way from now on."""
        self.options = options
        self._touch(everything=True)

    # -- pins, handles -----------------------------------------------------------------

    def set_pinned(self, mask):
        """Pin these vertices where they are now, and free all others.  [V] bool"""
        mask = checks.pin_mask(mask, len(self.pinned))
        changed, held_anew = mask != self.pinned, mask & ~self.pinned
        self.pinned = mask
        self._handle_targets = None  # what is freed has missed the last ones
        self._hold(held_anew)
        self._update_inverse_masses()
        self._touch(changed)

    def grab(self, ids, stiffness=None, force_limit=math.inf):
        """Make these vertices handles, in place of those grabbed before.

        Args:
            ids: [K] int
            stiffness: Of the springs that pull them to their targets [N/m], a number or
                [K]; None moves them there exactly, whatever it takes.
            force_limit: The most that a spring pulls with [N], a number or [K].
        """
        ids = checks.handles(ids, len(self.pinned))
        self._springs = (
            None if stiffness is None else checks.springs(stiffness, force_limit, len(ids))
        )
        self._handles = ids
        self._handle_targets = None
        held_anew = np.zeros(len(self.pinned), bool)
        held_anew[ids] = True
        self._hold(held_anew & ~self.pinned)
        self._update_inverse_masses()
        self._touch(held_anew)

    def move(self, targets):
        """Where the handles, in grab()'s order, shall be after the next step.  [K, 3]"""
        targets = np.reshape(targets, (-1, 3))
        if len(targets) != len(self._handles):
            raise ValueError(f"{len(targets)} targets for {len(self._handles)} handles")
        targets = checks.vectors(targets, len(targets), "target", "handle")
        if self._handle_targets is not None and np.array_equal(targets, self._handle_targets):
            return
        self._handle_targets = targets.copy()
        free = ~self.pinned[self._handles]
        if free.any():
            self._state.targets[self._ids(self._handles[free])].assign(targets[free])

    def release(self):
        """Let all handles go; they keep their velocity and get their mass back."""
        self.grab([])

    def _hold(self, held_anew):
        """These vertices [V] bool become kinematic or get springs where they are."""
        if held_anew.any():
            state, ids = self._state, self._ids(np.flatnonzero(held_anew))
            for goal in (state.anchors, state.targets):
                wp.copy(goal[ids], state.vertices[ids])

    def _ids(self, ids):
        return wp.array(ids, dtype=int, device=self.device)

    def _update_inverse_masses(self):
        kinematic = self.pinned | self._rescued
        if self._springs is None:
            kinematic[self._handles] = True
        self._inverse_masses = np.where(kinematic, 0.0, self._free_inverse_masses)
        self._state.inverse_masses.assign(self._inverse_masses)

    # -- state -------------------------------------------------------------------------

    def reset(self):
        """Rest pose, zero velocity.  Handles stay grabbed, at their rest positions."""
        self.set_state(self.rest_vertices)
        # Without gravity the rest pose is an equilibrium.
        if not any(self.options.gravity) and len(self._handles) == 0:
            self._rescue.report(np.zeros(1, int))
            self._fall_asleep()

    def set_state(self, vertices, velocities=None):
        """Start from these positions and velocities (zero if left out).  [V, 3]"""
        vertices = checks.vectors(vertices, len(self.pinned), "position", "vertex")
        self.vertices.assign(vertices)
        self._state.anchors.assign(vertices)
        self._state.targets.assign(vertices)
        self._state.deltas.zero_()
        self.velocities.zero_()
        if velocities is not None:
            velocities = checks.vectors(velocities, len(self.pinned), "velocity", "vertex")
            self.velocities.assign(velocities)
        self._handle_targets = None
        self._touch(everything=True)

    @property
    def settled(self) -> bool:
        """True while the solver sleeps: nothing is grabbed and nothing moves."""
        return len(self._handles) == 0 and self._asleep

    @property
    def rescuing(self) -> bool:
        """Whether something is being done about what stayed tangled."""
        return self._rescue.running

    @property
    def given_up(self) -> bool:
        """Whether something stays tangled, and nothing is being done about it any more."""
        return self._rescue.given_up

    def stiffness_ratio(self) -> float:
        """The median of r = α/(w h²) over edges that can move; nan if none can.

        Below 1 the substeps, not Young's modulus, decide how stiff the object is; below
        COMPLIANCE_FLOOR that one softens it.
        """
        w = np.where(self.pinned, 0.0, self._free_inverse_masses)[self.edges.vertices].sum(axis=1)
        h = self._dt / self.options.substeps(self._dt)
        ratios = self._compliances[0][w > 0] / (w[w > 0] * h * h)
        return float(np.median(ratios)) if len(ratios) else math.nan

    def held_young_modulus(self) -> float:
        """The E of the material that a load meets with these substeps [Pa]."""
        return self.material.young_modulus_at(self.stiffness_ratio())

    # -- time --------------------------------------------------------------------------

    def step(self, dt):
        """Advance by one frame of dt seconds; another dt than before costs its coefficients."""
        if not (math.isfinite(dt) and dt > 0.0):
            raise ValueError(f"a time step of {dt} s; give a positive number")
        self._read_frame_before()
        if self.settled:
            return
        if dt != self._dt:
            self._dt = dt
            self._stale = True
        count_due = False
        if self.options.rescue and len(self._handles) == 0:
            count_due = self._rescue.advance(dt)
            self._follow_rescue()
        if self._rescue.ratio != self._softened:
            self._softened = self._rescue.ratio
            self._activate(everything=True)
        if self._stale:
            self._prepare()
        self._feedback.begin()
        self._frame.run(
            self.options.substeps(dt),
            self._compliances[1] is not None or self._softened is not None,
            self._springs is not None,
            self.options.ground is not None,
        )
        self._feedback.end(self.vertices, count_due, count_due and self._relaxes)

    def _read_frame_before(self):
        motion, counts = self._feedback.read()
        if motion is not None:
            still = motion <= self.options.sleep_motion * self.object_size
            self._still_frames = self._still_frames + 1 if still else 0
        if counts is not None:
            self.inverted_count = int(counts[0].sum())
            self._rescue.report(counts.sum(axis=0))
        if motion is not None and self.settled:
            self._fall_asleep()

    @property
    def _relaxes(self):
        """Whether rest is where it has to come to: nothing pulls, pins are as at rest."""
        if any(self.options.gravity):
            return False
        if self._pins_fit is None:
            held, rest = (a[self.pinned] for a in (self._state.targets.numpy(), self.rest_vertices))
            self._pins_fit = distortion(rest, held) < PINS_OFF * self.object_size
        return self._pins_fit

    def _follow_rescue(self):
        parts = self._rescue.parts
        if parts is None:
            if self._rescued.any():
                self._end_rescue()
            return
        if not self._rescued.any():
            self._begin_rescue(parts)
        start, goal = self._rescue_path
        self._state.targets.assign(start + self._rescue.progress * (goal - start))

    def _begin_rescue(self, parts):
        self._rescued = parts[self._part_of] & ~self.pinned
        x, targets = self.vertices.numpy(), self._state.targets.numpy()
        self._rescue_path = targets.copy(), targets.copy()
        for part in np.flatnonzero(parts):
            way = way_back(self.rest_vertices, x, self._part_of == part, self.pinned)
            for end, places in zip(self._rescue_path, way, strict=True):
                end[self._rescued & (self._part_of == part)] = places
        self._update_inverse_masses()
        self._activate(self._rescued)

    def _end_rescue(self):
        self._rescued[:] = False
        self._update_inverse_masses()
        self._stale = True

    @property
    def _asleep(self):
        done = self._rescue.may_sleep or not self.options.rescue
        return done and self._still_frames >= self.options.sleep_frames

    def _fall_asleep(self):
        """Nothing moves: no part of the object is worked on until it is touched."""
        self._still_frames = self.options.sleep_frames
        self._active[:] = False
        self.velocities.zero_()
        self._stale = True

    def _touch(self, vertices=None, everything=False):
        """A user's action woke the solver; it concerns the parts of these vertices.  [V] bool"""
        self._still_frames = self.inverted_count = 0
        self._pins_fit = None
        self._feedback.drop()
        self._rescue.touch()
        if self._rescued.any():
            self._end_rescue()
        self._activate(vertices, everything)

    def _activate(self, vertices=None, everything=False):
        if everything or any(self.options.gravity):
            self._active[:] = True
        else:
            self._active[self._part_of[vertices]] = True
        self._stale = True

    def _prepare(self):
        """What follows from all settings, in float64 on the host."""
        self._stale = False
        options, material, w = self.options, self.material, self._inverse_masses
        h = self._dt / options.substeps(self._dt)
        movable = (self._free_inverse_masses > 0) & ~self.pinned & self._active[self._part_of]
        for part in (self._edge_list, self._volume_list):
            part.select(movable)
        self._timing.assign(options.timing(self._dt, material.damping, self.object_size))
        pairs = zip((self._edge_list, self._volume_list), self._compliances, strict=True)
        for part, compliances in pairs:
            regularization = part.constraints.regularization
            if self._softened is not None:
                part.set_regularization(regularization(0.0, w, h, floor=self._softened))
            elif compliances is not None:
                part.set_regularization(regularization(compliances, w, h))
        if self._springs is not None:
            springs = np.full((len(w), 2), (constraints.NO_SPRING, 0.0))
            springs[self._handles] = constraints.spring_coefficients(
                *self._springs.T, w[self._handles], h
            )
            self._state.springs.assign(springs.astype(np.float32))
