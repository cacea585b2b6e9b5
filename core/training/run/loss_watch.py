"""Watches the loss of a run, and keeps good weights to return to when it diverges."""

from math import isfinite

from .training_field import TrainingField

SNAPSHOT_INTERVAL = 512  # steps from one set of good weights to the next
DIVERGED_FACTOR = 20.0  # of the smoothed loss over the lowest so far
SMOOTHING = 0.8  # of the loss, from one look to the next


class Diverged(Exception):
    """The loss diverged: the message is one sentence, the field has its last good weights."""


class LossWatch:
    """Examines a field's loss from time to time."""

    def __init__(self, field: TrainingField):
        self.field = field
        self._smooth = self._lowest = None
        self._good, self._good_number = None, 0

    def examine(self, error: float, number: int, step_count: int):
        """Keep the weights of step `number` from time to time.

        Raises:
            Diverged: The error isn't finite or far above its lowest value, or a weight isn't
                finite.
        """
        if not isfinite(error):
            self._give_up(f"the loss became {error}", number, step_count)
        if self._smooth is None:
            self._smooth = self._lowest = error
        self._smooth = SMOOTHING * self._smooth + (1.0 - SMOOTHING) * error
        self._lowest = min(self._lowest, self._smooth)
        if self._smooth > DIVERGED_FACTOR * self._lowest:
            what = f"the loss rose from {self._lowest:.2g} to {self._smooth:.2g}"
            self._give_up(what, number, step_count)
        # Early on, when much is learned in few steps, more often.
        if number - self._good_number >= min(SNAPSHOT_INTERVAL, max(self._good_number, 1)):
            if not self.keep_good(number):
                self._give_up("a weight became infinite", number, step_count)

    def keep_good(self, number: int) -> bool:
        """Keep the weights of step `number`, if they are finite; whether they are."""
        weights = [p.detach() for p in self.field.parameters()]
        finite = all(bool(w.isfinite().all()) for w in weights)
        if finite:
            self._good, self._good_number = [w.clone() for w in weights], number
        return finite

    def _give_up(self, what, number, step_count):
        self.field.set_weights(self._good)
        raise Diverged(
            f"{what} at step {number} of {step_count}; the model has the weights of "
            f"step {self._good_number}"
        )
