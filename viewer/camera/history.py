"""Where the camera was before: moves of the camera are no edits, and have their own way back."""

from .orbit import Orbit

MOST = 50  # orbits that are kept
APART = 0.7  # s: moves that follow each other sooner are one, as of the wheel


class CameraHistory:
    """The orbits at which the camera has rested."""

    def __init__(self):
        self._past: list[Orbit] = []
        self._future: list[Orbit] = []
        self._rests: Orbit | None = None  # where it rests now
        self._since = 0.0  # when it last moved

    def note(self, orbit: Orbit, moves: bool, now: float) -> None:
        """Called in every frame with the camera, and whether something still moves it."""
        if self._rests is None:
            self._rests = orbit
        if orbit is self._rests or moves:
            return
        if now - self._since > APART or not self._past:
            self._past = [*self._past, self._rests][-MOST:]
        self._future.clear()
        self._rests, self._since = orbit, now

    def back(self) -> Orbit | None:
        """The orbit before, from which `forward` leads here again; None without one."""
        return self._go(self._past, self._future)

    def forward(self) -> Orbit | None:
        """The orbit that `back` has left; None without one."""
        return self._go(self._future, self._past)

    def _go(self, there, here):
        if not there:
            return None
        here.append(self._rests)
        self._rests = there.pop()
        return self._rests
