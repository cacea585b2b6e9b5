"""Shading of merged pieces from front to back, on the CPU, until a ray sees no further.

Inside a fold a ray crosses hundreds of pieces, of which it sees the first few.  Pieces are
shaded in rounds, sorted along their ray.  Where the first one that is left begins, the pieces
before it give a lower bound of the optical depth; a ray whose transmittance is below `stop`
there is done, and the rest keeps an extinction of 0.

Shapes: M rays, N pieces.
"""

import numpy as np
import warp as wp

from ..rays import RaySamples, Samples

FIRST_ROUND = 32  # pieces of a ray; each round has twice as many as the one before


def shade_front(shading, rays, pieces, options, stop: float, untimed):
    """Density and color of pieces whose switches are sorted, 0 behind what a ray sees.

    Returns:
        sigma [N] and rgb [N], Warp arrays, and how many pieces were shaded.
    """
    found = pieces.found
    counts, ends = found.counts.numpy(), found.ends.numpy()
    total = int(ends[-1])
    switches = pieces.switches.numpy()[: 2 * total]
    order = switches[switches % 2 == 0] // 2  # the pieces of each ray, by where they begin
    rates, middle = pieces.rates.numpy(), found.samples.t.numpy()
    half = 0.5 * found.samples.length.numpy() / np.maximum(rates, 1e-30)
    low, high = middle - half, middle + half
    owner = np.repeat(np.arange(len(counts)), counts)
    rank = np.arange(total) - (ends - counts)[owner]
    sigma, rgb = np.zeros(total, np.float32), np.zeros((total, 3), np.float32)
    depth, going = np.zeros(len(counts)), counts > 0
    done, size, shaded = 0, FIRST_ROUND, 0
    while going.any():
        chosen = (rank >= done) & (rank < done + size) & going[owner]
        of, ids = owner[chosen], order[chosen]
        part = _part(found, ids, np.bincount(of, minlength=len(counts)))
        values = shading.shade(rays, part, options, untimed)
        sigma[ids], rgb[ids] = (array.numpy() for array in values)
        shaded += len(ids)
        done, size = done + size, 2 * size
        going &= counts > done
        next_low = np.full(len(counts), np.inf)
        next_low[going] = low[order[(ends - counts)[going] + done]]
        lengths = np.minimum(high[ids], next_low[of]) - low[ids]
        depth += np.bincount(of, sigma[ids] * rates[ids] * lengths, len(counts))
        going &= np.exp(-depth) >= stop
    return wp.array(sigma, dtype=float), wp.array(rgb, dtype=wp.vec3), shaded


def _part(found: RaySamples, ids, counts) -> RaySamples:
    """Some of the samples, in the order of their rays."""
    part = RaySamples()
    part.ids = found.ids
    part.counts = wp.array(counts, dtype=int, device="cpu")
    part.ends = wp.array(np.cumsum(counts), dtype=int, device="cpu")
    part.samples = Samples()
    samples = found.samples
    part.samples.tet = wp.array(samples.tet.numpy()[ids], dtype=int, device="cpu")
    part.samples.bary = wp.array(samples.bary.numpy()[ids], dtype=wp.vec4, device="cpu")
    part.samples.length = wp.array(samples.length.numpy()[ids], dtype=float, device="cpu")
    part.samples.t = wp.array(samples.t.numpy()[ids], dtype=float, device="cpu")
    return part
