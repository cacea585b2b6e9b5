"""When to soften a tangled mesh for a while: a state machine without any mesh.

Edge lengths can't tell a tet from its mirror image, and stiff constraints can lock each
other.  If tets stay inverted for PATIENCE while no handle moves, the solver runs for
DURATION with every constraint at the same r = a/w, volumes on, whatever the material;
then with the user's material again.  The first try, r = 1, is nearly always enough.  A
body that was turned inside out at its pins came back with r = 10 only, so tries take
turns.  A mesh that TRIES don't make better is left alone until the user does something.

Times are simulated seconds.
"""

PATIENCE = 1.0
DURATION = 1.5
RATIOS = 1.0, 3.0, 10.0  # r, by try
COUNT_INTERVAL = 0.1
TRIES = 8


class Rescue:
    """Watches the number of inverted tets over time.

    Attributes:
        count: Of inverted tets, as last counted; None since the user did something.
        ratio: The r that all constraints shall have in this frame; None while nothing is
            wrong, or nothing is done about it.
    """

    def __init__(self):
        self.count = None
        self.ratio = None
        self._left = 0.0  # of the rescue that is running
        self.touch()

    def touch(self):
        """The user did something: what was found out before doesn't hold any more."""
        self.count = None
        self._inverted_for = 0.0
        self._since_count = COUNT_INTERVAL
        self._tries = 0  # that made nothing better
        self._turn = 0
        self._best = None  # the fewest inverted tets that a try began with

    def restart(self):
        """The user set another state: a rescue of the one before is over."""
        self.ratio = None
        self.touch()

    def report(self, count: int):
        """Take the number of inverted tets."""
        self.count = count
        if count == 0:
            self._inverted_for = 0.0
            self._tries = self._turn = 0
            self._best = None

    @property
    def given_up(self) -> bool:
        return self._tries >= TRIES and self.ratio is None

    @property
    def may_sleep(self) -> bool:
        """Whether there is nothing left to do or to find out."""
        return self.ratio is None and (self.count == 0 or self.given_up)

    def advance(self, dt: float, handles_move: bool) -> bool:
        """A frame of dt begins; whether tets shall be counted after it."""
        if handles_move:
            self.ratio = None
            self._inverted_for = 0.0
            return False
        if self.ratio is not None:
            self._left -= dt
            if self._left <= 0.0:
                self.ratio = None
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
        self.ratio = RATIOS[self._turn % len(RATIOS)]
        self._turn += 1
        self._left = DURATION
