"""Quadratic tets: the matrices of each.

A tet has ten nodes, its corners and the middles of its edges, and in barycentric coordinates
the shape functions λ_i (2 λ_i − 1) and 4 λ_i λ_j.  With Lamé's constants λ and μ

    K_ab = ∫ λ ∂_i N_a ∂_j N_b + μ ∂_j N_a ∂_i N_b + μ δ_ij ∇N_a · ∇N_b,   M_ab = ∫ N_a N_b

Units: SI.  Shapes: T tets; ten nodes in the order of corners, then the middles of EDGES.
"""

import math

import numpy as np

from ..geometry import EDGES, signed_volumes

# Quadrature that is exact for quadratic functions: four points of equal weight.
NEAR, FAR = (5.0 + 3.0 * math.sqrt(5.0)) / 20.0, (5.0 - math.sqrt(5.0)) / 20.0
POINTS = np.full((4, 4), FAR) + (NEAR - FAR) * np.eye(4)


def element_stiffnesses(vertices, tets, lame, mu):
    """K of each tet, x y z of each node.  [T, 30, 30] N/m"""
    products = _gradient_products(vertices, tets)
    blocks = lame * products + mu * products.swapaxes(3, 4)
    blocks += mu * np.trace(products, axis1=3, axis2=4)[..., None, None] * np.eye(3)
    return blocks.swapaxes(2, 3).reshape(-1, 30, 30)


def barycentric_slopes(vertices, tets):
    """∇λ of each corner.  [T, 4, 3] 1/m"""
    corners = vertices[tets]
    inner = np.linalg.inv((corners[:, 1:] - corners[:, :1]).swapaxes(1, 2))
    return np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)


def _gradient_products(vertices, tets):
    """∫ ∂_i N_a ∂_j N_b.  [T, 10, 10, 3, 3]"""
    slopes, products = barycentric_slopes(vertices, tets), 0.0
    for point in POINTS:
        derivatives = np.zeros((10, 4))  # ∂N_a/∂λ_i at this point
        derivatives[np.arange(4), np.arange(4)] = 4.0 * point - 1.0
        for row, (i, j) in zip(derivatives[4:], EDGES, strict=True):
            row[i], row[j] = 4.0 * point[j], 4.0 * point[i]
        gradients = derivatives @ slopes  # [T, 10, 3]
        products = products + gradients[:, :, None, :, None] * gradients[:, None, :, None, :]
    volumes = np.abs(signed_volumes(vertices, tets))
    return 0.25 * volumes[:, None, None, None, None] * products


def reference_mass():
    """∫ N_a N_b over a tet of volume 1, from 420ths of whole numbers.  [10, 10]"""
    mass = np.empty((10, 10))
    mass[:4, :4] = 1.0 + 5.0 * np.eye(4)
    at = (EDGES[:, :, None] == np.arange(4)).any(axis=1)  # corner at edge [6, 4]
    mass[4:, :4] = np.where(at, -4.0, -6.0)
    mass[:4, 4:] = mass[4:, :4].T
    mass[4:, 4:] = 8.0 * (1.0 + (at[:, None] & at[None]).sum(axis=2))
    mass[4:, 4:][np.eye(6, dtype=bool)] = 32.0
    return mass / 420.0


def consistent_masses(vertices, tets):
    """M of each tet, the same for x, y and z, for a density of 1.  [T, 10, 10] m³"""
    return np.abs(signed_volumes(vertices, tets))[:, None, None] * reference_mass()
