"""The levels that the view mode `levels` shows."""

import numpy as np

from deformrf.core.field import below_pixel


def levels_reference(t, edges, focal):
    """The finest level that is not finer than a pixel at distance t [...], or 0.  [...] int"""
    resolved = ~below_pixel(edges, np.asarray(t, float) / focal)
    return np.maximum(resolved.sum(axis=-1) - 1, 0)
