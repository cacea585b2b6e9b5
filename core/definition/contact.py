"""Contact: a vertex of the surface, or the middle of an edge, and a triangle of the surface.

    p, q, s        the point y = (1 − s) x_p + s x_q; a vertex has p = q and s = 0
    a, b, c        the triangle; n its unit normal, out of the body
    b_a, b_b, b_c  barycentric coordinates in it of y's projection; for g, those below 0 become 0,
                   and all are divided by their sum
    C              height of y above the triangle [m]; the constraint is C ≥ 0
    g              (1 − s, s, −b_a, −b_b, −b_c); the gradients of C are g_i n
    u, C'          Σ g_i Δx_i, the motion since the substep's start [m]; C − n · u: C at that start
    D              Σ w_i |g_i| l_i over the five vertices;  w inverse masses [1/kg]
    h, μ           substep [s], Coulomb's coefficient;  N contacts, V vertices

A contact is active while C < 0 and y is behind its triangle and no other (`is_behind`).  Then

    x_i ← x_i + w_i g_i λ n,           λ = (min(C', 0) − C)⁺ / D        no further approach
    x_i ← x_i − w_i g_i u_t min(1, μ λ D / |u_t|) / D                   friction
    x_i ← x_i + w_i g_i r n / D,       r = min(β e min(e/d, 1), h v)    out of the body, gently

with u_t the part of u along the triangle, e = (−C')⁺, β = 0.4, a depth d and a speed v.  The third
move is also added to the positions at the substep's start, so that it adds no velocity.

Where λ > 0, velocities are stopped, too.  With u_n and v_n the parts along n of u and of the
relative velocity, and v_t the rest of that velocity,

    λ' = (u_n + λ D − h v_n)⁺ / D
    v_i ← v_i + w_i g_i (λ' n / h − v_t min(1, μ λ' D / (h |v_t|)) / D)

A velocity of (x − x before) / h stays one.

All contacts are projected from the same positions.  A vertex divides its mass among its active
contacts in proportion to |g_i|: l_i is the sum of its |g_i| over them.  Its copy in one contact has
the inverse mass w_i l_i / |g_i|.  The vertex moves by the mean of its copies' moves, weighted by
their masses: Σ w_i g_i λ n.  So rigid bodies stop exactly, however many contacts they have.
"""

from typing import NamedTuple

import numpy as np

CONTACT_SHARE_OUT = 0.4  # β
CONTACT_SLACK = 1e-4  # barycentric: a point so far beside a triangle still belongs to it
TINY = 1e-300  # in place of a divisor of 0


class Contacts(NamedTuple):
    """The contacts of a frame, as core/deform/contact finds them."""

    vertices: np.ndarray  # [N, 5] int p, q, a, b, c
    shares: np.ndarray  # [N] s
    bevels: np.ndarray  # [N, 9] see `is_behind`
    soft_depth: float  # d [m]
    speed: float  # v [m/s]


def push_apart(contacts: Contacts, x, before, v, w, h, friction):
    """Positions now and at the substep's start, and velocities, afterwards.  3 × [V, 3]"""
    ids, s = contacts.vertices, contacts.shares[:, None]
    point = (1.0 - s) * x[ids[:, 0]] + s * x[ids[:, 1]]
    a, b, c = (x[ids[:, i]] for i in (2, 3, 4))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)  # of the parallelogram
    normal /= np.maximum(area, TINY)[:, None]
    height = (normal * (point - a)).sum(axis=1)  # C
    corners = plane_weights(point - a, b - a, c - a)
    active = (height < 0.0) & (area > 0.0) & is_behind(contacts.bevels, corners, height, area)
    corners = np.maximum(corners, 0.0)
    corners /= np.maximum(corners.sum(axis=1), TINY)[:, None]
    g = np.concatenate([1.0 - s, s, -corners], axis=1)
    loads = np.bincount(ids[active].ravel(), np.abs(g[active]).ravel(), minlength=len(x))
    total = (loads[ids] * w[ids] * np.abs(g)).sum(axis=1)  # D
    per_total = np.where(active & (total > 0.0), 1.0 / np.where(total > 0.0, total, 1.0), 0.0)
    u = (g[:, :, None] * (x - before)[ids]).sum(axis=1)
    approach = (normal * u).sum(axis=1)  # C − C'
    start = np.minimum(height - approach, 0.0)  # −e
    push = np.maximum(start - height, 0.0)  # λ D
    wanted = -CONTACT_SHARE_OUT * start * np.minimum(-start / contacts.soft_depth, 1.0)
    out = np.minimum(wanted, h * contacts.speed)  # r
    sliding = u - approach[:, None] * normal  # u_t
    held = np.minimum(1.0, friction * push / np.maximum(np.linalg.norm(sliding, axis=1), TINY))
    impulse = per_total[:, None] * (push[:, None] * normal - held[:, None] * sliding)
    shift = per_total[:, None] * out[:, None] * normal
    u = (g[:, :, None] * v[ids]).sum(axis=1)  # now the relative velocity
    speed = (normal * u).sum(axis=1)
    stopped = np.where(push > 0.0, np.maximum(approach + push - h * speed, 0.0), 0.0)
    sliding = u - speed[:, None] * normal
    ways = h * np.linalg.norm(sliding, axis=1)
    held = np.minimum(1.0, friction * stopped / np.maximum(ways, TINY))
    kick = per_total[:, None] * (stopped[:, None] / h * normal - held[:, None] * sliding)
    x, before, v = x.copy(), before.copy(), v.copy()
    shares = (w[ids] * g)[:, :, None]
    np.add.at(v, ids, shares * kick[:, None])
    np.add.at(x, ids, shares * (impulse + shift)[:, None])
    np.add.at(before, ids, shares * shift[:, None])
    return x, before, v


def is_behind(bevels, corners, height, area):
    """Whether points are behind their triangle, and not nearer to the face across an edge.  [N]

    A point of depth δ = −C is nearer to that face unless its projection is more than δ k from the
    edge, k = tan(θ/2) and θ the angle between the normals.  That distance is the coordinate of the
    opposite corner, of `corners` [N, 3], times `area` [N] over the edge's length.  `bevels` [N, 9]
    are k times that length, and the least and the largest coordinate, of three corners each: beside
    a sharp edge is a rim without contacts, or bodies that slide over another would hit its edges.
    """
    distance = (corners + CONTACT_SLACK) * area[:, None] ** 2
    behind = (distance >= -(height * area)[:, None] * bevels[:, :3]).all(axis=1)
    behind &= (corners >= bevels[:, 3:6]).all(axis=1)
    return behind & (corners <= bevels[:, 6:]).all(axis=1)


def plane_weights(r, e1, e2):
    """Barycentric coordinates of r's projection onto triangles 0, e1, e2.  3 × [N, 3] -> [N, 3]"""
    normal = np.cross(e1, e2)
    squared = np.maximum((normal**2).sum(-1), TINY)
    second = (np.cross(r, e2) * normal).sum(-1) / squared
    third = (np.cross(e1, r) * normal).sum(-1) / squared
    return np.stack([1.0 - second - third, second, third], axis=-1)
