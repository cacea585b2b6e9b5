"""What the mouse holds: patches of vertices, exactly or by springs, or a ball that pushes.

Shapes: V vertices, K vertices that are held.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ....core.deform import falloff

# A patch of radius R of an elastic body with Young's modulus E (the one that the substeps
# hold) resists a pull like a spring of at most 2 E R: 0.8 E times the size for the largest
# grab radius.  Springs of 4 E times the size together therefore follow the mouse closely.
# Their force is limited to that of the patch at an eighth of the size, since what is thin
# would be torn long by more.
SOFT_STIFFNESS = 4.0  # of all springs of a drag together, in E times the object's size
SOFT_FORCE = 0.25  # of all of them, in E R times the object's size
LEAST_PULL = 1e-3  # of the strongest spring; weaker ones are left out


@dataclass(frozen=True, eq=False)
class Motion:
    """How far something that is held has gone: to a place, turned and scaled about a center.

    It is stretched first, then turned.
    """

    place: np.ndarray  # of the handle under the mouse, if nothing turns  [3]
    center: np.ndarray  # about which it turns, as an offset from the place  [3]
    rotation: np.ndarray = field(default_factory=lambda: np.zeros(3))  # axis times angle
    scale: float = 1.0
    stretch: np.ndarray | None = None  # symmetric, positive definite; None: none  [3, 3]

    def __eq__(self, other):
        same = (self.place == other.place).all() and (self.rotation == other.rotation).all()
        stretches = np.array_equal(self._stretch, other._stretch)
        return bool(same) and self.scale == other.scale and stretches

    @property
    def _stretch(self):
        return np.eye(3) if self.stretch is None else self.stretch

    @property
    def plain(self) -> bool:
        """Whether nothing is turned or scaled."""
        return not self.rotation.any() and self.scale == 1.0 and self.stretch is None

    def moved(self, place) -> "Motion":
        return replace(self, place=np.asarray(place, float))

    def turned(self, rotation, scale: float, stretch=None) -> "Motion":
        stretch = None if stretch is None else np.asarray(stretch, float)
        rotation = np.asarray(rotation, float)
        return replace(self, rotation=rotation, scale=float(scale), stretch=stretch)

    def towards(self, other: "Motion", share: float) -> "Motion":
        """A share of the way to another one; it turns the shorter way."""
        if share == 1.0:
            return other
        place = self.place + share * (other.place - self.place)
        turn, now = rotation_matrix(other.rotation), rotation_matrix(self.rotation)
        rotation = rotation_vector(rotation_matrix(share * rotation_vector(turn @ now.T)) @ now)
        stretch = None
        if self.stretch is not None or other.stretch is not None:
            stretch = self._stretch + share * (other._stretch - self._stretch)
        scale = self.scale + share * (other.scale - self.scale)
        return replace(self, place=place).turned(rotation, scale, stretch)

    def applied(self, offsets):
        """Where what is held goes to.  offsets [K, 3]: from the place, unturned; -> [K, 3]"""
        if self.plain:
            return self.place + offsets
        away = offsets - self.center
        if self.stretch is not None:
            away = away @ self.stretch
        turned = self.scale * away @ rotation_matrix(self.rotation).T
        return self.place + self.center + turned

    def undone(self, positions):
        """The offsets of what is at these positions [K, 3] now."""
        if self.plain:
            return positions - self.place
        away = (positions - self.place - self.center) @ rotation_matrix(self.rotation)
        if self.stretch is not None:
            away = np.linalg.solve(self.stretch, away.T).T
        return self.center + away / self.scale


def stretched(motion: Motion, way, bounds):
    """Rotation [3] and stretch [3, 3] of a motion that is stretched further (polar decomposition).

    Args:
        way: The further stretch, in model space, symmetric.  [3, 3]
        bounds: Of the principal stretches.
    """
    left, sizes, right = np.linalg.svd(way @ rotation_matrix(motion.rotation) @ motion._stretch)
    stretch = right.T @ (np.clip(sizes, *bounds)[:, None] * right)
    return rotation_vector(left @ right), 0.5 * (stretch + stretch.T)


def rotation_matrix(rotation):
    """The rotation by axis times angle [3], by Rodrigues' formula.  [3, 3]"""
    angle = float(np.linalg.norm(rotation))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = np.asarray(rotation) / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def rotation_vector(matrix):
    """Axis times angle of a rotation [3, 3]; the angle is at most half a turn.  [3]"""
    cosine = np.clip(0.5 * (np.trace(matrix) - 1.0), -1.0, 1.0)
    angle = float(np.arccos(cosine))
    twice = np.array(
        [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
    )
    sine = 0.5 * float(np.linalg.norm(twice))
    if sine > 1e-6:
        return np.arctan2(sine, cosine) * twice / (2.0 * sine)
    if cosine > 0.0:
        return 0.5 * twice
    axis = (matrix + np.eye(3))[:, np.diag(matrix).argmax()]  # half a turn: 2 a aᵀ, a column
    return angle * axis / np.linalg.norm(axis)


@dataclass
class Grab:
    """A drag in progress: its handles and those around them are moved, or pulled, as one body."""

    handles: list[int]  # the first one is under the mouse
    soft: bool  # by springs
    start: np.ndarray  # where the first handle was  [3]
    target: Motion
    reached: Motion  # of the steps so far
    before: tuple[np.ndarray, np.ndarray]  # positions and velocities of all vertices
    rest_lengths: np.ndarray | None  # of all edges, if the material yields
    stood: bool  # whether the timeline had stopped time
    ids: np.ndarray | None = None  # of the vertices that are held  [K]
    offsets: np.ndarray | None = None  # from the place of an unturned Motion  [K, 3]
    radius: float = 0.0  # around the handles [model units]
    first_radius: float = 0.0  # when it began
    passing: bool = False  # its handle is a point that is gone when it is let go
    held_before: tuple | None = None  # pins and patches, if it took posed handles or pins
    pins: list[int] = field(default_factory=list)  # of its handles, that are to be pinned again


@dataclass
class Ball:
    """A ball that the mouse pushes with."""

    radius: float
    target: np.ndarray  # of its center  [3]
    reached: np.ndarray  # its center after the steps so far  [3]

    @property
    def on_its_way(self) -> bool:
        return bool((self.target != self.reached).any())


def soft_springs(solver, centers, ids, radius):
    """The vertices that a soft grab pulls, and their springs.

    Args:
        centers: The handles at rest.  [H, 3]
        ids: Vertices within the radius [model units] of one of them.  [K]

    Returns:
        ids; stiffnesses [N/m] and force limits [N].  [K], ([K], [K])
    """
    rest = solver.rest_vertices
    pull = np.max([falloff(rest, center, ids, radius) for center in centers], axis=0)
    if not (pull >= LEAST_PULL).any():  # no vertex is as near as the radius: those of the tet
        pull = np.ones(len(ids))
    ids, pull = ids[pull >= LEAST_PULL], pull[pull >= LEAST_PULL]
    share = solver.estimated_young_modulus() * solver.object_size * pull / pull.sum()
    radius = max(radius, solver.edges.rest_values.mean())
    return ids, (SOFT_STIFFNESS * share, SOFT_FORCE * radius * share)
