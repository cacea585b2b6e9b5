"""Rays' samples one after another, as kernels have them, composited by the definition."""

import numpy as np

from deformrf.core.definition.image import weights
from deformrf.core.definition.loss import distortion, lead


def composite(sigma, values, length, t, counts):
    """Sums [R, C] of values [N, C], opacity, depth (0 without opacity), distortion, lead, all [R].

    Args:
        sigma, length, t: Of samples; the first counts[0] are those of ray 0.  [N]
        counts: [R]
    """
    sums, others = np.zeros((len(counts), values.shape[1])), np.zeros((4, len(counts)))
    ends = np.cumsum(counts)
    for ray, (first, end) in enumerate(zip(ends - counts, ends, strict=True)):
        own = slice(first, end)
        w = weights(sigma[own] * length[own])
        sums[ray], opacity = w @ values[own], w.sum()
        depth = w @ t[own] / opacity if opacity > 0 else 0.0
        others[:, ray] = opacity, depth, distortion(w, t[own], length[own]), lead(w, t[own])
    return sums, *others
