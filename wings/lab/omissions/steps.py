"""Omissions in dynamics, measured on two solvers, one with and one without what is left out.

Both solvers get the same drag: the highest vertices of the largest part, grabbed as in the
viewer, swing from side to side, one step of 1/60 s per turn.  Poses are compared after the
drag was held still for two seconds, in object sizes: the longest side at rest.

Shapes: V vertices, K handles.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from ....core.deform import (
    EACH_HOLDS,
    LOWEST_POISSON_RATIO,
    TIME_STEP,
    Material,
    XpbdOptions,
    XpbdSolver,
    lowest_pins,
    vertices_within,
    volume_constraints,
)
from ....core.field import TetField
from ....core.geometry import components
from ..stopwatch import compared
from .switch import DYNAMICS, Switch, pose_change

GRAB_RADIUS = 0.08  # object sizes, the viewer's
SWING = 0.1  # object sizes, to each side
PERIOD = 90  # frames
HELD_FRAMES = 120
NEVER = 10**9  # frames
NO_STIFFNESS = 1e20  # compliance of volume constraints that do nothing [m⁵/N]
EARTH = 9.81  # m/s²


class DraggedSolver:
    """A solver whose object is dragged from side to side by `handles`, vertex ids [K]."""

    def __init__(self, field: TetField, device, material=None, **options):
        mesh, material, options = field.mesh, material or Material(), XpbdOptions(**options)
        pins = lowest_pins(mesh.rest_vertices, mesh.tets)
        self.solver = XpbdSolver(mesh.rest_vertices, mesh.tets, material, pins, options, device)
        size, rest = self.solver.object_size, self.solver.rest_vertices
        labels = components(mesh.vertex_count, mesh.tets)
        part = np.flatnonzero(labels == np.bincount(labels).argmax())
        ids = vertices_within(rest, part[rest[part, 2].argmax()], GRAB_RADIUS * size)
        self.handles = ids[(labels[ids] == labels[part[0]]) & ~pins[ids]]
        self.solver.grab(self.handles)
        self._frame = 0

    def let_go(self, may_sleep=True):
        """Bring the object to rest, without a grab."""
        self.handles = self.handles[:0]
        self.solver.release()
        self.solver.reset()
        if not may_sleep:  # it fell asleep
            self.solver.set_options(replace(self.solver.options, sleep_frames=NEVER))
        return self

    def turn(self):
        """Swing on for 1/60 s."""
        self._frame += 1
        self._step()

    def held_pose(self):
        """The pose after the swing was held where it is.  [V, 3]"""
        for _ in range(HELD_FRAMES):
            self._step()
        return self.solver.vertices.numpy()

    def _step(self):
        if len(self.handles):
            away = SWING * self.solver.object_size * math.sin(2.0 * math.pi * self._frame / PERIOD)
            self.solver.move(self.solver.rest_vertices[self.handles] + [away, 0.0, 0.0])
        self.solver.step(TIME_STEP)


def step_switches(field: TetField, device, turns: int) -> list[Switch]:
    """The switches of a step of the solver."""
    drag, mesh = partial(DraggedSolver, field, device), field.mesh

    def switch(name, with_it, without, why):
        def measure():
            one, other = with_it(), without()
            times = compared(one.turn, other.turn, device, turns)
            size = one.solver.object_size
            return times, pose_change(one.held_pose(), other.held_pose(), size)

        return Switch(name, DYNAMICS, "ms", why, measure)

    lowest = float(mesh.rest_vertices[:, 2].min())
    found = [
        *_volumes(mesh, drag, switch),
        switch(
            "the solver while nothing moves",
            lambda: drag().let_go(may_sleep=False),
            lambda: drag().let_go(),
            "At rest, and with nothing grabbed, a step ends where it began, to within rounding.",
        ),
        switch(
            "gravity and a ground",
            lambda: drag(gravity=(0.0, 0.0, -EARTH), ground=lowest),
            drag,
            "The object is photographed as it stands, and gravity would bend it once more. It is"
            " off until the user asks for it.",
        ),
    ]
    labels = components(mesh.vertex_count, mesh.tets)
    sizes = np.bincount(labels)
    if len(sizes) > 1:

        def awake():
            dragged = drag()
            dragged.solver.set_options(dragged.solver.options)  # which wakes every part
            return dragged

        name = f"parts without a handle ({len(sizes) - 1} of {len(sizes)})"
        aside = 100.0 * (labels[mesh.tets[:, 0]] != sizes.argmax()).mean()
        why = (
            f"Nothing moves them. They have {aside:.1f} % of the tets; the solver looks for them"
            " once a grab, not in a frame."
        )
        found.append(switch(name, awake, drag, why))
    return found


def _volumes(mesh, drag, switch):
    """The switches of volume constraints."""

    def with_volumes(material, compliances_of):
        dragged = drag(material=material)
        edges, _ = dragged.solver.compliances
        dragged.solver.set_compliances(edges, compliances_of(dragged.solver.volumes))
        return dragged

    def all_hold(volumes):
        return volumes.compliances(usual.bulk_modulus, EACH_HOLDS * usual.shear_modulus)

    usual, quarter = Material(), Material(poisson_ratio=LOWEST_POISSON_RATIO)
    found = [
        switch(
            "volume constraints at a Poisson's ratio of 1/4",
            lambda: with_volumes(quarter, lambda volumes: NO_STIFFNESS),
            lambda: drag(material=quarter),
            "Edges alone represent that ratio, so volumes have nothing to add.",
        )
    ]
    shared = (volume_constraints(mesh.rest_vertices, mesh.tets).shares == 0.0).mean()
    if shared:  # on A15
        name = f"volume constraints of {100.0 * shared:.0f} % of the tets"
        why = (
            "Their neighbors hold their volume as well, and the body bends less stiffly for it. All"
            " tets do so where some tet was turned inside out."
        )
        found.append(switch(name, lambda: with_volumes(usual, all_hold), drag, why))
    return found
