"""The rule that picks a default: the cheapest setting whose error is within the bound.

Times are compared turn by turn.  A setting that isn't slower than the cheapest in at least
SLOWER of the turns counts as cheap as that one; of these, the most exact is taken.

Shapes: S settings, R turns.
"""

import numpy as np

SLOWER = 0.75  # of the turns


def cheapest(times, errors, bound: float) -> int | None:
    """The number of the setting that the rule picks; None if no error is within the bound.

    Args:
        times: Of every setting in every turn, in any unit.  [S, R]
        errors: Of every setting: less is better.  [S]
        bound: The largest error that is allowed.
    """
    times, errors = np.asarray(times, float), np.asarray(errors, float)
    allowed = np.flatnonzero(errors <= bound)
    if not len(allowed):
        return None
    best = allowed[np.median(times[allowed], axis=1).argmin()]
    slower = (times[allowed] > times[best]).mean(axis=1)
    as_cheap = allowed[slower < SLOWER]
    return int(as_cheap[errors[as_cheap].argmin()])


def front(times, errors):
    """Which settings no other one beats in both time and error.  [S] bool"""
    times, errors = np.asarray(times, float), np.asarray(errors, float)
    on_front = np.zeros(len(times), bool)
    least = np.inf
    for setting in np.lexsort((errors, times)):
        if errors[setting] < least:
            on_front[setting], least = True, errors[setting]
    return on_front
