"""When to soften a tangled mesh for a while: a state machine without any mesh.

Edge lengths can't tell a tet from its mirror image, and stiff constraints can lock each
other.  If tets stay inverted for PATIENCE while no handle moves, the solver runs for
DURATION with every constraint at r = RATIO, volumes on, whatever the material; then with
the user's material again.  (Measured: reference/simulation.md has 7 of 7 recovered.)
A mesh that doesn't get better after TRIES is left alone, until the user does something.

Times are simulated seconds.
"""

PATIENCE = 1.0
DURATION = 1.5
RATIO = 1.0  # a in units of the constraint's inverse mass
COUNT_INTERVAL = 0.1
TRIES = 8


class Rescue:
    """Watches the number of inverted tets over time.

    Attributes:
        count: Of inverted tets, as last counted; None since the user did something.
        running: Whether the solver shall soften the mesh in this frame.
    """

    def __init__(self):
        self.count = None
        self.running = False
        self._left = 0.0  # of the rescue that is running
        self.touch()

    def touch(self):
        """The user did something: what was found out before doesn't hold any more."""
        self.count = None
        self._inverted_for = 0.0
        self._since_count = COUNT_INTERVAL
        self._tries = 0
        self._best = None  # the fewest inverted tets that a try began with

    def restart(self):
        """The user set another state: a rescue of the one before is over."""
        self.running = False
        self.touch()

    def report(self, count: int):
        """Take the number of inverted tets."""
        self.count = count
        if count == 0:
            self._inverted_for = 0.0
            self._tries = 0
            self._best = None

    @property
    def given_up(self) -> bool:
        return self._tries >= TRIES and not self.running

    @property
    def may_sleep(self) -> bool:
        """Whether there is nothing left to do or to find out."""
        return not self.running and (self.count == 0 or self.given_up)

    def advance(self, dt: float, handles_move: bool) -> bool:
        """A frame of dt begins; whether tets shall be counted after it."""
        if handles_move:
            self.running = False
            self._inverted_for = 0.0
            return False
        if self.running:
            self._left -= dt
            if self._left <= 0.0:
                self.running = False
                self._inverted_for = 0.0
        elif self.count:
            if self._inverted_for >= PATIENCE and not self.given_up:
                self._begin()
            self._inverted_for += dt
        self._since_count += dt
        due = self._since_count >= COUNT_INTERVAL
        if due:
            self._since_count = 0.0
        return due

    def _begin(self):
        better = self._best is None or self.count < self._best
        self._tries = 1 if better else self._tries + 1
        self._best = self.count if better else self._best
        self.running = True
        self._left = DURATION
