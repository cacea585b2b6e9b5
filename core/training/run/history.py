"""The history of a run: how its error fell with time, in at most 100 rows a stage.

A row is plain JSON:

    {"seconds": of the run so far, "stage": 1 or 2, "step": of the stage, "psnr": [dB]}

`psnr` comes from the training rays' mean squared error since the row before.  The error is
read every few steps (optimization.py); a value that is read counts for the steps since the
last reading.  The last row of a stage grows until it spans its share of the steps, so a
resumed run needs nothing but the rows.
"""

from collections.abc import Callable
from math import isfinite, log10

MOST_ROWS = 100  # of a stage
LEAST_ERROR = 1e-12  # of equal images, whose PSNR would be infinite


class History:
    """The part of a run's history that one stage writes.

    Args:
        rows: Rows of the run so far; new rows are appended, and the last one is replaced.
        stage: 1 or 2.
        step_count: Number of steps of the stage.
        seconds: The run's clock.
    """

    def __init__(self, rows: list[dict], stage: int, step_count: int, seconds: Callable[[], float]):
        self.rows, self.stage, self.seconds = rows, stage, seconds
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
        row = {"seconds": self.seconds(), "stage": self.stage, "step": step, "psnr": psnr_of(mse)}
        self.rows[kept:] = [row]  # one assignment, because Ctrl-C comes at any time


def psnr_of(mse: float) -> float:
    """PSNR of a mean squared error of values in [0, 1].  [dB]"""
    return -10.0 * log10(max(mse, LEAST_ERROR))
