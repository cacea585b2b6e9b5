"""Chooses the number of rendered pixels while things move.

The factors are powers of √½ of the window's size, so that one step halves or doubles the
pixels, and with them about the time.  Below about a third of the width a picture is a mosaic;
before that, a slow renderer makes its rays take longer steps and leaves out levels finer than
a pixel.  After a change the time has to leave a band around the target before the next one,
or the picture would flicker between two.
"""

from dataclasses import dataclass

from ..core.field import below_pixel

FACTORS = tuple(0.5 ** (0.5 * step) for step in range(7))  # 1 .. 0.125
TOO_SLOW, FITS = 1.25, 1.1  # of the target: what leads to less, what more may be expected to take
SMALLEST_SHARE = 0.4  # of a frame that rendering gets, whatever else takes time
RECOGNIZABLE = 0.35  # the factor below which pixels are the last thing to save on


@dataclass(frozen=True)
class Rung:
    """A quality setting for rendering while things move."""

    factor: float  # of the window's width and height
    step_factor: float = 1.0  # RenderOptions.step_factor
    spared_levels: int = 0  # so many levels may be left out, if they are finer than a pixel
    cost: float = 1.0  # about the time, relative to the whole image in full quality

    def savings(self, edges, pixel: float) -> dict:
        """What it saves on besides pixels, as arguments of RenderOptions.

        Args: the model's `level_edges` [L], and the width of a pixel where the object is.
        """
        saved = {} if self.step_factor == 1.0 else {"step_factor": self.step_factor}
        spared = min(int(below_pixel(edges, pixel).sum()), self.spared_levels, len(edges) - 1)
        return {**saved, "level_count": len(edges) - spared} if spared else saved


# What the settings save and lose on two CPU cores, at 0.35 of 1200 × 800 of the bundled model:
# 0.82 of the time at 50 dB, 0.75 at 46 dB, 0.71 at 45 dB.  Two levels less would be 38 dB.
CHEAPER = ((1.4, 0, 0.82), (2.0, 0, 0.75), (2.0, 1, 0.71))


def _rung(factor, step_factor=1.0, spared_levels=0, share=1.0):
    return Rung(factor, step_factor, spared_levels, share * factor * factor)


LADDER = tuple(map(_rung, FACTORS))
_LARGE = [factor for factor in FACTORS if factor >= RECOGNIZABLE]
CPU_LADDER = (
    *map(_rung, _LARGE),
    *(_rung(_LARGE[-1], *saving) for saving in CHEAPER),
    *(_rung(factor, *CHEAPER[-1]) for factor in FACTORS[len(_LARGE) :]),
)


def render_budget(target_fps: float, other_seconds: float) -> float:
    """Seconds that rendering may take for so many frames a second, beside everything else."""
    return max(1.0 / target_fps - other_seconds, SMALLEST_SHARE / target_fps)


@dataclass
class MovingResolution:
    """Chooses the rung from the measured times of the frames drawn while things move."""

    target_seconds: float
    ladder: tuple[Rung, ...] = LADDER
    step: int = 3
    _patience: int = 0

    @property
    def rung(self) -> Rung:
        return self.ladder[self.step]

    def measured(self, seconds: float) -> None:
        """Take account of one frame that was rendered as the present rung says.

        Too slow a frame leads down at once, by as many rungs as are needed; three frames in a
        row with time to spare lead up by one.
        """
        while seconds > TOO_SLOW * self.target_seconds and self.step < len(self.ladder) - 1:
            seconds *= self.ladder[self.step + 1].cost / self.rung.cost
            self.step += 1
            self._patience = 0
        if self.step == 0:
            return
        expected = seconds * self.ladder[self.step - 1].cost / self.rung.cost
        self._patience = self._patience + 1 if expected < FITS * self.target_seconds else 0
        if self._patience == 3:
            self.step -= 1
            self._patience = 0
