"""Bodies that touch: flat boxes and rings of Kuhn's lattice, pairs of balls, and an arm.

A body is (vertices [V, 3], tets [T, 4]).
"""

from itertools import pairwise, permutations

import numpy as np

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver
from deformrf.core.deform.contact.contact import Contact
from deformrf.core.geometry import a15_grid, extract, signed_volumes

BAR_CELLS = (2, 2)  # across a ring


def box(cells, edge):
    """A box with flat faces: so many cells of this edge in x, y and z, one corner in the origin."""
    points = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1)
    shape = np.array(cells) + 1
    return points.reshape(-1, 3) * edge, _cut(cells, shape, points.reshape(-1, 3).astype(float))


def ring(around, radius, width):
    """A ring in the plane z = 0 around the origin, its section a square of this width."""
    cells = (around, *BAR_CELLS)
    axes = np.arange(around), *(np.arange(n + 1) for n in BAR_CELLS)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    angle = 2.0 * np.pi * points[:, 0] / around
    out, up = (width * (points[:, i] / BAR_CELLS[i - 1] - 0.5) for i in (1, 2))
    vertices = np.stack(
        [(radius + out) * np.cos(angle), (radius + out) * np.sin(angle), up], axis=1
    )
    return vertices, _cut(cells, (around, BAR_CELLS[0] + 1, BAR_CELLS[1] + 1), vertices)


def _cut(cells, shape, vertices):
    """The tets of a grid of cells, six each; indices beyond the shape wrap around."""
    corner = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1)
    corner = corner.reshape(-1, 3)
    tets = []
    for order in permutations(np.eye(3, dtype=int)):
        path = [corner, *(corner + np.sum(order[: i + 1], axis=0) for i in range(3))]
        tets.append(np.stack([np.ravel_multi_index(p.T, shape, "wrap") for p in path], axis=1))
    tets = np.concatenate(tets).astype(np.int32)
    inside_out = signed_volumes(vertices, tets) < 0.0
    tets[inside_out] = tets[inside_out][:, [0, 1, 3, 2]]
    return tets


def joined(*bodies):
    """Several bodies as one mesh, and the vertices of each as slices."""
    ends = np.cumsum([0, *(len(vertices) for vertices, _ in bodies)])
    tets = [own + first for (_, own), first in zip(bodies, ends, strict=False)]
    slices = [slice(*pair) for pair in pairwise(ends)]
    return np.concatenate([vertices for vertices, _ in bodies]), np.concatenate(tets), slices


def two_balls(spacing, apart):
    """Two balls of diameter 0.6, their middles this far apart in z."""
    mesh = a15_grid(spacing / 0.6)
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1)
    ball, _ = extract(mesh, np.linalg.norm(middles - 0.5, axis=1) < 0.5)
    vertices = 0.6 * ball.rest_vertices
    return joined((vertices, ball.tets), (vertices + np.array([0.0, 0.0, apart]), ball.tets))


def linked_rings():
    """Two rings, the second one through the first."""
    vertices, tets = ring(24, 0.3, 0.12)
    turned = vertices[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    return joined((vertices, tets), (turned + np.array([0.3, 0.0, 0.0]), tets))


def linking_number(first, second):
    """How often two closed lines [N, 3] go through each other, by Gauss's integral."""
    ways = [np.roll(line, -1, axis=0) - line for line in (first, second)]
    middles = [line + way / 2.0 for line, way in zip((first, second), ways, strict=True)]
    between = middles[0][:, None] - middles[1]
    normals = np.cross(ways[0][:, None], ways[1])
    parts = (between * normals).sum(axis=-1) / np.linalg.norm(between, axis=-1) ** 3
    return parts.sum() / (4.0 * np.pi)


def body_with_arm(edge=0.07):
    """A block and an arm beside it, on a common base; the arm is at x > 11 edges."""
    vertices, tets = box((14, 4, 14), edge)
    x, y, z = vertices[tets].mean(axis=1).T / edge
    kept = tets[(z < 3) | (x < 7) | ((x > 11) & (y > 1) & (y < 3))]
    used, new = np.unique(kept, return_inverse=True)
    return vertices[used], new.reshape(-1, 4).astype(np.int32)


def pressed_balls(device, depth, dt):
    """Two balls of which one moves into the other at random; their contacts in the next frame.

    Args:
        depth: How far they are in each other at first [m].

    Returns:
        The solver, a Contact of its state, positions and velocities [V, 3].
    """
    random = np.random.default_rng()
    rest, tets, (_, upper) = two_balls(0.095, 1.0)
    free = np.zeros(len(rest), bool)
    solver = XpbdSolver(rest, tets, Material(damping=0.0), free, XpbdOptions(rescue=False), device)
    state = rest + random.normal(scale=0.004, size=rest.shape)
    state[upper] += [*random.uniform(-0.05, 0.05, 2), -0.44 - depth]
    velocities = 0.3 * random.normal(size=rest.shape)
    velocities[upper, 2] -= 1.0
    state, velocities = (a.astype(np.float32).astype(np.float64) for a in (state, velocities))
    solver.set_state(state, velocities)
    contact = Contact(solver.rest_vertices, solver.volumes.vertices, solver._state)
    contact.find(dt, np.ones(2, bool), np.zeros(2, bool))
    return solver, contact, state, velocities
