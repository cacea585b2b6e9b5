"""Handles: the control points and pins that the mouse can take, and what it holds.

Handles have ids: a number below V is a vertex, V + c is control point c.  Any of them can be
grabbed, alone or with others that are selected, and pinned with what is around it.
"""

import math
from typing import Protocol

import numpy as np

from ....core.base.kept import Kept
from ....core.deform import vertices_within
from ....core.field import TetField
from ...settings import GRAB_RADII, Settings
from ..history.journal import Edited, edit
from ..rigging.hold import Solved
from .body import Body
from .grabs import Grab, Motion, soft_springs
from .points import ControlPoints, located, placed
from .viewpoint import clean_name

PATCH_PART = 0.75  # of a soft grab's radius, that is pinned; beyond it, pulls are weak
MOST_ADDED = 1000  # points that a user can add


class Remaining(Protocol):
    """What was not deleted."""

    vertices: np.ndarray  # [V] bool
    removed: np.ndarray  # another array where something was deleted  [T] uint64

    def points_left(self) -> np.ndarray: ...


class HandGrip(Protocol):
    """What the mouse holds vertices by."""

    def grab(self, ids, *springs) -> None: ...
    def move(self, targets) -> None: ...
    def release(self) -> None: ...


class StoppedTime(Protocol):
    """A timeline, which may have stopped time."""

    stands: bool

    def stand(self) -> None: ...
    def stop(self) -> None: ...
    def give_way(self) -> None: ...


class Grabbable(Solved, Protocol):
    """The object that has handles."""

    field: TetField
    size: float
    handle_radius: float
    settings: Settings
    grab_radius: float
    positions: np.ndarray  # [V, 3]
    pins: np.ndarray  # of a held object  [V] bool
    near: np.ndarray  # ids by the surface
    revision: int
    body: Body
    cuts: Remaining
    grip: HandGrip
    timeline: StoppedTime

    def keep_in_sight(self) -> None: ...


class Handles(Edited):
    """What of an object can be taken hold of, and is.

    Attributes:
        points: The control points, those that were added behind those of the start.
        size: The object's [model units].
        hover: The handle under the mouse, or None.
        selected: Handles that move together, in the order in which they were chosen.
        hidden: Handles that are neither drawn nor taken.
        names: That the user gave, by handle.
        grabbed: The drag in progress, or None.
        patches: A number for the vertices that were pinned together; 0: none.  Never changed
            in place.  [V]
    """

    kept = "points", "hidden", "names", "_posed", "patches"

    def __init__(self, whole: Grabbable, surface):
        """Take an object, and points of its surface at rest [N, 3]."""
        self._whole = whole
        mesh = whole.field.mesh
        self.points = placed(surface, mesh.rest_vertices, mesh.tets, whole.size)
        self.size = whole.size
        self.hover: int | None = None
        self.selected: list[int] = []
        self.hidden: list[int] = []
        self.names: dict[int, str] = {}
        self.grabbed: Grab | None = None
        self.patches = np.zeros(mesh.vertex_count, int)
        self._posed: tuple[int, ...] = ()
        self._controls, self._pins = Kept(), Kept()

    # -- where they are ------------------------------------------------------------------

    def at(self, ids, positions=None):
        """Where these handles are, for the vertices' positions [V, 3] or now.  [len(ids), 3]"""
        positions = self._whole.positions if positions is None else positions
        ids, count = np.asarray(ids, int), len(positions)
        places = positions[np.where(ids < count, ids, 0)].astype(float)
        of_points = ids >= count
        if of_points.any():
            places[of_points] = self.points.at(positions)[ids[of_points] - count]
        return places

    def exists(self, handle: int) -> bool:
        return 0 <= handle < len(self._whole.pins) + len(self.points)

    @property
    def control_ids(self):
        """What can be dragged: points that are not pinned, freed pins, and what is posed."""
        return self._controls.of(self._shown_of, self._control_ids)

    @property
    def pin_ids(self):
        """The pins that are drawn: those by the surface, and one of each patch."""
        return self._pins.of(self._shown_of, self._pin_ids)

    @property
    def _shown_of(self):
        """What the drawn handles follow from: none of it is changed in place."""
        whole = self._whole
        of_object = whole.pins, whole.solver.pinned, whole.cuts.removed
        return (*of_object, self.points, self.hidden, self.patches, self._posed)

    def _control_ids(self):
        pins, pinned, near = self._whole.pins, self._whole.solver.pinned, self._whole.near
        free = np.flatnonzero((self.points.share(pinned) < 0.5) & self._whole.cuts.points_left())
        freed = near[pins[near] & ~pinned[near] & pinned.any()]
        ids = np.concatenate([len(pins) + free, freed])
        ids = np.append(ids, [one for one in self.posed if one not in ids]).astype(int)
        return ids[~np.isin(ids, self.hidden)] if self.hidden else ids

    def _pin_ids(self):
        near, pins = self._whole.near, self._whole.solver.pinned & ~self._posed_vertices
        alone = near[pins[near] & (self.patches[near] == 0)]
        numbers = np.unique(self.patches[pins & (self.patches > 0)])
        return np.append(alone, [self._middle(pins, number) for number in numbers]).astype(int)

    def _middle(self, pins, number):
        """The vertex of a patch that is nearest to its middle; by the surface, if one is."""
        ids = np.flatnonzero(pins & (self.patches == number))
        near = ids[np.isin(ids, self._whole.near)]
        ids = near if len(near) else ids
        rest = self._whole.field.mesh.rest_vertices[ids]
        return ids[((rest - rest.mean(axis=0)) ** 2).sum(axis=1).argmin()]

    @property
    def posed(self) -> tuple[int, ...]:
        """Handles that stay where a hand has left them in *Pose*.

        Their patches are pinned, until they are dragged again, or let go by a click or a reset.
        """
        if not self._posed:
            return ()
        pinned = self._whole.solver.pinned
        return tuple(one for one in self._posed if pinned[self.corners(one)].all())

    @property
    def _posed_vertices(self):
        """Which vertices posed handles hold.  [V] bool"""
        numbers = [self.patches[self.corners(one)].max() for one in self.posed]
        return np.isin(self.patches, numbers) & (self.patches > 0)

    def corners(self, handle: int):
        """The vertices that a handle is made of.  [1 or 4] ids"""
        count = len(self._whole.pins)
        return np.array([handle]) if handle < count else self.points.corners[handle - count]

    def factors(self, ids):
        """Factors of the stiffness at these control points.  [len(ids)]"""
        factors, chosen = self._whole.body.factors, np.asarray(ids) - len(self._whole.pins)
        return self.points.share(factors)[chosen]

    def patch(self, handle: int, radius: float):
        """The vertices that go with a handle: its own, and those within a radius at rest.  [K]"""
        rest = self._whole.field.mesh.rest_vertices
        (center,) = self.at([handle], rest)
        return np.union1d(self.corners(handle), vertices_within(rest, center, radius))

    # -- selection -----------------------------------------------------------------------

    def select(self, ids, how: str = "replace") -> None:
        """Change what is selected: replace, add, remove, intersect, or toggle."""
        ids, old = [int(one) for one in ids], self.selected
        kept = [one for one in old if one not in ids]
        new = [one for one in ids if one not in old]
        self._select(
            {
                "replace": ids,
                "add": old + new,
                "remove": kept,
                "intersect": [one for one in old if one in ids],
                "toggle": kept + new,
            }[how]
        )

    @edit("select")
    def _select(self, ids):
        self.selected = [one for one in ids if self.exists(one)]

    def forget_deleted(self) -> None:
        """Select and point at nothing that was deleted."""
        left = {*self.control_ids.tolist(), *self.pin_ids.tolist()}
        self.selected, self.hover = [one for one in self.selected if one in left], None
        vertices, points = self._whole.cuts.vertices, self._whole.cuts.points_left()
        there = np.concatenate([vertices, points])
        self._posed = tuple(one for one in self._posed if there[one])

    def hide(self) -> int:
        """Hide the selected handles; returns how many that are."""
        hidden = list(self.selected)
        if hidden:
            self._hide([*self.hidden, *hidden])
            self._select([])
        return len(hidden)

    def unhide(self) -> None:
        if self.hidden:
            self._hide([])

    @edit("hide", undo="hide points")
    def _hide(self, ids):
        self.hidden = sorted(set(ids))

    def name(self, handle: int, text: str) -> None:
        """Give a handle a name; an empty one takes it away."""
        self._name(handle, clean_name(text))

    @edit("name", undo="name", merges=True)
    def _name(self, vertex, text):
        self.names = {key: value for key, value in self.names.items() if key != vertex}
        if text:
            self.names[vertex] = text

    def title(self, handle: int) -> str:
        """A handle's name; else its number among the vertices, or among the control points."""
        number = handle - len(self._whole.pins)
        return self.names.get(handle) or (f"vertex {handle}" if number < 0 else f"point {number}")

    @property
    def movable(self) -> list[int]:
        """What is selected and can be dragged."""
        free = set(self.control_ids.tolist())
        return [one for one in self.selected if one in free]

    @property
    def takeable(self) -> list[int]:
        """What is selected and can be taken by `grab_selected`: pins, too."""
        pins = (one for one in self.selected if one not in self.hidden and self.is_pinned(one))
        takeable = {*self.movable, *pins}
        return [one for one in self.selected if one in takeable]

    # -- a drag --------------------------------------------------------------------------

    def grab(self, handle: int) -> None:
        """Take hold of a handle and of what is around it; of all that is selected, if it is."""
        others = [one for one in self.movable if one != handle]
        if handle in self.selected and others:
            self._grab_several(handle, others, *self._way)
        else:
            self._grab(handle, *self._way)

    @property
    def _way(self):
        """How a hand takes hold now: the radius [model units], and whether by springs."""
        return self._whole.grab_radius, self._whole.settings.soft_grab

    def grab_selected(self) -> None:
        """Take hold of all that is selected; pins are freed, and pinned again when let go."""
        chosen = self.takeable
        if len(chosen) == len(self.movable):
            self.grab(chosen[0])
        else:
            self._grab_pins(chosen[0], chosen[1:], *self._way)

    @edit("grab_pins", undo="drag", begins=True)
    def _grab_pins(self, vertex, others, radius, soft):
        self._hold([vertex, *others], radius, soft, takes_pins=True)

    @edit("grab", undo="drag", begins=True)
    def _grab(self, vertex, radius, soft):
        self._hold([vertex], radius, soft)

    def grab_place(self, place) -> None:
        """Take hold of the object at a place of its surface as it is now.  [3]"""
        self._grab_place(*self._located(place), *self._way)

    @edit("grab_place", undo="drag", begins=True)
    def _grab_place(self, corners, weights, radius, soft):
        self._add_point(corners, weights)
        self._hold([self._last_point], radius, soft)
        self.grabbed.passing = True

    @edit("grab_several", undo="drag", begins=True)
    def _grab_several(self, vertex, others, radius, soft):
        self._hold([vertex, *others], radius, soft)

    def _hold(self, handles, radius, soft, takes_pins=False):
        if not all(map(self.exists, handles)):
            raise ValueError(f"there is no handle {max(handles)}")
        stood = self._whole.timeline.stands
        self._whole.timeline.give_way()
        solver = self._whole.solver
        positions, velocities = solver.vertices.numpy().copy(), solver.velocities.numpy().copy()
        posed = set(handles) & set(self.posed)
        pins = {one for one in handles if takes_pins and self.is_pinned(one)} - posed
        held_before = (solver.pinned, self.patches) if posed | pins else None
        if posed | pins:
            self._free(posed | pins)
        places = self.at(handles, positions)
        motion = Motion(places[0], places.mean(axis=0) - places[0])
        yields = math.isfinite(self._whole.body.material.yield_strain)
        self.grabbed = Grab(
            *(handles, soft, places[0], motion, motion),
            before=(positions, velocities),
            rest_lengths=solver.rest_lengths if yields else None,
            stood=stood,
            first_radius=radius,
            held_before=held_before,
            pins=sorted(pins),
        )
        self._attach(radius, positions)

    def _attach(self, radius, positions):
        """Hold what is within a radius of the handles, as it is now."""
        grab, solver = self.grabbed, self._whole.solver
        ids = np.unique(np.concatenate([self.patch(one, radius) for one in grab.handles]))
        ids = ids[~solver.pinned[ids]]
        springs = ()
        if grab.soft:
            rest = self._whole.field.mesh.rest_vertices
            ids, springs = soft_springs(solver, self.at(grab.handles, rest), ids, radius)
        self._whole.grip.grab(ids, *springs)
        grab.ids, grab.radius = ids, radius
        grab.offsets = grab.reached.undone(positions[ids])

    def widen(self, factor: float) -> None:
        """Hold more or less than until now, around the same handles."""
        radius = self.grabbed.radius / self._whole.size * factor
        smallest = 0.5 * self._whole.handle_radius / self._whole.size
        self._whole.settings.grab_radius = min(max(radius, smallest), GRAB_RADII[1])
        self._widen(self._whole.grab_radius)

    @edit("widen")
    def _widen(self, radius):
        if self.grabbed is not None:
            self._whole.grip.release()
            self._attach(radius, self._whole.solver.vertices.numpy().copy())

    def drag_to(self, target) -> None:
        """Send the grabbed handle to a point [3]; exact grabs reach it in the next frame."""
        self.grabbed.target = self.grabbed.target.moved(target)

    def turn_to(self, rotation, scale: float, stretch=None) -> None:
        """Turn and scale what is held about its center.

        Args:
            rotation: Axis times angle [radians], from how it was grabbed.  [3]
            stretch: Before it is turned, symmetric and positive definite.  [3, 3]
        """
        self.grabbed.target = self.grabbed.target.turned(rotation, scale, stretch)

    @property
    def behind(self) -> bool:
        """Whether what is held is not yet where it was sent."""
        return self.grabbed is not None and self.grabbed.target != self.grabbed.reached

    def follow(self, share: float = 1.0) -> None:
        """Move what is held by a share of the way to where it was sent, if that is anywhere."""
        if self.behind and np.isfinite(self.grabbed.target.place).all():
            motion = self.grabbed.reached.towards(self.grabbed.target, share)
            if motion.plain and self.grabbed.reached.plain:
                self._move(motion.place)
            elif motion.stretch is None:
                self._transform(motion.place, motion.rotation, motion.scale)
            else:
                self._stretch(motion.place, motion.rotation, motion.scale, motion.stretch)

    @edit("move")
    def _move(self, to):
        self._reach(to)

    @edit("transform")
    def _transform(self, to, rotation, scale):
        self._reach(to, rotation, scale)

    @edit("stretch")
    def _stretch(self, to, rotation, scale, stretch):
        self._reach(to, rotation, scale, stretch)

    def _reach(self, to, *turn):
        """Move what is held, if anything is, and turn it as Motion.turned says."""
        grab = self.grabbed
        if grab is not None:
            moved = grab.reached.moved(to)
            grab.reached = moved.turned(*turn) if turn else moved
            self._whole.grip.move(grab.reached.applied(grab.offsets))

    @edit("release")
    def release(self) -> None:
        if self.grabbed is not None:
            self._whole.grip.release()
            if self.grabbed.passing:
                self.points = self.points.without_last()
                self.selected = [one for one in self.selected if self.exists(one)]
            self.grabbed = None

    def _pin_held(self, radius, pins_alone=False):
        """Let go, and pin what was held, or the pins of it alone; returns the grab, if any."""
        grab = self.grabbed
        if grab is not None:
            grab.passing = False  # the point by which it was held stays
        self.release()
        for handle in [] if grab is None else grab.pins if pins_alone else grab.handles:
            self._set_pin(handle, True, radius)
        return grab

    def let_go(self) -> None:
        """Let go of what is held; in *Pose* it stays where it is, and what was pinned always."""
        if self._whole.settings.hand == "pose":
            self._pose_grab(self._pin_radius)
        elif self.grabbed is not None and self.grabbed.pins:
            self._pin_again(self._pin_radius)
        else:
            self.release()

    @edit("pose_grab")
    def _pose_grab(self, radius):
        grab = self._pin_held(radius)
        if grab is not None:
            self._posed = (*self._posed, *(one for one in grab.handles if one not in grab.pins))

    @edit("pin_again")
    def _pin_again(self, radius):
        self._pin_held(radius, pins_alone=True)

    @edit("choose_hand", undo="{hand}")
    def choose_hand(self, hand: str) -> None:
        """Choose one of HANDS."""
        self._whole.settings.hand = hand

    @edit("cancel")
    def cancel(self) -> None:
        """Let go; pose, velocities and a time that stood still are as before the grab."""
        whole, grab = self._whole, self.grabbed
        self.release()
        if grab is None:
            return
        whole.settings.grab_radius = grab.first_radius / whole.size
        self.journal.forget_step("drag")
        if grab.held_before is not None:
            pinned, self.patches = grab.held_before
            whole.solver.set_pinned(pinned)
        whole.solver.set_state(*grab.before)
        if grab.rest_lengths is not None:
            whole.solver.set_rest_lengths(grab.rest_lengths)
        if grab.stood:
            whole.timeline.stand()
        whole.revision += 1

    # -- pins ----------------------------------------------------------------------------

    @property
    def _pin_radius(self):
        return self._whole.grab_radius * (PATCH_PART if self._whole.settings.soft_grab else 1.0)

    def pin_grab(self) -> None:
        """Let go, and pin the patch that was held where it is."""
        self._pin_grab(self._pin_radius)

    @edit("pin_grab", undo="pin what was held")
    def _pin_grab(self, radius):
        self._pin_held(radius)

    def set_pin(self, handle: int, pinned: bool) -> None:
        """Pin a handle and its patch where they are; or free it, and what was pinned with it."""
        self._set_pin(handle, pinned, self._pin_radius)

    def is_pinned(self, handle: int) -> bool:
        return bool(self._whole.solver.pinned[self.corners(handle)].all())

    def set_pins(self, handles: list[int], pinned: bool) -> None:
        """Pin several handles with their patches, or free them, as one step."""
        self._set_pins(list(handles), pinned, self._pin_radius)

    @edit("set_pins", undo="pins")
    def _set_pins(self, ids, pinned, radius):
        for handle in ids:
            self._set_pin(handle, pinned, radius)

    @edit("set_pin", undo="pins")
    def _set_pin(self, vertex, pinned, radius):
        if not self.exists(vertex):
            raise ValueError(f"there is no handle {vertex}")
        whole = self._whole
        whole.timeline.stop()  # the next key would set other pins
        if pinned:
            pins, patch = whole.solver.pinned.copy(), self.patch(vertex, radius)
            patch = patch[~pins[patch]]
            self._number(patch, self.patches.max() + 1)
            pins[patch] = True
            whole.solver.set_pinned(pins)
            self._posed = tuple(one for one in self._posed if one != vertex)
        else:
            self._free([vertex])
        self.hover = None
        whole.keep_in_sight()

    def _free(self, handles):
        """Free the patches of these handles."""
        pins = self._whole.solver.pinned.copy()
        for handle in handles:
            number = self.patches[self.corners(handle)].max()
            patch = self.patches == number if number else self.corners(handle)
            pins[patch] = False
            self._number(patch, 0)
        self._whole.solver.set_pinned(pins)

    def _number(self, patch, number):
        """Give these vertices a number, ids or a mask [V]; 0: they are of no patch any more."""
        self.patches = self.patches.copy()
        self.patches[patch] = number

    def free_posed(self) -> None:
        """Let all posed handles go."""
        if self.posed:
            self._free(self.posed)

    def forget_patches(self) -> None:
        """The object was pinned or freed as a whole; what is posed stays so while it is held."""
        self._number(~self._posed_vertices, 0)

    # -- more points ---------------------------------------------------------------------

    def add_point(self, place) -> int:
        """Make a control point at a place of the surface as it is now [3]; returns its id."""
        self._add_point(*self._located(place))
        return self._last_point

    @property
    def _last_point(self):
        """The id of the control point that was added last."""
        return len(self._whole.pins) + len(self.points) - 1

    def _located(self, place):
        """Corners and weights of a place in its tet.  [4], [4]"""
        tets = self._whole.field.mesh.tets
        point = located([place], self._whole.solver.vertices.numpy(), tets)
        return point.corners[0], point.weights[0]

    @edit("add_point", undo="new point")
    def _add_point(self, corners, weights):
        if len(self.points) >= MOST_ADDED:
            raise ValueError(f"{MOST_ADDED} control points are the most")
        weights = np.array(weights, float).reshape(1, 4)
        self.points = self.points.joined(ControlPoints(np.array(corners).reshape(1, 4), weights))

    # -- undo ----------------------------------------------------------------------------

    def state(self) -> dict:
        state = super().state() | {"hand": self._whole.settings.hand}
        if self.grabbed is not None and self.grabbed.passing:
            state["points"] = self.points.without_last()
        return state

    def restore(self, state: dict) -> None:
        super().restore(state)
        self._whole.settings.hand = state["hand"]
        self.selected = [one for one in self.selected if self.exists(one)]
        self.hover = None
