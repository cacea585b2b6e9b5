"""Omissions in dynamics, measured on two solvers, one with and one without the part.

Both solvers get the same drag: the highest vertices of the largest component, grabbed as in
the viewer, swing from side to side, one step of 1/60 s per turn.  To compare poses at rest,
they are then held still for two seconds.  Differences are in object sizes, the longest side
at rest.

Shapes: V vertices.
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
from .measure import Switch, pose_change

GRAB_RADIUS = 0.08  # object sizes, the viewer's
SWING = 0.1  # object sizes, to each side
PERIOD = 90  # frames
HELD_FRAMES = 120
NEVER = 10**9  # frames
NO_STIFFNESS = 1e20  # compliance of volume constraints that do nothing [m⁵/N]
SPRINGS = 4.0  # stiffness of all springs of a soft grab together, in E times the size
EARTH = 9.81  # m/s²


class Drag:
    """A solver whose object is dragged from side to side by `handles`, vertex ids [K]."""

    def __init__(self, field: TetField, device, material=None, options=None, soft=False):
        mesh, material, options = field.mesh, material or Material(), options or XpbdOptions()
        pins = lowest_pins(mesh.rest_vertices, mesh.tets)
        self.solver = XpbdSolver(mesh.rest_vertices, mesh.tets, material, pins, options, device)
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

    def turn(self):
        """Swing on for 1/60 s."""
        self._frame += 1
        self._step()

    def hold(self):
        """Stay where the swing is."""
        for _ in range(HELD_FRAMES):
            self._step()

    @property
    def vertices(self):
        """The present pose.  [V, 3]"""
        return self.solver.vertices.numpy()

    def _step(self):
        if len(self.handles):
            away = SWING * self.solver.object_size * math.sin(2.0 * math.pi * self._frame / PERIOD)
            self.solver.move(self.solver.rest_vertices[self.handles] + [away, 0.0, 0.0])
        self.solver.step(TIME_STEP)


def change(with_it: Drag, without: Drag) -> str:
    """The difference of their poses, in words."""
    return pose_change(with_it.vertices, without.vertices, with_it.solver.object_size)


def change_at_rest(with_it: Drag, without: Drag) -> str:
    """The difference of their poses after the handles were held still, in words."""
    with_it.hold()
    without.hold()
    return change(with_it, without)


def step_switches(field: TetField, device) -> list[Switch]:
    """The switches to measure."""
    drag = partial(Drag, field, device)
    mesh, usual = field.mesh, Material()
    quarter = Material(poisson_ratio=LOWEST_POISSON_RATIO)
    lowest = float(mesh.rest_vertices[:, 2].min())
    around = XpbdOptions(gravity=(0.0, 0.0, -EARTH), ground=lowest)
    parts = components(mesh.vertex_count, mesh.tets)
    count, largest = int(parts.max()) + 1, np.bincount(parts).argmax()  # which the handles are in
    for_others = (volume_constraints(mesh.rest_vertices, mesh.tets).shares == 0.0).mean()
    aside = 100.0 * (parts[mesh.tets[:, 0]] != largest).mean()

    def with_volumes(material, compliance):
        dragged = drag(material=material)
        edges = dragged.solver.edges.compliances(material.shear_modulus)
        dragged.solver.set_compliances(edges, compliance)
        return dragged

    def with_all_volumes():
        dragged = drag()
        each = EACH_HOLDS * usual.shear_modulus
        return with_volumes(usual, dragged.solver.volumes.compliances(usual.bulk_modulus, each))

    def with_options(dragged, **options):
        dragged.solver.set_options(replace(dragged.solver.options, **options))
        return dragged

    def resting():
        dragged = drag()
        dragged.handles = dragged.handles[:0]
        dragged.solver.release()
        dragged.solver.reset()
        return dragged

    return [
        Switch(
            "volume constraints at a Poisson's ratio of 1/4",
            lambda: with_volumes(quarter, NO_STIFFNESS),
            lambda: drag(material=quarter),
            "Edges alone represent that ratio, so volumes have nothing to add.",
        ),
        Switch(
            f"volume constraints of {100 * for_others:.0f} % of the tets",
            with_all_volumes,
            drag,
            "Their neighbors hold their volume as well, and the body bends less stiffly for it. All"
            " tets do so where some tet was turned inside out.",
            change=change_at_rest,
            missing="" if for_others else "The mesh isn't of A15: each tet holds its own volume.",
        ),
        Switch(
            f"volume constraints at a Poisson's ratio of {usual.poisson_ratio}",
            lambda: drag(material=usual),
            lambda: with_volumes(usual, None),
            "They are kept: at the default ratio they are a part of the material, and without them"
            " the object comes to rest in another pose.",
            left_out=False,
            change=change_at_rest,
        ),
        Switch(
            f"components without a handle ({count - 1} of {count})",
            lambda: with_options(drag()),  # any change of options wakes every part
            drag,
            f"Nothing moves them. They have {aside:.1f} % of the tets; the solver looks for them"
            " once a grab, not in a frame.",
            missing="" if count > 1 else "The object is one component: there is none to leave out.",
        ),
        Switch(
            "the solver while nothing moves",
            lambda: with_options(resting(), sleep_frames=NEVER),
            resting,
            "At rest, and with nothing grabbed, a step ends where it began, to within rounding.",
        ),
        Switch(
            "gravity and a ground",
            lambda: drag(options=around),
            drag,
            "The object is photographed as it stands, and gravity would bend it once more. It is"
            " off until the user asks for it.",
            change=change_at_rest,
        ),
        Switch(
            "springs that pull the handles",
            lambda: drag(soft=True),
            drag,
            "An exact grab is where the mouse is, and springs lag behind it. There are only as"
            " many springs as handles; users may ask for them.",
            change=change_at_rest,
        ),
    ]
