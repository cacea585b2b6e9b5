"""What layers take of the object that they draw."""

from typing import Protocol

import numpy as np

from ...core.deform import XpbdSolver
from ...core.field import TetField
from ..camera import Orbit
from ..document import Ball, Body, Grab
from ..settings import Settings


class SeenFrom(Protocol):
    """Where the object is seen from."""

    orbit: Orbit
    depth_range: tuple[float, float]


class RemainingSubtets(Protocol):
    """What was not deleted."""

    some: bool  # whether anything was
    revision: int
    field: TetField
    left: np.ndarray  # sub-tets  [T] uint64
    kept: np.ndarray  # another array where tets were deleted  [T] bool
    tets: np.ndarray  # [T', 4]
    neighbours: np.ndarray  # [T', 4]


class DrawnHandles(Protocol):
    """Handles, and what a hand does with them."""

    pin_ids: np.ndarray
    control_ids: np.ndarray
    posed: tuple[int, ...]
    selected: list[int]
    hover: int | None
    grabbed: Grab | None

    def at(self, ids) -> np.ndarray: ...
    def factors(self, ids) -> np.ndarray: ...


class DrawnRig(Protocol):
    """Bones, and the joints that a hand has chosen and begun."""

    skeleton: object | None  # of wings.rig
    selected: tuple[int, str] | None
    chosen_bone: int | None
    loose: np.ndarray | None  # [3]


class DrawnPose(Protocol):
    """Where a pose has the bones."""

    ends: np.ndarray  # another array where they moved  [B, 2, 3]
    drives: bool  # whether the bones move the object
    shows_vertices: bool  # whether the pose is a clip's of vertices, not the bones'


class DrawnObject(Protocol):
    """The object that is drawn."""

    field: TetField
    settings: Settings
    viewpoint: SeenFrom
    positions: np.ndarray  # of the vertices  [V, 3]
    revision: int  # of the positions
    size: float
    center: np.ndarray  # at rest  [3]
    held: bool
    stands: bool  # as if on a ground
    floor: float  # where a ground would be
    handle_radius: float
    handle_bias: float
    ball: Ball | None
    body: Body
    solver: XpbdSolver
    cuts: RemainingSubtets
    handles: DrawnHandles
    rigging: DrawnRig
    posing: DrawnPose
