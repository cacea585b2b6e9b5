"""When a tangled part of a mesh is taken back to its shape, and where to.

Edge lengths can't tell a tet from its mirror image, and positive volumes can't tell one
sheet around an edge from two (tangles.py): both can be minima of the energy, at every
stiffness.  If something stays tangled for PATIENCE while nothing is grabbed, the solver
first runs for SOFTENING with every constraint at r = a/w̄ = RATIO, volumes on, whatever the
material: that frees most tangles and keeps what the object was doing.  What is tangled
still goes around the constraints: its part moves straight, within DURATION, to its rest
shape where it is and as it is turned, and is let go there at rest.  What pins hold
elsewhere then pulls on an untangled body.  If that, or its weight, tangles it TRIES times
within FORGET of each other, it is left alone until the user does something.

    goal_i = R (X_i − X̄) + x̄,   R the proper rotation that minimizes Σ m_i |goal_i − x_i|²

(Kabsch 1976; as in shape matching, Müller et al., "Meshless Deformations Based on Shape
Matching", 2005.)  Held vertices count HELD times as much as free ones.

Times are simulated seconds.  Shapes: V vertices, P parts.
"""

import numpy as np

PATIENCE = 1.0
SOFTENING = 1.5
RATIO = 1.0
DURATION = 0.5
COUNT_INTERVAL = 0.5
TRIES = 4  # the first of them by softening
FORGET = 10.0
HELD = 1e6


class Rescue:
    """Watches how many tangles each part has.

    Attributes:
        counts: Inverted tets and wrapped edges, as last counted [P]; None since the user
            did something.
        ratio: The r that all constraints shall have in this frame; None for the material's.
        parts: Those that go around the constraints [P] bool; None while none does.
        progress: How much of the way shall be done by the end of this frame, 0 to 1.
    """

    def __init__(self):
        self.touch()

    def touch(self):
        """The user did something: what was found out before doesn't hold any more."""
        self.counts = self.parts = self.ratio = None
        self._is_news = False
        self._tangled_for = self._sound_for = 0.0
        self._since_count = COUNT_INTERVAL
        self._tries = 0
        self._time = self.progress = 0.0

    def report(self, counts):
        """Take the number of tangles of each part.  [P]"""
        self.counts = counts
        self._is_news = True
        if counts.any():
            self._sound_for = 0.0
        else:
            self._tangled_for = 0.0

    @property
    def running(self) -> bool:
        """Whether a try is under way."""
        return self.parts is not None or self.ratio is not None

    @property
    def given_up(self) -> bool:
        """Whether something is tangled, and all tries are used up."""
        tangled = self.counts is not None and bool(self.counts.any())
        return tangled and self._tries >= TRIES and not self.running

    @property
    def may_sleep(self) -> bool:
        """Whether there is nothing left to do or to find out."""
        if self.running or self.counts is None:
            return False
        return self.given_up or not self.counts.any()

    def advance(self, dt: float) -> bool:
        """A frame of dt begins, and nothing is grabbed; whether to count after it."""
        self._sound_for += dt
        if self._sound_for >= FORGET:
            self._tries = 0
        if self.parts is not None and self.progress == 1.0:
            self.parts = None
            self._tangled_for = 0.0
        elif self.ratio is not None and self._time >= SOFTENING - 1e-6:
            self.ratio = None
            self._tangled_for = 0.0
        elif not self.running and self.counts is not None and self.counts.any():
            # Only on fresh news: much can come right between two counts.
            if self._is_news and self._tangled_for >= PATIENCE - 1e-6 and self._tries < TRIES:
                self._begin()
            self._tangled_for += dt
        self._is_news = False
        if self.ratio is not None:
            self._time += dt
            self._since_count = COUNT_INTERVAL  # as soon as it is over
            return False
        if self.parts is not None:
            self._time += dt
            along = min(self._time / DURATION + 1e-6, 1.0)  # frames add up to it but for rounding
            self.progress = along * along * (3.0 - 2.0 * along)
            self._since_count = COUNT_INTERVAL  # as soon as it is over
            return self.progress == 1.0
        return self._count_is_due(dt)

    def _begin(self):
        self._tries += 1
        self._time = 0.0
        if self._tries == 1:
            self.ratio = RATIO
        else:
            self.parts = self.counts > 0

    def _count_is_due(self, dt):
        self._since_count += dt
        due = self._since_count >= COUNT_INTERVAL - 1e-6
        if due:
            self._since_count = 0.0
        return due


def goals(rest_vertices, vertices, held):
    """Where the vertices of one part are at rest, if the part is moved but not bent.  [V, 3]

    Args:
        vertices: Now; those that aren't finite are left out.  [V, 3]
        held: Vertices that shall stay where they are, as far as possible.  [V] bool
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


def way_back(rest_vertices, vertices, part, held):
    """Where the vertices of a part [V] bool that aren't held [V] bool are, and where they go.

    Returns:
        Both of its free vertices, in order.  What is lost begins where it goes.  2 x [N, 3]
    """
    goal = goals(rest_vertices[part], vertices[part], held[part])[~held[part]]
    start = vertices[part & ~held]
    known = np.isfinite(start).all(axis=1, keepdims=True)
    return np.where(known, start, goal), goal


def distortion(rest_vertices, vertices) -> float:
    """How far a vertex is, at most, from where it would be if all had moved as one.  [V, 3]"""
    if len(vertices) == 0:
        return 0.0
    away = goals(rest_vertices, vertices, np.zeros(len(vertices), bool)) - vertices
    return float(np.linalg.norm(away, axis=1).max())
