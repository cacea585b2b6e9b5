"""Move tangled parts of a mesh back to their rest shape.

Tangles (tangles.py) can be minima of the energy at every stiffness.  If a part stays tangled for
PATIENCE while nothing is grabbed, the solver rescues it:

1.  For SOFTENING, every constraint has r = a/w̄ = RATIO (a and w̄: definition/solver.py), and
    volume constraints act, whatever the material.  That frees most tangles and keeps the object's
    motion.
    A part that is stuck without a tangle (recovery.py) skips this step: it is in a minimum.
2.  Parts that are still tangled bypass the constraints: their vertices move
    straight to their goals within DURATION, and are released there at rest.

    goal_i = R (X_i − X̄) + x̄,   R the proper rotation that minimizes Σ m_i |goal_i − x_i|²

The goal is the rest shape in the part's present position and rotation (Kabsch 1976; used as
in shape matching, Müller et al., "Meshless Deformations Based on Shape Matching", 2005).
Held vertices weigh HELD times as much as free ones; after the release they pull the body to them.
If a part tangles again TRIES times within FORGET of each other, the solver ignores it until the
user acts.

If a load keeps a body in a shape that counts as tangled, no rescue would last.  So a body is not
rescued if it was sound after the user's last act and then fell or buckled under its weight, or if
its pins have moved relative to each other and bend it.  Vertices that are not finite are always
rescued.

Times are simulated seconds.  Shapes: V vertices, P parts (connected components).
"""

import numpy as np

PATIENCE = 1.0
SOFTENING = 1.5
RATIO = 1.0
DURATION = 0.5
COUNT_INTERVAL = 0.5
TRIES = 4  # the first one for tangles by softening
FORGET = 10.0
LOOSE = 2  # counts in a row in which pins hold a tangle: then a part collides with nothing
HELD = 1e6


class Rescue:
    """Decides how the solver treats the counted tangles.

    Attributes:
        counts: Tangles of each part when last counted [P]; None since the user did something.
        load: What may hold the body in another shape than its rest shape: "pins", "weight",
            "wind", "colliders" or None.
        ratio: The r of all constraints in this frame; None for the material's.
        parts: Those that bypass the constraints [P] bool; None if none does.
        progress: The share of their way that is done at the end of this frame, 0 to 1.
    """

    def __init__(self):
        self.touch()

    def touch(self):
        """The user did something: forget all counts and tries."""
        self.counts = self.parts = self.ratio = self.load = self._lost = None
        self._held_for = 0  # counts in a row in which pins held a tangle, up to LOOSE  [P]
        self._is_news = self._was_sound = self._softens = self._softened = False
        self._tangled_for = self._sound_for = 0.0
        self._since_count = COUNT_INTERVAL
        self._tries = 0
        self._time = self.progress = 0.0

    def report(self, counts, lost=False, stuck=0):
        """Take the tangles of each part, and whether it has lost vertices and is stuck.  [P]"""
        self._softens = bool(np.any(counts))
        self.counts, self._lost = counts + stuck, np.broadcast_to(lost, counts.shape)
        self._is_news = True
        held = (self.counts > self._curable) & (self.load == "pins")
        self._held_for = np.where(held, self._held_for + 1, np.minimum(self._held_for, LOOSE))
        self._held_for[~held & (self._held_for < LOOSE)] = 0
        if self.counts.any():
            self._sound_for = 0.0
        else:
            self._tangled_for, self._was_sound = 0.0, True

    @property
    def running(self) -> bool:
        """Whether a try is under way."""
        return self.parts is not None or self.ratio is not None

    def without_contact(self, parts):
        """Those of these parts that collide with nothing.  [P] bool

        These are parts that a try is under way for.  Also those that pins hold in a tangle, until
        the user acts: inside out, they would be pushed to and fro for ever.
        """
        if self.parts is not None:
            return parts & self.parts
        if self.running and self.counts is not None:
            return parts & (self.counts > 0)
        return parts & (self._held_for >= LOOSE)

    @property
    def _curable(self):
        """Tangles of each part that a rescue may resolve.  [P]"""
        if self.load == "pins" or (self.load and self._was_sound):
            return np.where(self._lost, self.counts, 0)
        return self.counts

    @property
    def held_by(self) -> str | None:
        """The load that holds something in a shape that counts as tangled."""
        held = self.counts is not None and not self.running and (self.counts > self._curable).any()
        return self.load if held else None

    @property
    def given_up(self) -> bool:
        """Whether something is tangled and all tries are used up."""
        tangled = self.counts is not None and bool(self._curable.any())
        return tangled and self._tries >= TRIES and not self.running

    @property
    def may_sleep(self) -> bool:
        """Whether the solver may sleep: no try is under way or to come, and tangles are known."""
        if self.running or self.counts is None:
            return False
        return self.given_up or not self._curable.any()

    def advance(self, dt: float, load: str | None = None) -> bool:
        """Begin a frame of dt in which nothing is grabbed; True to count tangles after it."""
        self.load = load
        self._sound_for += dt
        if self._sound_for >= FORGET:
            self._tries, self._softened = 0, False
        softened = self.ratio is not None and self._time >= SOFTENING - 1e-6
        returned = self.parts is not None and self.progress == 1.0
        if softened or returned:
            self.ratio = self.parts = None
            self._tangled_for = 0.0
        elif not self.running and self.counts is not None and self._curable.any():
            # Only on a new count: a part may have untangled itself since the last one.
            if self._is_news and self._tangled_for >= PATIENCE - 1e-6 and self._tries < TRIES:
                self._begin()
            self._tangled_for += dt
        self._is_news = False
        self._time += dt
        if self.running:
            self._since_count = COUNT_INTERVAL  # count as soon as the try is over
        if self.ratio is not None:
            return False
        if self.parts is not None:
            share = min(self._time / DURATION + 1e-6, 1.0)  # 1e-6: frames add up with rounding
            self.progress = share * share * (3.0 - 2.0 * share)
            return self.progress == 1.0
        self._since_count += dt
        due = self._since_count >= COUNT_INTERVAL - 1e-6
        if due:
            self._since_count = 0.0
        return due

    def _begin(self):
        self._tries += 1
        self._time = self.progress = 0.0
        if self._softens and not self._softened:
            self.ratio, self._softened = RATIO, True
        else:
            self.parts = self._curable > 0


def goals(rest_vertices, vertices, held):
    """The rest shape of one part, moved and turned to where the part is.  [V, 3]

    Args:
        vertices: Those that aren't finite don't count.  [V, 3]
        held: Those that should stay where they are, as far as possible.  [V] bool
    """
    known = np.isfinite(vertices).all(axis=1)
    if not known.any():
        return rest_vertices
    x, rest = vertices[known].astype(np.float64), rest_vertices[known]
    weights = np.where(held[known], HELD, 1.0)[:, None]
    middle, rest_middle = ((weights * a).sum(axis=0) / weights.sum() for a in (x, rest))
    u, _, wt = np.linalg.svd((weights * (x - middle)).T @ (rest - rest_middle))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ wt))]) @ wt
    return (rest_vertices - rest_middle) @ turn.T + middle


def ways_back(rest_vertices, vertices, held, part_of, parts):
    """Starts and ends of the free vertices of these parts ([P] bool).  2 × [V, 3]

    A vertex whose position isn't finite starts at its goal.  Held vertices ([V] bool) and those
    of other parts stay where they are.
    """
    start, goal = vertices.copy(), vertices.copy()
    for part in np.flatnonzero(parts):
        members = part_of == part
        of_part = goals(rest_vertices[members], vertices[members], held[members])
        free = members & ~held
        goal[free] = of_part[~held[members]]
        lost = free & ~np.isfinite(vertices).all(axis=1)
        start[lost] = goal[lost]
    return start, goal


def distortion(rest_vertices: np.ndarray, vertices: np.ndarray) -> float:
    """The largest distance of a vertex to its place in a rigid motion of all.  [V, 3]"""
    if len(vertices) == 0:
        return 0.0
    away = goals(rest_vertices, vertices, np.zeros(len(vertices), bool)) - vertices
    return float(np.linalg.norm(away, axis=1).max())
