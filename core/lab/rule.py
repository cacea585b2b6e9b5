"""The rule that picks a default: the cheapest setting whose error is within the bound.

Times are compared in pairs: each is divided by that of one setting, the default, in the same
turn, as a shared machine is quicker in one turn than in the next; the least median wins.  Of
equals, the most exact wins.  The Pareto front uses the same relative times.

Shapes: S settings, R turns.
"""

import numpy as np


def shares(times, base=0):
    """Of the time of setting `base` in the same turn.  [S, R]"""
    times = np.asarray(times, float)
    return times / times[base]


def cheapest(times, errors, bound: float, base=0) -> int | None:
    """The number of the setting that the rule picks; None if no error is within the bound.

    Args:
        times: Of every setting in every turn, in any unit.  [S, R]
        errors: Of every setting: less is better.  [S]
        bound: The largest error that is allowed.
        base: The setting that the others are compared with.
    """
    errors = np.asarray(errors, float)
    allowed = np.flatnonzero(errors <= bound)
    if not len(allowed):
        return None
    relative = np.median(shares(times, base), axis=1)
    return int(allowed[np.lexsort((errors[allowed], relative[allowed]))[0]])


def front(times, errors):
    """Which settings no other one beats in both time and error.  [S] bool

    Args:
        times: One of every setting, in any unit.  [S]
    """
    times, errors = np.asarray(times, float), np.asarray(errors, float)
    on_front = np.zeros(len(times), bool)
    least = np.inf
    for setting in np.lexsort((errors, times)):
        if errors[setting] < least:
            on_front[setting], least = True, errors[setting]
    return on_front
