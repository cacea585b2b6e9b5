"""Fit the springs of thin parts to quadratic elements on the same tets.

The factors of a lattice (isotropy.py) are those of its endless inside.  What the springs of a
sheet of 1 to 2.5 cells resist depends on the direction and the height of its cut by up to 40 %,
so no table of edges has it.  Therefore each thin piece of a mesh (thin.py) is solved at rest, as
quadratic elements and as springs with volumes: clamped at each of its four ends, to each depth,
under the six loads that would accelerate it rigidly.  The work that two loads do on
each other's displacements, W_ij = F_i · u_j, shall be the same.

If the stiffness k of a spring that load i stretches by s_i grows by a factor e^θ, W_ij falls by
θ k s_i s_j to first order.  Gauss-Newton steps find ln f of all edges from it; of all that give
about the same work, those nearest to the start are taken (SHEET_FACTORS).

Units: the shear modulus and the density are 1.
Shapes: V vertices, E edges, T tets, P clamps.
"""

import logging
from dataclasses import dataclass

import numpy as np

from ..geometry import signed_volumes
from .isotropy import SHEET_FACTORS, edge_factors
from .layers import Layers
from .locking import volume_shares
from .quadratic import barycentric_slopes, consistent_masses, element_stiffnesses
from .thin import on_surface, pieces, thinness

RATIO = 0.35  # Poisson's ratio at which sheets are fitted
SLOPE = 0.25  # of ln f over the ratio: without it a cell sags by 2.5 % too much at 0.45
ENDS = np.pi / 2.0 * np.arange(4)  # angles of the clamped ends, about the axis of least size
TIES = 1e-6, 2e-6, 3e-6  # rounding must not choose the axes of a ring
DEPTH = 0.5  # of the clamps, one to the next [mean edges]: with 1, those between err by up to 57 %
STEPS, LONGEST_STEP, LARGEST = 4, 0.7, 2.0  # of ln f
RIDGE = 0.007  # what a change of ln f costs, beside a relative error of work (docs/trials.md)
HINGE = 3.0  # where springs and elements differ more, a part turns about the clamp
FLAT = 1e-6  # of the mean volume
DECIMALS = 3  # of ln f, so that the order of sums in a library does not show
FIRST, SECOND = np.triu_indices(6)  # pairs of loads
log = logging.getLogger(__name__)
TWICE = np.where(FIRST == SECOND, 1.0, np.sqrt(2.0))


@dataclass(frozen=True)
class Springs:
    """What is fitted: a mesh, and its springs."""

    vertices: np.ndarray  # [V, 3]
    tets: np.ndarray  # [T, 4] none is flat
    ends: np.ndarray  # [E, 2]
    edges_of: np.ndarray  # [T, 6] the edge of each of EDGES
    factors: np.ndarray  # [E] f at the start
    shares: np.ndarray  # [T] volume_shares

    def part(self, chosen):
        """These tets alone, and the edges that they have.  Springs, [·] int"""
        vertices, tets = np.unique(self.tets[chosen], return_inverse=True)
        edges, edges_of = np.unique(self.edges_of[chosen], return_inverse=True)
        ends = np.searchsorted(vertices, self.ends[edges])
        shapes = tets.reshape(-1, 4), ends, edges_of.reshape(-1, 6)
        values = self.factors[edges], self.shares[chosen]
        return Springs(self.vertices[vertices], *shapes, *values), edges


def sheet_ratios(vertices, tets, ends, edges_of, lengths):
    """The factor of each edge where the mesh is thin over that of its lattice, 1 elsewhere.

    Returns:
        Those at RATIO, and how their logarithms grow with Poisson's ratio.  [2, E]

    Args:
        ends: [E, 2]
        edges_of: The edge of each of EDGES of each tet.  [T, 6]
        lengths: [E]
    """
    of_lattice = edge_factors(lengths)
    ratios = edge_factors(lengths, SHEET_FACTORS) / of_lattice
    weights = thinness(tets, ends, len(vertices))
    if (ratios == 1.0).all() or not weights.any():
        return np.stack([np.ones(len(ends)), np.zeros(len(ends))])
    outer = on_surface(tets, len(vertices))[ends].all(axis=1)
    ratios **= np.where(outer, weights[ends].mean(axis=1), 0.0)
    volumes = np.abs(signed_volumes(vertices, tets))
    solid = volumes > FLAT * volumes.mean()
    tets, edges_of = tets[solid], edges_of[solid]
    shares = volume_shares(vertices, tets, volumes[solid])
    springs = Springs(vertices, tets, ends, edges_of, of_lattice * ratios, shares)
    thin = weights > 0.0
    logs = fitted_logs(springs, thin[tets].any(axis=1))
    slopes = SLOPE * (weights == 1.0)[ends].mean(axis=1)
    return np.stack([ratios * np.exp(thin[ends].mean(axis=1) * logs), slopes])


def fitted_logs(springs: Springs, chosen):
    """ln f of each edge over that at the start; 0 for edges of no chosen tet.  [E]

    Args:
        chosen: [T] bool
    """
    total, count = np.zeros((2, len(springs.ends)))
    for tets, own in pieces(springs.tets, springs.vertices[springs.tets].mean(axis=1), chosen):
        part, edges = springs.part(tets)
        inner = np.unique(part.edges_of[own])
        total[edges[inner]] += _fit_or_none(part)[inner]
        count[edges[inner]] += 1.0
    return np.round(total / np.maximum(count, 1.0), DECIMALS)


def _fit_or_none(springs):
    try:
        logs = fit(springs)
    except np.linalg.LinAlgError:
        logs = np.full(1, np.nan)
    if np.isfinite(logs).all():
        return logs
    log.warning(
        "a thin part of %d tets can't be fitted: tables tell its stiffness", len(springs.tets)
    )
    return np.zeros(len(springs.ends))


def fit(springs: Springs):
    """ln f of each edge over that at the start.  [E]"""
    logs = np.zeros(len(springs.ends))
    cases = []
    for layers in clamped_ends(springs):
        goal = quadratic_works(springs, layers)
        ours, _ = spring_works(springs, logs, layers)
        own, others = np.einsum("pii->pi", ours), np.einsum("pii->pi", goal)
        bends = (np.abs(np.log(own / others)) < np.log(HINGE)).all(axis=1)
        cases.append((layers, goal, bends))
    if not any(bends.any() for _, _, bends in cases):
        return logs
    for _ in range(STEPS):
        gaps, slopes = zip(*(_errors(springs, logs, *case) for case in cases), strict=True)
        gaps, slopes = np.concatenate(gaps), np.concatenate(slopes)
        cost = RIDGE**2 * len(gaps) / len(FIRST) * np.eye(len(gaps))
        best = -slopes.T @ np.linalg.solve(slopes @ slopes.T + cost, gaps - slopes @ logs)
        step = best - logs
        step *= LONGEST_STEP / max(np.abs(step).max(), LONGEST_STEP)
        logs = np.clip(logs + step, -LARGEST, LARGEST)
    return logs


def _errors(springs, logs, layers, goal, bends):
    """Relative errors of work for each clamp and pair of loads, and how they change with ln f."""
    works, stretches = spring_works(springs, logs, layers)
    scales = 1.0 / np.sqrt(np.einsum("pii->pi", goal))[bends]
    gaps = (works - goal)[bends] * scales[:, :, None] * scales[:, None]
    scaled = stretches[bends] * scales[:, None]
    slopes = -scaled[:, :, FIRST] * scaled[:, :, SECOND] * TWICE
    slopes = slopes.swapaxes(1, 2).reshape(-1, len(logs))
    return (gaps[:, FIRST, SECOND] * TWICE).ravel(), slopes


def clamped_ends(springs):
    """For each end the layer of each vertex: how many DEPTHs it is away from there.  [V] int"""
    offsets = springs.vertices - springs.vertices.mean(axis=0)
    spread = offsets.T @ offsets
    axes = np.linalg.eigh(spread + np.trace(spread) * np.diag(TIES))[1]
    length = np.linalg.norm(np.diff(springs.vertices[springs.ends], axis=1), axis=2).mean()
    for angle in ENDS:
        along = offsets @ (np.cos(angle) * axes[:, 2] + np.sin(angle) * axes[:, 1])
        depths = ((along - along.min()) / (DEPTH * length)).astype(int)
        layers = np.unique(depths, return_inverse=True)[1]
        if layers.max() > 0:
            yield layers


def rigid_fields(points, center):
    """Unit accelerations along the axes, and unit angular ones about them.  [N, 3, 6]"""
    moved = [np.broadcast_to(axis, points.shape) for axis in np.eye(3)]
    turned = [np.cross(axis, points - center) for axis in np.eye(3)]
    return np.stack(moved + turned, axis=2)


def quadratic_works(springs, layers):
    """W of quadratic elements, where the layers 0, 0 to 1, … are held.  [P, 6, 6]

    A node between two held vertices is held.
    """
    vertices, count = springs.vertices, len(springs.vertices)
    nodes = np.concatenate([vertices, vertices[springs.ends].mean(axis=1)])
    tets = np.concatenate([springs.tets, springs.edges_of + count], axis=1)
    of_ends = layers[springs.ends]
    fields = rigid_fields(nodes, vertices.mean(axis=0))
    forces = consistent_masses(vertices, springs.tets) @ fields[tets].reshape(-1, 10, 18)
    loads = np.zeros(fields.shape)
    np.add.at(loads, tets, forces.reshape(-1, 10, 3, 6))
    lame = 2.0 * RATIO / (1.0 - 2.0 * RATIO)
    elements = [(tets, element_stiffnesses(vertices, springs.tets, lame, 1.0))]
    return Layers(nodes, np.append(layers, of_ends.max(axis=1)), elements, loads).works


def spring_works(springs, logs, layers):
    """W of springs and volumes, and √k s of each spring.  [P, 6, 6], [P, E, 6]"""
    vertices, tets = springs.vertices, springs.tets
    volumes = np.abs(signed_volumes(vertices, tets))
    spans = np.diff(vertices[springs.ends], axis=1)[:, 0]
    lengths = np.linalg.norm(spans, axis=1)
    around = np.bincount(springs.edges_of.ravel(), np.repeat(volumes / 6.0, 6), len(lengths))
    stiffnesses = 15.0 * springs.factors * np.exp(logs) * around / lengths**2
    rates = np.concatenate([-spans, spans], axis=1) * (np.sqrt(stiffnesses) / lengths)[:, None]
    bulk = (4.0 * RATIO - 1.0) / (1.0 - 2.0 * RATIO)  # material.py
    holds = springs.shares > 0
    slopes = barycentric_slopes(vertices, tets[holds]).reshape(-1, 12)
    slopes = slopes * np.sqrt(bulk * springs.shares * volumes)[holds, None]
    elements = [
        (springs.ends, rates[:, :, None] * rates[:, None]),
        (tets[holds], slopes[:, :, None] * slopes[:, None]),
    ]
    masses = np.bincount(tets.ravel(), np.repeat(volumes / 4.0, 4), len(vertices))
    loads = masses[:, None, None] * rigid_fields(vertices, vertices.mean(axis=0))
    solved = Layers(vertices, layers, elements, loads)
    ways = (moved[springs.ends].reshape(-1, 6, 6) for moved in solved.moved())
    return solved.works, np.stack([np.einsum("ei,eil->el", rates, way) for way in ways])
