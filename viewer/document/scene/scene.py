"""The object in the view, without OpenGL: its pose, pins, and the user's drag.

Positions are model space, V vertices.
"""

from operator import attrgetter

import numpy as np
import warp as wp

from ....core.deform import Sphere, falloff, lowest_pins, vertices_within
from ...camera import values_of
from ...settings import CPU_TARGET_FPS, SHOWN, Settings
from ..history.journal import Edited, Journal, edit
from ..history.undo import States
from ..rigging.hold import Hold
from ..rigging.posing import Posing
from ..rigging.rigging import Rigging, rig_of
from ..timeline.timeline import Timeline
from .body import Body, stored_size
from .clock import Clock
from .cuts import LOWEST_PART, Cuts
from .grabs import Ball
from .handles import Handles
from .surface import bounds, nearest_vertices, of_the_object, stands
from .viewpoint import Viewpoint

VISIBLE = 5e-4  # object sizes, half a pixel in the first view
SMALLEST_BALL = 0.02  # object sizes
HANDLE_RADIUS = 0.0135  # of its size
shown_now = attrgetter(*SHOWN)


class Scene:
    """An object that can be bent."""

    def __init__(self, field, name: str, device: str, surface=None, meters=None, steady=None):
        """Take a field at rest.

        Args:
            surface: Points that can be seen, by default its vertices.  [N, 3]
            steady: Which of them are on the surface for sure, by default all.  [N] bool
            meters: The longest side of what can be seen; by default what the model says, else
                one unit is a meter.

        Raises:
            ValueError: The model's rig is none.
        """
        self.field = field
        self.name, self.source = name, None  # the model's file, if it has one: a Path
        self.settings = Settings()
        if device == "cpu":
            self.settings.target_fps = CPU_TARGET_FPS
        rest, tets = field.mesh.rest_vertices, field.mesh.tets
        self._surface = rest if surface is None else surface
        low, high = bounds(self._surface)
        self.floor = float(self._surface[:, 2].min())  # where a ground is put
        self.stands = stands(self._surface)
        self.center = 0.5 * (low + high)
        self.size = float((high - low).max())
        self.handle_radius = HANDLE_RADIUS * self.size
        self.handle_bias = 2.5 * self.handle_radius  # a handle so far behind the surface is visible
        # The pins of a held object [V] bool.  The mesh's lowest vertices may be specks below it.
        self.pins = lowest_pins(rest, tets)
        self.pins |= rest[:, 2] <= low[2] + LOWEST_PART * (high - low)[2]
        meters = stored_size(field.meta) if meters is None else meters
        factors = None if field.stiffness is None else field.stiffness.astype(float)
        self.body = Body(rest, tets, self.pins, self.size, meters, device, factors)
        self.cuts = Cuts(self)
        self.grip = Hold(self.body)  # by the mouse and by bones
        self.rigging = Rigging(self, rig_of(field, name))
        self.posing = Posing(self, self.rigging)
        self._nearest = nearest_vertices(self._surface, rest)  # [N], of each point
        of_object = of_the_object(rest, tets)  # [V]
        near = np.unique(self._nearest)
        self._surface_vertices = near[of_object[near]]
        chosen = of_object[self._nearest] & (True if steady is None else steady)
        points = self._surface[chosen if chosen.any() else slice(None)]
        self.handles = Handles(self, points)
        self.ball: Ball | None = None
        self.revision = 0  # counts the changes of the pose
        self._seen = None  # the revision, and its vertices: a copy on the device
        self._host = None  # the same on the host, once they are wanted  [V, 3]
        self.viewpoint = Viewpoint(self)
        self.timeline, self.clock = Timeline(self), Clock(self)
        every = self.__dict__.items()
        self.parts = {name: one for name, one in every if isinstance(one, Edited)}
        self.states = States(self)
        self.journal = Journal(self.states)
        for one in self.parts.values():
            one.journal = self.journal

    # -- pose ----------------------------------------------------------------------------

    @property
    def positions(self):
        """The current vertices on the host.  [V, 3] float32"""
        if self._seen is None or self._seen[0] != self.revision:
            self._take_pose()
        if self._host is None:
            self._host = np.array(self._seen[1].numpy())
        return self._host

    def _take_pose(self):
        """The pose of now is that of the revision.  The host doesn't wait for it: a clip plays."""
        now = self.solver.vertices
        copy = wp.empty_like(now) if self._seen is None else self._seen[1]
        wp.copy(copy, now)
        self._seen, self._host = (self.revision, copy), None

    @property
    def solver(self):
        """Moves the vertices; another one after tets were deleted."""
        return self.body.solver

    @property
    def pinned(self):
        """Which vertices are pinned, those too that keys or bones move meanwhile.  [V] bool"""
        return self.solver.pinned | self.timeline.taken_pins | self.posing.taken_pins

    @property
    def near(self):
        """Vertices by the surface, of tets that are left.  ids"""
        return self._surface_vertices[self.cuts.vertices[self._surface_vertices]]

    @property
    def seen_points(self):
        """Points of the surface that is left, as it is now; all if none is.  [N, 3]"""
        moved = self.positions - self.field.mesh.rest_vertices
        points = self._surface + moved[self._nearest]
        left = self.cuts.vertices[self._nearest]
        return points[left] if left.any() else points

    @property
    def orbit(self):
        return self.viewpoint.orbit

    @orbit.setter
    def orbit(self, orbit):
        self.viewpoint.orbit = orbit

    def note_view(self) -> None:
        """Let the journal know how the object is shown, and of a camera that a hand moves."""
        camera = None if self.timeline.moves_camera else self.viewpoint.orbit
        shown, noted = shown_now(self.settings), self.journal.noted
        if camera is noted[0] and shown == noted[1]:
            return
        view = dict(zip(SHOWN, shown, strict=True))
        self.journal.note_view(view if camera is None else values_of(camera) | view)
        self.journal.noted = camera, shown

    def look(self, least=VISIBLE) -> None:
        """Take notice of the pose: it has changed if it differs by more than that [sizes]."""
        if self._seen is not None and self._seen[0] == self.revision:
            moved = abs(self.solver.vertices.numpy() - self.positions)
            if not moved.max() > least * self.size:
                return
            self.revision += 1
        self._take_pose()

    @edit("reset", undo="reset")
    def reset(self) -> None:
        """Back to the rest pose with all its pins, nothing grabbed."""
        self.timeline.stop()
        self.posing.rest()
        self.handles.release()
        self.handles.free_posed()
        self.end_push()
        self.solver.reset()
        if self.held and not self.solver.pinned[self.pins].all():  # some were freed
            self.solver.set_pinned(self.solver.pinned | self.pins)
        self.revision += 1

    # -- stiffness -----------------------------------------------------------------------

    def paint(self, point, factor) -> None:
        """Multiply the stiffness around a point of the surface as it is now [3]."""
        ids = self.near
        away = self.solver.vertices.numpy()[ids] - np.asarray(point, float)
        vertex = int(ids[(away**2).sum(axis=1).argmin()])
        self._paint(vertex, factor, self.grab_radius)

    @edit("paint", undo="paint", merges=True)
    def _paint(self, vertex, factor, radius):
        rest = self.field.mesh.rest_vertices
        ids = vertices_within(rest, vertex, radius)
        self.body.paint(ids, falloff(rest, vertex, ids, radius), factor)

    # -- the ball ------------------------------------------------------------------------

    def push(self, point, towards_eye) -> None:
        """Put a ball before a point of the surface [3], in a direction [3]."""
        self._push(point, towards_eye, max(self.grab_radius, SMALLEST_BALL * self.size))

    @edit("push", undo="push with the ball", begins=True)
    def _push(self, point, towards_eye, radius):
        center = np.asarray(point, float) + radius * np.asarray(towards_eye)
        self.ball = Ball(radius, center, center)
        self.body.set_options(colliders=(Sphere(tuple(center), radius),))

    def push_to(self, center) -> None:
        """Send the ball's center to a point [3], which it reaches in the next frame."""
        if np.isfinite(center).all():
            self.ball.target = np.asarray(center, float)

    def follow_ball(self, share: float) -> None:
        """Move the ball by a share of the way to where it was sent, if that is anywhere."""
        ball = self.ball
        if ball is not None and ball.on_its_way:
            way = ball.target - ball.reached
            self._move_ball(ball.target if share == 1.0 else ball.reached + share * way)

    @edit("move_ball")
    def _move_ball(self, to):
        """Move the ball in the next step."""
        if self.ball is not None:
            self.ball.reached = np.asarray(to, float)
            self.solver.move_colliders(self.ball.reached[None])

    @edit("end_push")
    def end_push(self) -> None:
        """Take the ball away."""
        if self.ball is not None:
            self.ball = None
            self.body.set_options(colliders=())

    # -- who moves it --------------------------------------------------------------------

    def hands_off(self) -> None:
        """Let go of what the mouse holds, and take the ball away."""
        self.handles.release()
        self.end_push()

    def let_loose(self) -> None:
        """Neither hand nor ball nor bones nor keys move the object any more."""
        self.hands_off()
        self.posing.end()
        self.timeline.stop()

    def make_way(self, soft: bool) -> None:
        """Let bones move the object: all of it while time stands still, or some if it is soft."""
        self.end_push()
        if soft:
            self.timeline.give_way()
        else:
            self.handles.release()
            self.timeline.stand_still()

    # -- the object ----------------------------------------------------------------------

    @property
    def held(self) -> bool:
        """Whether anything is pinned."""
        return bool((self.solver.pinned & self.cuts.vertices).any())

    @edit("hold", undo="hold")
    def hold(self, held: bool) -> None:
        """Pin the lowest vertices of the object where it is, or let all of it float."""
        self.timeline.stop()
        self.solver.set_pinned((self.pins | self.solver.pinned) & held)
        self.handles.forget_patches()
        self.keep_in_sight()

    @property
    def grab_radius(self) -> float:
        """Within which vertices move together [model units]."""
        return self.settings.grab_radius * self.size

    # -- what surrounds it ---------------------------------------------------------------

    @property
    def on_ground(self) -> bool:
        return self.solver.options.ground is not None

    def set_ground(self, on: bool) -> None:
        """Put a ground under the visible object at rest, or take it away."""
        self._set_ground(self.cuts.lowest if on else None)

    @edit("set_ground", undo="ground")
    def _set_ground(self, height):
        self.body.set_options(ground=height)

    @edit("set_gravity", undo="gravity", merges=True)
    def set_gravity(self, strength: float) -> None:
        """Set gravity, downwards [m/s²]."""
        self.body.set_gravity(strength)
        self.keep_in_sight()

    def keep_in_sight(self):
        """Put a ground under an object that falls and is not held: it would leave the view."""
        if self.body.gravity > 0.0 and not self.held and not self.on_ground:
            self.set_ground(True)

    # -- undo ----------------------------------------------------------------------------

    @edit("undo")
    def undo(self) -> bool:
        """Take back the last step; whether there was one."""
        self.hands_off()
        return self.journal.undo()

    @edit("redo")
    def redo(self) -> bool:
        """Do again what was undone last; whether there was something."""
        self.hands_off()
        return self.journal.redo()
