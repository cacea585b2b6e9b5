"""The definition of the image of a deformed field: float64, brute force, no shortcuts.

The four lines of docs/design/001-field-and-image.md:

1. every tet that a ray crosses cuts its own interval, from its own entry, into pieces of
   rest length Δ, the last one shorter;
2. σ and c are constant on a piece, evaluated at its middle, in the direction Qᵀd; a
   masked sub-tet has σ = 0;
3. extinction per unit of t is κ = s·σ·|F⁻¹d|;
4. all piece ends along the ray are merged; where tets overlap, the media add up.

With one color a ray (`FieldOptions.deferred`), what is summed instead of the samples' colors is h,
what the density network gives, and the rest direction Qᵀd.  The ray's color is that of the means:
the color network takes the mean h, and Y of the mean direction, which is normalized before.

Every ray is tested against every tet, so this is for small images in tests and reports.
"""

from itertools import pairwise

import numpy as np

from ..field import (
    GEOMETRY_FEATURES,
    TetField,
    is_occupied_reference,
    sigma_from,
    spherical_harmonics,
)
from .rays.approach import ASIDE
from .rays.pose import tet_frames_reference

ROUNDING = 1e-12  # relative; what is smaller counts as 0
NEGLIGIBLE = 1e-6  # the least divisor: an opacity, or the length of a mean of directions
EVALUATE_CHUNK = 1 << 18  # samples per call of the field: bounds the memory


def ray_pieces(field: TetField, vertices, origins, directions):
    """All pieces of all rays that are in occupied sub-tets.

    Returns:
        ray [N], tet [N], bary [N, 4], t_in [N], t_out [N], rest directions [N, 3] and
        s·|F⁻¹d| [N].
    """
    gradients, inverse_f, rotations, fades = tet_frames_reference(
        field.mesh.rest_vertices, vertices, field.mesh.tets
    )
    step = field.options.march_step
    found = []
    for ray, (o, d) in enumerate(zip(origins, directions, strict=True)):
        alpha = gradients[:, :, :3] @ o + gradients[:, :, 3]
        slope = gradients[:, :, :3] @ d
        # A ray within a face belongs to the tet that it is in when it is moved by ASIDE.
        steepest = np.linalg.norm(gradients[:, :, :3], axis=2)
        slope[np.abs(slope) <= ROUNDING * steepest] = 0.0
        aside = gradients[:, :, :3] @ ASIDE
        on_face = np.abs(alpha) <= ROUNDING * (1.0 + steepest * np.linalg.norm(o))
        beyond = np.where(on_face, aside, alpha) < 0
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -alpha / slope
        t_in = np.where(slope > 0, crossing, -np.inf).max(axis=1)
        t_out = np.where(slope < 0, crossing, np.inf).min(axis=1)
        outside = ((slope == 0) & beyond).any(axis=1)
        t_in = np.maximum(t_in, 0.0)
        tet = np.flatnonzero((t_out > t_in) & ~outside & (fades > 0))
        speed = np.linalg.norm(inverse_f[tet] @ d, axis=1)
        rest_length = (t_out[tet] - t_in[tet]) * speed
        count = np.ceil(rest_length / step).astype(int)
        owner = np.repeat(np.arange(len(tet)), count)
        index = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        low = index * step
        high = np.minimum(low + step, rest_length[owner])
        start = t_in[tet][owner]
        low, high = start + low / speed[owner], start + high / speed[owner]
        bary = alpha[tet][owner] + (0.5 * (low + high))[:, None] * slope[tet][owner]
        rate = fades[tet] * speed
        rest_direction = np.einsum("tji,j->ti", rotations[tet], d)
        pieces = np.full(len(owner), ray), tet[owner], bary, low, high
        found.append((*pieces, rest_direction[owner], rate[owner]))
    pieces = [np.concatenate(column) for column in zip(*found, strict=True)]
    keep = is_occupied_reference(field.occupancy, pieces[1], pieces[2])
    return [column[keep] for column in pieces]


def render_rays(field: TetField, vertices, origins, directions, background):
    """The image of the field along rays.

    Args:
        vertices: Current positions.  [V, 3]
        origins, directions: Rays in model space, directions of length one.  [R, 3]
        background: Color behind the field.  [3]

    Returns:
        color [R, 3] over the background, opacity [R], depth [R] (0 without opacity).
    """
    ray, tet, bary, t_in, t_out, rest_direction, rate = ray_pieces(
        field, np.asarray(vertices, float), origins, directions
    )
    deferred = field.options.deferred
    width = GEOMETRY_FEATURES + 3 if deferred else 3
    sigma, values = np.empty(len(ray)), np.empty((len(ray), width))
    for first in range(0, len(ray), EVALUATE_CHUNK):
        part = slice(first, first + EVALUATE_CHUNK)
        h, directions = field.geometry(tet[part], bary[part]), rest_direction[part]
        sigma[part] = sigma_from(h)
        if deferred:
            values[part] = np.column_stack([h, directions])
        else:
            values[part] = field.colors(h, spherical_harmonics(directions))
    kappa = sigma * rate

    sums = np.zeros((len(origins), width))
    opacity, depth = np.zeros(len(origins)), np.zeros(len(origins))
    bounds = np.searchsorted(ray, np.arange(len(origins) + 1))
    for r, (first, last) in enumerate(pairwise(bounds)):
        part = slice(first, last)
        ends, inverse = np.unique(np.concatenate([t_in[part], t_out[part]]), return_inverse=True)
        starts, stops = np.split(inverse, 2)
        # A piece adds its medium at its start and removes it at its end: cumulative sums.
        medium = np.zeros((len(ends), 1 + width))
        emission = np.column_stack([kappa[part], kappa[part, None] * values[part]])
        np.add.at(medium, starts, emission)
        np.add.at(medium, stops, -emission)
        medium = np.cumsum(medium, axis=0)[:-1]
        dt = np.diff(ends)
        tau = np.maximum(medium[:, 0], 0.0) * dt
        transmittance = np.exp(-np.concatenate([[0.0], np.cumsum(tau)]))
        weights = transmittance[:-1] * -np.expm1(-tau)
        lit = medium[:, 0] > 1e-9
        weights = np.where(lit, weights, 0.0)
        sums[r] = (weights / np.where(lit, medium[:, 0], 1.0)) @ medium[:, 1:]
        opacity[r] = weights.sum()
        if opacity[r] > 0:
            depth[r] = weights @ (0.5 * (ends[:-1] + ends[1:])) / opacity[r]
    color = sums
    if deferred:
        color = opacity[:, None] * color_of_sums(field, sums, opacity)
    color = color + (1.0 - opacity)[:, None] * np.asarray(background, float)
    return color, opacity, depth


def color_of_sums(field: TetField, sums, opacity):
    """The colors of rays from the sums of h and of rest directions along them.

    Args:
        sums: Weighted by the samples' weights, [R, 16 + 3].
        opacity: The sums of these weights.  [R]

    Returns:
        [R, 3]; those of a ray without opacity mean nothing.
    """
    means = sums / np.maximum(opacity, NEGLIGIBLE)[:, None]
    h, direction = np.split(means, [GEOMETRY_FEATURES], axis=1)
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1), NEGLIGIBLE)[:, None]
    return field.colors(h, spherical_harmonics(direction))
