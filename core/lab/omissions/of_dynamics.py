"""What dynamics leave out, measured on two solvers of which one does without.

Both take the same drag: the highest vertices of the largest part, held as the viewer holds
them, swing from side to side, a step of 1/60 s a turn.  Where a pose at rest decides, they are
then held still for two seconds.  Differences are in object sizes, the longest side at rest.

Shapes: V vertices.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...deform import (
    LOWEST_POISSON_RATIO,
    TIME_STEP,
    Material,
    XpbdOptions,
    XpbdSolver,
    lowest_pins,
    vertices_within,
)
from ...field import TetField
from ...geometry import components
from ..stopwatch import compared
from .rows import DYNAMICS, Omission, not_measured, omission, pose_change

GRAB_RADIUS = 0.08  # object sizes, the viewer's
SWING = 0.1  # object sizes, to each side
PERIOD = 90  # frames
HELD_FRAMES = 120
NEVER = 10**9  # frames
NO_STIFFNESS = 1e20  # compliance of volume constraints that do nothing [m⁵/N]
SPRINGS = 4.0  # stiffness of all springs of a soft grab together, in E times the size
EARTH = 9.81  # m/s²


class Drag:
    """A solver, and something that drags at its object.

    Attributes:
        handles: Vertex ids [K]; none where everything is pinned.
    """

    def __init__(self, field: TetField, device, material=None, options=None, soft=False):
        mesh = field.mesh
        pins = lowest_pins(mesh.rest_vertices, mesh.tets)
        self.solver = XpbdSolver(
            *(mesh.rest_vertices, mesh.tets, material or Material(), pins),
            *(options or XpbdOptions(), device),
        )
        size, rest = self.solver.object_size, self.solver.rest_vertices
        parts = components(mesh.vertex_count, mesh.tets)
        part = np.flatnonzero(parts == np.bincount(parts).argmax())
        ids = vertices_within(rest, part[rest[part, 2].argmax()], GRAB_RADIUS * size)
        self.handles = ids[(parts[ids] == parts[part[0]]) & ~pins[ids]]
        stiffness = None
        if soft:
            held = self.solver.held_young_modulus()
            stiffness = SPRINGS * held * size / max(len(self.handles), 1)
        self.solver.grab(self.handles, stiffness)
        self._frame = 0

    def step(self):
        """Swing on for 1/60 s."""
        self._frame += 1
        self._step()

    def hold(self, frame_count=HELD_FRAMES):
        """Stay where the swing is."""
        for _ in range(frame_count):
            self._step()
        return self

    @property
    def vertices(self):
        """The present pose.  [V, 3]"""
        return self.solver.vertices.numpy()

    def _step(self):
        if len(self.handles):
            away = SWING * self.solver.object_size * math.sin(2.0 * math.pi * self._frame / PERIOD)
            self.solver.move(self.solver.rest_vertices[self.handles] + [away, 0.0, 0.0])
        self.solver.step(TIME_STEP)


class Steps:
    """Steps of two solvers on one field that take turns."""

    def __init__(self, field: TetField, device, repeats: int):
        self.field, self.device, self.repeats = field, device, repeats

    def drag(self, **settings) -> Drag:
        return Drag(self.field, self.device, **settings)

    def row(self, name, with_it: Drag, without: Drag, why, otherwise, at_rest=False, **kind):
        """Measure a row.

        Args:
            at_rest: Compare poses after the handles were held still.
        """
        times = compared(with_it.step, without.step, self.device, self.repeats)
        poses = [drag.hold() if at_rest else drag for drag in (with_it, without)]
        change = pose_change(*(drag.vertices for drag in poses), with_it.solver.object_size)
        return omission(name, DYNAMICS, times, change, why, otherwise, **kind)


def idle_volumes(steps: Steps) -> Omission:
    """Volume constraints at ν = 1/4, which edges alone represent."""
    quarter = Material(poisson_ratio=LOWEST_POISSON_RATIO)
    with_it, without = (steps.drag(material=quarter) for _ in range(2))
    edges = with_it.solver.edges.compliances(quarter.shear_modulus)
    with_it.solver.set_compliances(edges, NO_STIFFNESS)
    return steps.row(
        "volume constraints at a Poisson's ratio of 1/4",
        with_it,
        without,
        "Edges alone represent that ratio, so volumes have nothing to add.",
        "They have nothing to add at that ratio, and projecting them costs nothing here: the"
        " object has too few tets.",
    )


def volumes(steps: Steps) -> Omission:
    """Volume constraints of the default material."""
    material = Material()
    with_it, without = (steps.drag(material=material) for _ in range(2))
    without.solver.set_compliances(without.solver.edges.compliances(material.shear_modulus), None)
    reason = (
        f"They are kept: at a ratio of {material.poisson_ratio}, the default, they are a part of"
        " the material, and the pose that it comes to rest in is another one without."
    )
    return steps.row(
        f"volume constraints at a Poisson's ratio of {material.poisson_ratio}",
        with_it,
        without,
        reason,
        reason,
        at_rest=True,
        left_out=False,
    )


def untouched_parts(steps: Steps) -> Omission:
    """Components that no handle is in."""
    mesh = steps.field.mesh
    parts = components(mesh.vertex_count, mesh.tets)
    count = int(parts.max()) + 1
    name = f"components without a handle ({count - 1} of {count})"
    if count == 1:
        none = "The object is one component, so there is none to leave out."
        return not_measured(name, DYNAMICS, none, left_out=False)
    largest = np.bincount(parts).argmax()  # which the handles are in
    share = 100.0 * (parts[mesh.tets[:, 0]] != largest).mean()
    with_it, without = steps.drag(), steps.drag()
    with_it.solver.set_options(with_it.solver.options)  # whatever changes wakes every part
    return steps.row(
        name,
        with_it,
        without,
        f"Nothing moves what no handle is in, {share:.1f} % of the tets.",
        f"The components without a handle have {share:.1f} % of the tets, too few to count. They"
        " stay out because nothing moves them, and asking is done once a grab, not in a frame.",
    )


def sleeping(steps: Steps) -> Omission:
    """Steps while nothing moves."""
    with_it, without = steps.drag(), steps.drag()
    for drag in (with_it, without):
        drag.handles = drag.handles[:0]
        drag.solver.release()
        drag.solver.reset()
    with_it.solver.set_options(replace(with_it.solver.options, sleep_frames=NEVER))
    return steps.row(
        "the solver while nothing moves",
        with_it,
        without,
        "At rest, and with nothing grabbed, a step leads to where it began, to within rounding.",
        "The object has so few constraints that a step costs nothing.",
    )


def gravity(steps: Steps) -> Omission:
    """Gravity, and a ground under the object."""
    lowest = float(steps.field.mesh.rest_vertices[:, 2].min())
    around = XpbdOptions(gravity=(0.0, 0.0, -EARTH), ground=lowest)
    return steps.row(
        "gravity and a ground",
        steps.drag(options=around),
        steps.drag(),
        "The object is photographed as it stands; gravity would bend that shape once more. It is"
        " off until the user asks for it.",
        "Not for time: one addition and one comparison a vertex are lost beside its constraints."
        " The object is photographed as it stands, and gravity would bend that shape once more.",
        at_rest=True,
    )


def springs(steps: Steps) -> Omission:
    """Springs between the handles and where they are to go."""
    return steps.row(
        "springs that pull the handles",
        steps.drag(soft=True),
        steps.drag(),
        "What is grabbed exactly is where the mouse is, and needs no projection.",
        "Not for time: there are only as many springs as handles. What is grabbed exactly is"
        " where the mouse is; springs stay behind it, and are there for whoever asks for them.",
        at_rest=True,
    )


DYNAMICS_ROWS: list[Callable[[Steps], Omission]] = [
    *(idle_volumes, volumes, untouched_parts, sleeping, gravity, springs)
]
