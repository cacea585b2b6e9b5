"""How many pixels to render: fewer while things move, all of them once they rest.

The factors are powers of √½ of the window's size, so that one step halves or doubles the
pixels, and with them about the time.  After a change of factor the time has to leave a
band around the target before the next one, or the picture would flicker between two.
"""

from dataclasses import dataclass

FACTORS = tuple(0.5 ** (0.5 * step) for step in range(7))  # 1 .. 0.125
TOO_SLOW, TOO_FAST = 1.25, 0.55  # the band, relative to the target; a bit more than one step
SMALLEST_STRIP = 4  # rows


@dataclass
class MovingResolution:
    """Chooses the factor from the measured times of the frames drawn while things move."""

    target_seconds: float
    step: int = 3
    _patience: int = 0

    @property
    def factor(self) -> float:
        return FACTORS[self.step]

    def measured(self, seconds: float) -> None:
        """Take account of one frame rendered at the present factor.

        A factor goes down at once, and by as many steps as are needed; it goes up by one
        step after three fast frames in a row.
        """
        while seconds > TOO_SLOW * self.target_seconds and self.step < len(FACTORS) - 1:
            self.step += 1
            self._patience = 0
            seconds *= 0.5
        self._patience = self._patience + 1 if seconds < TOO_FAST * self.target_seconds else 0
        if self._patience == 3 and self.step > 0:
            self.step -= 1
            self._patience = 0


@dataclass
class Strips:
    """Cuts an image of `height` rows into strips that each take about `budget_seconds`."""

    height: int
    budget_seconds: float
    next_row: int = 0
    seconds_per_row: float | None = None

    @property
    def done(self) -> bool:
        return self.next_row >= self.height

    def following(self) -> tuple[int, int]:
        """The next strip: its first row and the row after its last."""
        rows = SMALLEST_STRIP
        if self.seconds_per_row is not None:
            rows = max(rows, int(self.budget_seconds / max(self.seconds_per_row, 1e-9)))
        return self.next_row, min(self.next_row + rows, self.height)

    def rendered(self, rows: tuple[int, int], seconds: float) -> None:
        """Take account of a strip that is finished."""
        self.next_row = rows[1]
        self.seconds_per_row = seconds / (rows[1] - rows[0])


def finer(factor: float) -> float:
    """The factor to refine to: the full one, by way of another if it is far off."""
    return 4.0 * factor if 4.0 * factor < 0.6 else 1.0


def size_at(factor: float, width: int, height: int) -> tuple[int, int]:
    """The size in pixels at a factor, at least 8 × 8."""
    return max(8, round(width * factor)), max(8, round(height * factor))
