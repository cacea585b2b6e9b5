"""The image of a deformed field.  Four lines define it, in every pose.

    o, d          [3]      origin and unit direction of a ray; a point of it is o + t d
    α(t)          [T, 4]   barycentric coordinates along the ray, linear in t
    F⁻¹, Q, s              of each tet (deformation.py)
    σ, h, color            at a point (networks.py);  Δ, the field's `piece_length`
    R rays, N pieces of rays

1. Pieces.  A ray, t ≥ 0, is in a tet while no coordinate of α(t) is negative.  Each tet cuts its
   own interval of the ray, from its own entry, into pieces of length Δ at rest, the last one
   shorter.  A step of 1 in t is |F⁻¹d| long at rest.
2. Values.  σ is constant on a piece: its value at the piece's middle, or 0 if the mask's bit there
   is 0.  The color c is constant, too: the color network computes it from h and the direction at
   rest, Qᵀd.  If the field has `color_per_ray`, h and Qᵀd themselves are constant on a piece.
3. Extinction.  κ = s σ |F⁻¹d| per unit of t.  So a tet is as opaque as at rest,
   however far it is stretched.
4. Sum.  The ends of all pieces of a ray cut it into intervals.  Within one, of length dt and with
   transmittance T in front of it, the media of the pieces that cover it add up:

       τ = Σκ dt,   w = T (1 − exp(−τ)),   c = Σκc / Σκ           over the pieces
       pixel = Σ w c + (1 − Σ w) background                       over the intervals

   With `color_per_ray`, h and Qᵀd are summed in place of c.  The color network runs once, on
   Σwh / Σw and ΣwQᵀd / Σw, the latter brought to length 1.  Its color times Σw stands for Σ w c.

Where tets don't overlap, line 4 is Eq. 1 of the paper.  Where they do, after a fold or with tets
inside out, the pixel depends on the vertices alone and not on an order of the tets.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .deformation import Deformation, deformation
from .networks import GEOMETRY_FEATURES, Field, colors, geometry, is_occupied, sigma_from

ROUNDING = 1e-12  # relative; a smaller α or slope is 0
ASIDE = 2e-6 * np.array([0.4124, 0.5763, 0.7056])  # how far a ray within a face is moved
NEGLIGIBLE = 1e-6  # the least divisor: an opacity, or the length of a mean direction
DARK = 1e-9  # a smaller Σκ counts as 0
AT_ONCE = 1 << 18  # pieces whose values are computed together: bounds the memory


class Pieces(NamedTuple):
    """Pieces of rays, ray by ray."""

    ray: np.ndarray  # [N] int
    tet: np.ndarray  # [N] int
    bary: np.ndarray  # [N, 4] α of the middle
    t_in: np.ndarray  # [N]
    t_out: np.ndarray  # [N]
    rest_direction: np.ndarray  # [N, 3] Qᵀd
    rate: np.ndarray  # [N] κ / σ = s |F⁻¹d|


def render_rays(field: Field, vertices, origins, directions, background):
    """Pixels [R, 3], opacity Σw [R] and depth Σwt / Σw [R] (0 where Σw = 0) of rays.

    `vertices` are the current ones [V, 3]; directions have length 1; `background` is a color [3].
    """
    pieces = ray_pieces(field, np.asarray(vertices, float), origins, directions)
    sigma, values = piece_values(field, pieces)
    kappa = sigma * pieces.rate
    sums = np.zeros((len(origins), values.shape[1]))
    opacity, depth = np.zeros(len(origins)), np.zeros(len(origins))
    bounds = np.searchsorted(pieces.ray, np.arange(len(origins) + 1))
    for ray, (first, last) in enumerate(pairwise(bounds)):
        if last > first:
            own = slice(first, last)
            along = kappa[own], values[own], pieces.t_in[own], pieces.t_out[own]
            sums[ray], opacity[ray], depth[ray] = sum_along(*along)
    color = ray_colors(field, sums, opacity) if field.color_per_ray else sums
    return color + (1.0 - opacity)[:, None] * np.asarray(background, float), opacity, depth


def ray_pieces(field: Field, vertices, origins, directions) -> Pieces:
    """Line 1 for all rays, without the pieces whose middle is masked."""
    tets = deformation(field.rest_vertices, vertices, field.tets)
    found = [
        pieces_of_ray(tets, ray, o, d, field.piece_length)
        for ray, (o, d) in enumerate(zip(origins, directions, strict=True))
    ]
    pieces = Pieces(*(np.concatenate(column) for column in zip(*found, strict=True)))
    occupied = is_occupied(field.masks, pieces.tet, pieces.bary)
    return Pieces(*(column[occupied] for column in pieces))


def pieces_of_ray(tets: Deformation, ray, o, d, piece_length) -> Pieces:
    """Line 1 for one ray, whose number is `ray`."""
    tet, t_in, t_out, alpha, slope = crossed_tets(tets, o, d)
    speed = np.linalg.norm(tets.inverse_f[tet] @ d, axis=1)  # |F⁻¹d|
    rest_length = (t_out - t_in) * speed
    count = np.ceil(rest_length / piece_length).astype(int)
    owner = np.repeat(np.arange(len(tet)), count)  # the crossing that each piece belongs to
    number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)  # 0, 1, ... in it
    low = number * piece_length
    high = np.minimum(low + piece_length, rest_length[owner])
    low, high = t_in[owner] + low / speed[owner], t_in[owner] + high / speed[owner]
    bary = alpha[owner] + (0.5 * (low + high))[:, None] * slope[owner]
    rest_direction = np.einsum("tji,j->ti", tets.rotations[tet], d)[owner]
    rate = (tets.fades[tet] * speed)[owner]
    return Pieces(np.full(len(owner), ray), tet[owner], bary, low, high, rest_direction, rate)


def crossed_tets(tets: Deformation, o, d):
    """The tets that a ray crosses: ids, t at entry (≥ 0) and exit [K], α at t = 0, dα/dt [K, 4].

    A ray within a face (α and slope 0) that two tets share belongs to the tet that it is in when it
    is moved by ASIDE: pieces in both would double the density.  Faded tets are left out.
    """
    linear = tets.gradients[:, :, :3]
    alpha, slope = linear @ o + tets.gradients[:, :, 3], linear @ d
    steepest = np.linalg.norm(linear, axis=2)  # the largest slope of any ray
    slope[np.abs(slope) <= ROUNDING * steepest] = 0.0
    on_face = np.abs(alpha) <= ROUNDING * (1.0 + steepest * np.linalg.norm(o))
    beyond = np.where(on_face, linear @ ASIDE, alpha) < 0
    outside = ((slope == 0) & beyond).any(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = -alpha / slope  # t where a coordinate is 0
    t_in = np.maximum(np.where(slope > 0, zero, -np.inf).max(axis=1), 0.0)
    t_out = np.where(slope < 0, zero, np.inf).min(axis=1)
    tet = np.flatnonzero((t_out > t_in) & ~outside & (tets.fades > 0))
    return tet, t_in[tet], t_out[tet], alpha[tet], slope[tet]


def piece_values(field: Field, pieces: Pieces):
    """Line 2: σ of pieces [N], and what rays sum of them: colors [N, 3], or h and Qᵀd [N, 19]."""
    sigma = np.empty(len(pieces.tet))
    values = np.empty((len(sigma), GEOMETRY_FEATURES + 3 if field.color_per_ray else 3))
    for first in range(0, len(sigma), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        h = geometry(field, pieces.tet[some], pieces.bary[some])
        directions = pieces.rest_direction[some]
        sigma[some] = sigma_from(h)
        if field.color_per_ray:
            values[some] = np.column_stack([h, directions])
        else:
            values[some] = colors(h, directions, field.color_layers)
    return sigma, values


def sum_along(kappa, values, t_in, t_out):
    """Line 4 for the pieces of one ray: Σw values [C], Σw, and Σwt / Σw, t the middles."""
    ends, places = np.unique(np.concatenate([t_in, t_out]), return_inverse=True)
    starts, stops = np.split(places, 2)
    # Σκ and Σκ·values of the intervals: a piece adds its own at its start, removes it at its stop
    own = np.column_stack([kappa, kappa[:, None] * values])
    media = np.zeros((len(ends), own.shape[1]))
    np.add.at(media, starts, own)
    np.add.at(media, stops, -own)
    media = np.cumsum(media, axis=0)[:-1]
    lit = media[:, 0] > DARK
    w = np.where(lit, weights(np.maximum(media[:, 0], 0.0) * np.diff(ends)), 0.0)
    sums = (w / np.where(lit, media[:, 0], 1.0)) @ media[:, 1:]
    opacity = w.sum()
    depth = w @ (0.5 * (ends[:-1] + ends[1:])) / opacity if opacity > 0 else 0.0
    return sums, opacity, depth


def weights(tau):
    """w_i = T_i (1 − exp(−τ_i)), T_i = exp(−Σ_{j<i} τ_j), of optical depths from front to back."""
    transmittance = np.exp(-np.concatenate([[0.0], np.cumsum(tau)]))[:-1]
    return transmittance * -np.expm1(-tau)


def ray_colors(field: Field, sums, opacity):
    """Colors of rays, times their opacity Σw [R], from Σwh and ΣwQᵀd [R, 19].  [R, 3]"""
    means = sums / np.maximum(opacity, NEGLIGIBLE)[:, None]
    h, direction = np.split(means, [GEOMETRY_FEATURES], axis=1)
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1), NEGLIGIBLE)[:, None]
    return opacity[:, None] * colors(h, direction, field.color_layers)
