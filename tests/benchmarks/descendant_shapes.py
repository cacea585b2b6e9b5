"""Shapes of the lattice's tets after some subdivisions, by order of children and of corners.

    python tests/benchmarks/descendant_shapes.py [--levels 5]

"As found" lists a tet's corners lexicographically, the last two swapped if it is inverted.
"""

import argparse

import numpy as np

from deformrf.core.definition.subdivision import CHILD_VERTICES
from deformrf.core.geometry import A15, EDGES, cell_tets
from deformrf.core.geometry.mesh import FACES

PUBLISHED_CHILD_VERTICES = np.array(
    [
        [(0, 0), (0, 1), (0, 2), (0, 3)],
        [(1, 1), (1, 2), (0, 1), (1, 3)],
        [(2, 2), (0, 2), (1, 2), (2, 3)],
        [(3, 3), (0, 3), (2, 3), (1, 3)],
        [(0, 1), (0, 2), (0, 3), (1, 3)],
        [(0, 1), (0, 2), (1, 3), (1, 2)],
        [(2, 3), (0, 2), (1, 3), (0, 3)],
        [(2, 3), (0, 2), (1, 2), (1, 3)],
    ]
)  # as CHILD_VERTICES; the order that the matrices of the paper's supplement imply


def determinants(tets):
    """Six times the signed volumes.  [T]"""
    return np.linalg.det(tets[:, 1:] - tets[:, :1])


def as_found(tets):
    order = np.lexsort(tets.transpose(2, 0, 1)[::-1], axis=1)
    tets = np.take_along_axis(tets, order[..., None], axis=1)
    inverted = determinants(tets) < 0
    tets[inverted] = tets[inverted][:, [0, 1, 3, 2]]
    return tets


def descendants(tet, child_vertices, levels):
    """Scaled by 2^levels, so they are integers.  [8^levels, 4, 3]"""
    tets = tet[None]
    for _ in range(levels):
        a, b = child_vertices[..., 0], child_vertices[..., 1]
        tets = (tets[:, a] + tets[:, b]).reshape(-1, 4, 3)
    return tets


def dihedral_angles(tets):
    """Degrees.  [T, 12], each twice"""
    a, b, c = (tets[:, FACES[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals = normals / np.linalg.norm(normals, axis=2, keepdims=True)
    cosines = np.einsum("tix,tjx->tij", normals, normals)[:, ~np.eye(4, dtype=bool)]
    return 180.0 - np.degrees(np.arccos(cosines))


def measure(cell, child_vertices, levels):
    ratios, angles, edge_ratios, shape_counts = [], [], [], []
    for tet in cell:
        tets = descendants(tet, child_vertices, levels)
        squared = ((tets[:, EDGES[:, 0]] - tets[:, EDGES[:, 1]]) ** 2).sum(axis=-1)
        volumes = np.abs(determinants(tets)) / 6.0
        ratios.append(12.0 * (3.0 * volumes) ** (2 / 3) / squared.sum(axis=1))
        found = dihedral_angles(tets)
        angles += [found.min(), found.max()]
        edge_ratios.append(np.sqrt((squared.max(axis=1) / squared.min(axis=1)).max()))
        # Volumes are equal, so similar tets have equal edges.
        shape_counts.append(len(np.unique(np.sort(squared, axis=1), axis=0)))
    return (
        max(shape_counts),
        np.mean(ratios),
        np.min(ratios),
        min(angles),
        max(angles),
        max(edge_ratios),
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--levels", type=int, default=5)
    levels = parser.parse_args().levels
    best = cell_tets(A15)
    print(f"{'children, corners':<24}{'shapes':>7}{'mean ratio':>18}{'dihedral':>16}{'edges':>7}")
    for name, cell, child_vertices in (
        ("published, as found", as_found(best), PUBLISHED_CHILD_VERTICES),
        ("published, best for Bey", best, PUBLISHED_CHILD_VERTICES),
        ("Bey, as found", as_found(best), CHILD_VERTICES),
        ("Bey, best", best, CHILD_VERTICES),
    ):
        shapes, mean, worst, low, high, edges = measure(cell, child_vertices, levels)
        print(
            f"{name:<24}{shapes:>7}{mean:>10.3f} /{worst:>6.3f}"
            f"{low:>8.1f} to{high:>6.1f}{edges:>6.2f}"
        )


if __name__ == "__main__":
    main()
