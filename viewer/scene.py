"""The object in the view, without OpenGL: its pose, pins, and the user's drag.

The solver always steps by 1/60 s, since another length would make it compute its coefficients
anew; a frame takes as many steps as fit in it.  Positions are model space, V vertices.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..core.deform import (
    TIME_STEP,
    Sphere,
    control_vertices,
    falloff,
    lowest_pins,
    vertices_within,
)
from ..core.geometry import components
from . import orbit as orbits
from .body import Body, stored_size
from .settings import CPU_TARGET_FPS, Settings
from .surface import bounds, nearest_vertices

MAX_STEPS = 6  # a frame; below 10 frames a second the object's time runs slower than the clock
VISIBLE = 5e-4  # object sizes, half a pixel in the first view
CONTROL_COUNT = 40
SMALLEST_BALL = 0.02  # object sizes
PINNED_PART = 0.05  # of the object's height
SPECK = 0.02  # of the vertices: components smaller than that have no handles
MARGIN = 0.62  # of a framed object's size: the radius of the ball that fills the image
DEPTH_PART = 0.75  # of its size, that the object may reach from its center towards the eye
HANDLE_RADIUS = 0.0135  # of its size
PATCH_PART = 0.75  # of a soft grab's radius, that is pinned; beyond it, pulls are weak
# A patch of radius R of an elastic body with Young's modulus E (the one that the substeps
# hold) resists a pull like a spring of at most 2 E R: 0.8 E times the size for the largest
# grab radius.  Springs of 4 E times the size together therefore follow the mouse closely.
# Their force is limited to that of the patch at an eighth of the size, since thin parts
# would be torn long by more.
SOFT_STIFFNESS = 4.0  # of all springs of a drag together, in E times the object's size
SOFT_FORCE = 0.25  # of all of them, in E R times the object's size
LEAST_PULL = 1e-3  # of the strongest spring; weaker ones are left out
FIRST_VIEW = orbits.Orbit(yaw=np.radians(30.0), pitch=np.radians(14.0))


@dataclass
class Grab:
    """A drag in progress: `vertex` and those around it are moved, or pulled, as one body."""

    vertex: int
    ids: np.ndarray  # of the vertices that move along, `vertex` among them  [K]
    offsets: np.ndarray  # their positions relative to `vertex` when it was grabbed  [K, 3]
    target: np.ndarray  # target position of `vertex`  [3]
    reached: np.ndarray  # target of the steps so far  [3]
    before: tuple[np.ndarray, np.ndarray]  # positions and velocities of all vertices
    rest_lengths: np.ndarray | None  # of all edges, if the material yields


@dataclass
class Ball:
    """A ball that the mouse pushes with."""

    radius: float
    target: np.ndarray  # of its center  [3]
    reached: np.ndarray  # its center after the steps so far  [3]


class Scene:
    """An object that can be bent."""

    def __init__(self, field, name: str, device: str, surface=None, meters=None):
        """Take a field at rest.

        Args:
            surface: Points that can be seen, by default its vertices.  [N, 3]
            meters: The longest side of what can be seen; by default what the model says, else
                one unit is a meter.
        """
        self.field = field
        self.name = name
        self.settings = Settings()
        if device == "cpu":
            self.settings.target_fps = CPU_TARGET_FPS
        rest, tets = field.mesh.rest_vertices, field.mesh.tets
        self._surface = rest if surface is None else surface
        low, high = bounds(self._surface)
        self.center = 0.5 * (low + high)
        self.size = float((high - low).max())
        self.handle_radius = HANDLE_RADIUS * self.size
        self.handle_bias = 2.5 * self.handle_radius  # a handle so far behind the surface is visible
        # The pins of a held object [V] bool.  The lowest vertices of the mesh alone would not
        # do: they may be specks below the object.
        self.pins = lowest_pins(rest, tets)
        self.pins |= rest[:, 2] <= low[2] + PINNED_PART * (high - low)[2]
        self._patches = np.zeros(len(rest), int)  # of pins that were set together; 0: none
        meters = stored_size(field.meta) if meters is None else meters
        factors = None if field.stiffness is None else field.stiffness.astype(float)
        self.body = Body(rest, tets, self.pins, self.size, meters, device, factors)
        self.solver = self.body.solver
        self._nearest = nearest_vertices(self._surface, rest)  # [N], of each point
        near = np.unique(self._nearest)
        self._near = near[_of_the_object(rest, tets)[near]]
        controls = control_vertices(rest, self._near, CONTROL_COUNT)
        self._controls = controls[~self.pins[controls]]
        self.hover: int | None = None  # the vertex under the mouse
        self.grabbed: Grab | None = None
        self.ball: Ball | None = None
        self.paused = False
        self.revision = 0  # counts the changes of the pose
        self._time = 0.0  # s that frames have lasted and no step has covered
        self._host = None  # the revision, and its positions
        self.home()

    # -- pose ----------------------------------------------------------------------------

    @property
    def positions(self):
        """The current vertices on the host.  [V, 3] float32"""
        if self._host is None or self._host[0] != self.revision:
            self._host = self.revision, np.array(self.solver.vertices.numpy())
        return self._host[1]

    @property
    def moving(self) -> bool:
        """Whether time changes the pose."""
        return not self.paused and not (self.solver.settled and not self._pushes)

    @property
    def _pushes(self):
        """Whether the ball is on its way."""
        return self.ball is not None and bool((self.ball.target != self.ball.reached).any())

    def advance(self, seconds: float) -> None:
        """Let time pass, unless the object rests or time is stopped."""
        if not self.moving:
            self._time = 0.0
            return
        self._time += seconds
        count = min(round(self._time / TIME_STEP), MAX_STEPS)
        self._time = min(self._time - count * TIME_STEP, TIME_STEP)
        self._step(count)

    def warm_up(self) -> None:
        """Take a step with and one without a handle, so that all that steps need is loaded."""
        self.solver.grab(self.control_ids[:1])
        self.solver.step(TIME_STEP)
        self.solver.release()
        self.solver.step(TIME_STEP)  # it also counts tangles
        self.solver.reset()

    def single_step(self) -> None:
        """Pause, and take one step."""
        self.paused = True
        self._step(1)

    def _step(self, count):
        grab, ball = self.grabbed, self.ball
        for remaining in range(count, 0, -1):  # each step takes its part of the way
            if grab is not None:
                grab.reached = grab.reached + (grab.target - grab.reached) / remaining
                self.solver.move(grab.reached + grab.offsets)
            if self._pushes:
                ball.reached = ball.reached + (ball.target - ball.reached) / remaining
                self.solver.move_colliders(ball.reached[None])
            self.solver.step(TIME_STEP)
        # The pose counts as changed when it differs visibly from the one that was last shown.
        now = self.solver.vertices.numpy()
        if abs(now - self.positions).max() > VISIBLE * self.size:
            self.revision += 1
            self._host = self.revision, now.copy()

    def reset(self) -> None:
        """Back to the rest pose, nothing grabbed."""
        self.release()
        self.end_push()
        self.solver.reset()
        self.revision += 1

    # -- handles -------------------------------------------------------------------------

    def grab(self, vertex: int) -> None:
        """Take hold of a vertex and of those around it at rest."""
        radius = self.settings.grab_radius * self.size
        ids = vertices_within(self.field.mesh.rest_vertices, vertex, radius)
        ids = ids[~self.solver.pinned[ids]]
        start = self.positions[vertex].astype(float)
        before = self.positions, self.solver.velocities.numpy().copy()
        if self.settings.soft_grab:
            pull = falloff(self.field.mesh.rest_vertices, vertex, ids, radius)
            ids, pull = ids[pull >= LEAST_PULL], pull[pull >= LEAST_PULL]
            modulus = self.solver.held_young_modulus()
            share = modulus * self.solver.object_size * pull / pull.sum()
            radius = max(radius, self.solver.edges.rest_values.mean())
            self.solver.grab(ids, SOFT_STIFFNESS * share, SOFT_FORCE * radius * share)
        else:
            self.solver.grab(ids)
        offsets = self.positions[ids] - start
        yields = math.isfinite(self.body.material.yield_strain)
        lengths = self.solver.rest_lengths if yields else None
        self.grabbed = Grab(vertex, ids, offsets, start, start, before, lengths)

    def drag_to(self, target) -> None:
        """Send the grabbed vertex to a point [3]; exact grabs reach it in the next frame."""
        self.grabbed.target = np.asarray(target, float)

    def release(self) -> None:
        if self.grabbed is not None:
            self.solver.release()
            self.grabbed = None

    def pin_grab(self) -> None:
        """Let go, and pin the patch that was held where it is."""
        vertex = self.grabbed.vertex
        self.release()
        self.set_pin(vertex, True)

    def cancel_grab(self) -> None:
        """Let go, and restore the pose and velocities from before the grab."""
        grab = self.grabbed
        self.release()
        self.solver.set_state(*grab.before)
        if grab.rest_lengths is not None:
            self.solver.set_rest_lengths(grab.rest_lengths)
        self.revision += 1

    # -- stiffness -----------------------------------------------------------------------

    def paint(self, point, factor) -> None:
        """Multiply the stiffness around a point of the surface as it is now [3]."""
        near = self.positions[self._near] - np.asarray(point, float)
        vertex = int(self._near[(near**2).sum(axis=1).argmin()])
        rest, radius = self.field.mesh.rest_vertices, self.settings.grab_radius * self.size
        ids = vertices_within(rest, vertex, radius)
        self.body.paint(ids, falloff(rest, vertex, ids, radius), factor)

    def stiffened_field(self):
        """The field, with the stiffness as it is painted now."""
        factors = self.body.factors
        return replace(self.field, stiffness=None if factors is None else factors.copy())

    # -- the ball ------------------------------------------------------------------------

    def push(self, point, towards_eye) -> None:
        """Put a ball before a point of the surface [3], in a direction [3]."""
        radius = max(self.settings.grab_radius, SMALLEST_BALL) * self.size
        center = np.asarray(point, float) + radius * np.asarray(towards_eye)
        self.ball = Ball(radius, center, center)
        self.body.set_options(colliders=(Sphere(tuple(center), radius),))

    def push_to(self, center) -> None:
        """Send the ball's center to a point [3], which it reaches in the next frame."""
        self.ball.target = np.asarray(center, float)

    def end_push(self) -> None:
        """Take the ball away."""
        if self.ball is not None:
            self.ball = None
            self.body.set_options(colliders=())

    def displacements(self):
        """Distance of each vertex from its rest position, in object sizes.  [V]"""
        return np.linalg.norm(self.positions - self.solver.rest_vertices, axis=1) / self.size

    # -- the object ----------------------------------------------------------------------

    @property
    def held(self) -> bool:
        """Whether anything is pinned."""
        return bool(self.solver.pinned.any())

    @property
    def pin_ids(self):
        """The pins that are drawn: those by the surface."""
        return self._near[self.solver.pinned[self._near]]

    @property
    def control_ids(self):
        """The vertices that can be dragged, pins that were freed included."""
        freed = self._near[self.pins[self._near]]
        ids = np.concatenate([self._controls, freed])
        return ids[~self.solver.pinned[ids]] if self.held else self._controls

    def hold(self, held: bool) -> None:
        """Pin the lowest part of the object where it is, or let all of it float."""
        self.solver.set_pinned((self.pins | self.solver.pinned) & held)
        self._patches[:] = 0
        self._keep_in_sight()

    def set_pin(self, vertex: int, pinned: bool) -> None:
        """Pin a vertex and its patch where they are; or free it, and what was pinned with it."""
        pins = self.solver.pinned.copy()
        if pinned:
            part = PATCH_PART if self.settings.soft_grab else 1.0
            radius = part * self.settings.grab_radius * self.size
            patch = vertices_within(self.field.mesh.rest_vertices, vertex, radius)
            patch = patch[~pins[patch]]
            self._patches[patch] = self._patches.max() + 1
            pins[patch] = True
        else:
            patch = self._patches == self._patches[vertex] if self._patches[vertex] else vertex
            pins[patch], self._patches[patch] = False, 0
        self.solver.set_pinned(pins)
        self.hover = None
        self._keep_in_sight()

    # -- what surrounds it ---------------------------------------------------------------

    @property
    def on_ground(self) -> bool:
        return self.solver.options.ground is not None

    def set_ground(self, on: bool) -> None:
        """Put a ground under the visible object at rest, or take it away."""
        self.body.set_options(ground=float(self._surface[:, 2].min()) if on else None)

    def set_gravity(self, strength: float) -> None:
        """Set gravity, downwards [m/s²]."""
        self.body.set_gravity(strength)
        self._keep_in_sight()

    def _keep_in_sight(self):
        """Put a ground under an object that falls and is not held: it would leave the view."""
        if self.body.gravity > 0.0 and not self.held and not self.on_ground:
            self.set_ground(True)

    # -- camera --------------------------------------------------------------------------

    def home(self) -> None:
        """The first view: the whole object at rest."""
        self.orbit = orbits.framing(FIRST_VIEW, self.center, MARGIN * self.size)

    def focus(self) -> None:
        """Frame the object as it is now, or turn about the vertex under the mouse."""
        if self.hover is not None:
            self.orbit = replace(self.orbit, target=self.positions[self.hover].astype(float))
            return
        moved = self.positions - self.field.mesh.rest_vertices
        low, high = bounds(self._surface + moved[self._nearest])
        radius = MARGIN * float((high - low).max())
        self.orbit = orbits.framing(self.orbit, 0.5 * (low + high), radius)

    @property
    def depth_range(self) -> tuple[float, float]:
        """Distances from the eye between which the object lies at rest, whatever its shape."""
        away = float(np.linalg.norm(orbits.pose(self.orbit)[:3, 3] - self.center))
        return max(away - DEPTH_PART * self.size, 0.0), away + DEPTH_PART * self.size


def _of_the_object(rest, tets):
    """Whether each vertex belongs to more than a speck.  [V] bool"""
    labels = components(len(rest), tets)
    return np.bincount(labels)[labels] >= SPECK * len(rest)
