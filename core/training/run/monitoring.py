"""Show, record and judge a run's error every few steps.

The history of a run has at most 100 rows a stage.  A row is plain JSON:

    {"seconds": of the run so far, "stage": 1 or 2, "step": of the stage, "psnr": [dB]}

`psnr` comes from the training rays' mean squared error since the row before.  The error is read
every few steps, and counts for all steps since the last reading.  The last row of a stage grows
until it spans its share of the steps, so a resumed run needs nothing but the rows.
"""

import time
from collections.abc import Callable
from math import inf, isfinite, log10

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from .training_field import TrainingField

MOST_ROWS = 100  # of a stage
TOLD_SECONDS = 20.0  # between two lines, where there is no bar
LEAST_ERROR = 1e-12  # of equal images, whose PSNR would be infinite
SNAPSHOT_INTERVAL = 512  # steps from one set of good weights to the next
DIVERGED_FACTOR = 20.0  # of the smoothed loss over the lowest so far
GOOD_FACTOR = 3.0  # the same: weights of a larger loss are not kept
MOST_RETURNS = 3  # of a stage to its last good weights; then it is given up
RETURN_RATE = 0.5  # of the learning rate, after each of them
WARM_UP_STEPS = 100  # in which the learning rate rises, at a stage's start and after a return
SMOOTHING = 0.8  # of the loss, from one look to the next


def psnr_of(mse: float) -> float:
    """PSNR of a mean squared error of values in [0, 1].  [dB]"""
    return -10.0 * log10(max(mse, LEAST_ERROR))


class TrainingProgress:
    """A bar per stage and sentences, if they are to be `shown`; a context manager.

    Attributes:
        rate: Samples a second, of the last steps.
    """

    def __init__(self, shown=True):
        self.rate = 0.0
        self._shown, self._told = shown, time.perf_counter()
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TextColumn("{task.fields[psnr]}"),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            disable=not shown,
        )

    def __enter__(self):
        self._bar.start()
        return self

    def __exit__(self, *_):
        self._bar.stop()

    def begin(self, title: str, step_count: int, done: int = 0):
        self._since = time.perf_counter()
        if done:
            self.say(f"Going on from step {done} of {step_count} of {title}.")
        return self._bar.add_task(title, total=step_count, completed=done, psnr="", rate="")

    def say(self, sentence: str):
        """A line above the bar; the terminal wraps it, so that numbers can be copied."""
        if self._shown:
            self._bar.console.print(sentence, soft_wrap=True)

    def advance(self, task, step_count: int, mse: float, sample_count: int):
        """Count steps; `mse` and `sample_count` are those of the last one."""
        now = time.perf_counter()
        self.rate = step_count * sample_count / max(now - self._since, 1e-9)
        self._since = now
        psnr = f"{psnr_of(mse):.2f} dB" if isfinite(mse) else "lost"
        rate = f"{self.rate / 1e6:.1f} M samples/s"
        self._bar.update(task, advance=step_count, psnr=psnr, rate=rate)
        # In a file, the bar is a single line, at the end.
        if not self._bar.console.is_terminal and now - self._told > TOLD_SECONDS:
            self._told, (one,) = now, [one for one in self._bar.tasks if one.id == task]
            left = "" if one.time_remaining is None else f", {one.time_remaining:.0f} s left"
            self.say(f"{one.description}: {one.completed:.0f}/{one.total:.0f}, {psnr}{left}")


class History:
    """What one stage writes of a run's history into the rows of the run so far."""

    def __init__(self, rows: list[dict], stage: int, step_count: int, clock: Callable[[], float]):
        self.rows, self.stage, self.clock = rows, stage, clock
        self.span = -(-step_count // MOST_ROWS)  # steps of a row, at least

    def note(self, step: int, mse: float):
        """Add the error after that many steps of the stage, if it is finite."""
        mine = [row for row in self.rows[-2:] if row["stage"] == self.stage]
        last = mine[-1]["step"] if mine else 0
        # A run that was interrupted at a stage's end notes its last step twice.
        if step <= last or not isfinite(mse):
            return
        begin = mine[0]["step"] if len(mine) == 2 else 0  # of the last row
        kept = len(self.rows)
        if mine and last - begin < self.span:
            total = (last - begin) * 10.0 ** (-0.1 * mine[-1]["psnr"]) + (step - last) * mse
            mse = total / (step - begin)
            kept -= 1
        row = {"seconds": self.clock(), "stage": self.stage, "step": step, "psnr": psnr_of(mse)}
        self.rows[kept:] = [row]  # one assignment, because Ctrl-C comes at any time


class Diverged(Exception):
    """The loss diverged: the message is one sentence, the field has its last good weights."""


class LossWatch:
    """Keeps good weights of a field, to return to when its loss diverges.

    Steps may throw all weights far off.  From the weights before them, and more slowly, a run can
    go on.  Its occupancy goes back with it.

    Attributes:
        returns: How often the field returned, `returned_at` the last time.

    Args:
        make_whole: Makes the weights whole on several workers, who all call it together.
    """

    def __init__(self, field: TrainingField, make_whole: Callable[[], None]):
        self.field, self._make_whole = field, make_whole
        self.returns, self.returned_at = 0, 0
        self._smooth, self._lowest = None, inf
        self._good, self._good_number = None, 0
        self._kept_at = 0  # the step at which weights were kept or given up

    def load(self, returns: int, returned_at: int, number: int) -> None:
        """Go on at step `number` of a run that has returned so often.

        Raises:
            ValueError: No run can have returned so often or then.
        """
        if not (0 <= returns <= MOST_RETURNS and 0 <= returned_at <= number):
            raise ValueError(f"it returned {returns} times, at last at step {returned_at}")
        self.returns, self.returned_at = int(returns), int(returned_at)

    def rate_share(self, number: int) -> float:
        """The share of its learning rate with which step `number` is made."""
        warm_up = min(1.0, (number - self.returned_at + 1) / WARM_UP_STEPS)
        return warm_up * RETURN_RATE**self.returns

    def examine(self, error: float, number: int, step_count: int) -> str | None:
        """Judge the error of step `number`; keep its weights from time to time.

        Returns:
            A sentence if the field has returned to its last good weights: the error isn't finite
            or far above its lowest, or a weight isn't finite.  Adam's moments are of no use then.

        Raises:
            Diverged: The same, once too often or at the last step.
        """
        what = self._trouble(error, number)
        if what is None:
            return None
        weights, *occupancy = self._good
        self.field.set_weights(weights)
        self.field.set_occupancy(*occupancy)
        what, good = f"{what} at step {number} of {step_count}", f"step {self._good_number}"
        if self.returns == MOST_RETURNS or number >= step_count:
            raise Diverged(f"{what}; the model has the weights of {good}")
        self.returns, self.returned_at = self.returns + 1, number
        self._smooth, self._kept_at = None, number
        return f"{what[0].upper()}{what[1:]}; going on with the weights of {good}, more slowly."

    def _trouble(self, error, number) -> str | None:
        """What is wrong; if nothing is, keep the weights from time to time."""
        if not isfinite(error):
            return f"the loss became {error}"
        if self._smooth is None:
            self._smooth = error
        self._smooth = SMOOTHING * self._smooth + (1.0 - SMOOTHING) * error
        self._lowest = min(self._lowest, self._smooth)
        if self._smooth > DIVERGED_FACTOR * self._lowest:
            return f"the loss rose from {self._lowest:.2g} to {self._smooth:.2g}"
        # Early on, when much is learned in few steps, more often.
        due = number - self._kept_at >= min(SNAPSHOT_INTERVAL, max(self._kept_at, 1))
        if due and self._smooth < GOOD_FACTOR * self._lowest:
            if not self.keep_good(number):
                return "a weight became infinite"
        return None

    def keep_good(self, number: int) -> bool:
        """Keep the weights of step `number`, if they are finite; whether they are."""
        self._make_whole()
        weights = [p.detach() for p in self.field.parameters()]
        finite = all(bool(w.isfinite().all()) for w in weights)
        if finite:
            occupancy = self.field.thickness.clone(), self.field.occupied.clone()
            self._good = [w.clone() for w in weights], *occupancy
            self._good_number = self._kept_at = number
        return finite
