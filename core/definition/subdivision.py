"""Recursive subdivision of a tet, by barycentric coordinates alone.

    α     [N, 4]   barycentric coordinates of a point in a tet; their sum is 1
    m_ij           middle of the edge between corners i and j; m_ii is corner i itself
    k     [N] int  a child, 0..7
    p     [N] int  path to a descendant: 0 for the coarse tet, 8 p + k for child k of p

The middles of its edges split a tet into eight children: four at the corners (0..3) and four around
the inner diagonal m02-m13 (4..7).  A point descends one level by                (DeformRF, 3.2)

    α' = C_k α,        k = i if α_i ≥ ½, else 4 + [α1 + α2 ≥ ½] + 2 [α2 + α3 ≥ ½]

The columns of C_k⁻¹ are the corners of child k in its parent.  The children are the paper's; with
corners in Bey's order ("Tetrahedral grid refinement", 1995), descendants have three shapes at most.
Positions are not used: a point keeps its α, and so its descendants, when the mesh deforms.
"""

import numpy as np

# i and j of the four corners m_ij of each child.  [8, 4, 2]
CHILD_VERTICES = np.array(
    [
        [(0, 0), (0, 1), (0, 2), (0, 3)],
        [(0, 1), (1, 1), (1, 2), (1, 3)],
        [(0, 2), (1, 2), (2, 2), (2, 3)],
        [(0, 3), (1, 3), (2, 3), (3, 3)],
        [(0, 1), (0, 2), (0, 3), (1, 3)],
        [(0, 1), (0, 2), (1, 2), (1, 3)],
        [(0, 2), (0, 3), (1, 3), (2, 3)],
        [(0, 2), (1, 2), (1, 3), (2, 3)],
    ]
)
PARENT_FROM_CHILD = np.eye(4)[CHILD_VERTICES].mean(axis=2).swapaxes(1, 2)  # C⁻¹  [8, 4, 4]
CHILD_FROM_PARENT = np.linalg.inv(PARENT_FROM_CHILD)  # C  [8, 4, 4]


def descend(alpha):
    """The child that holds each point, k [N], and the point's coordinates in it, C_k α [N, 4]."""
    at_corner = alpha.argmax(axis=-1)
    inside = 4 + 1 * (alpha[:, 1] + alpha[:, 2] >= 0.5) + 2 * (alpha[:, 2] + alpha[:, 3] >= 0.5)
    k = np.where(alpha.max(axis=-1) >= 0.5, at_corner, inside)
    return k, np.einsum("nij,nj->ni", CHILD_FROM_PARENT[k], alpha)


def child_path(alpha, levels):
    """The path p to the descendant that holds each point, `levels` below the coarse tet.  [N]"""
    path = np.zeros(len(alpha), np.int64)
    for _ in range(levels):
        k, alpha = descend(alpha)
        path = 8 * path + k
    return path


def child_addresses(corners, k):
    """The addresses of the corners of child k of each tet.  [N, 4, 3] int, [N] -> [N, 4, 3]

    Addresses count steps of their own level, half as long as those of the level above.  So m_ij has
    the sum of the addresses of i and j: a whole number, the same from every tet around the edge.
    """
    rows = np.arange(len(k))[:, None]
    return corners[rows, CHILD_VERTICES[k, :, 0]] + corners[rows, CHILD_VERTICES[k, :, 1]]
