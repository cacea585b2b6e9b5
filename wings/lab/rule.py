"""The rule that chooses a default: the fastest setting whose error is within the bound.

The speed of a shared machine varies between turns, so each time is divided by the default's
time in the same turn; the least median wins.  Of equals, the most exact wins.

Shapes: S settings, R turns.
"""

import numpy as np


def shares(times, base=0):
    """Times relative to that of setting `base` in the same turn.  [S, R]"""
    times = np.asarray(times, float)
    return times / times[base]


def cheapest(times, errors, bound: float, base=0) -> int | None:
    """The index of the setting that the rule chooses; None if no error is within the bound.

    Args:
        times: In any unit.  [S, R]
        errors: Less is better.  [S]
        base: The setting that the others are compared with.
    """
    errors = np.asarray(errors, float)
    allowed = np.flatnonzero(errors <= bound)
    if not len(allowed):
        return None
    relative = np.median(shares(times, base), axis=1)
    return int(allowed[np.lexsort((errors[allowed], relative[allowed]))[0]])
