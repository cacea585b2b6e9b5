"""The rule that picks a default: the cheapest setting whose error is within the bound.

Times are compared turn by turn: each is divided by the mean of its turn, as a shared machine is
quicker in one turn than in the next, and the least median wins.  Of equals, the most exact does.

Shapes: S settings, R turns.
"""

import numpy as np


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
    relative = np.median(times / times.mean(axis=0), axis=1)
    return int(allowed[np.lexsort((errors[allowed], relative[allowed]))[0]])


def front(times, errors):
    """Which settings no other one beats in both time and error.  [S] bool"""
    times, errors = np.asarray(times, float), np.asarray(errors, float)
    on_front = np.zeros(len(times), bool)
    least = np.inf
    for setting in np.lexsort((errors, times)):
        if errors[setting] < least:
            on_front[setting], least = True, errors[setting]
    return on_front
