"""Features to density and color: two small networks, and the field that they complete.

    features  [N, L F]     of points (encoding.py)
    h         [N, 16]      output of the density network
    σ         [N]          density per unit of rest length [1 / model unit]
    d         [N, 3]       unit direction of the ray, from the camera into the scene, at rest
    Y(d)      [N, 16]      real spherical harmonics of degree 0..3
    color     [N, 3]       red, green, blue in 0..1
    masks     [T] uint64   bit p: 1 if the descendant with path p, two levels down, may hold density

    h = density network(features),   σ = exp(min(h_0, 15))
    color = sigmoid(color network(h, Y(d)))

A network is a tuple of layers (weights [in, out], bias [out]) with ReLU between them.  Density has
one hidden layer; in the paper it has three, with sigmoids.  Any piece of density e¹⁵ is opaque.
"""

from dataclasses import dataclass

import numpy as np

from .encoding import Encoding, encode
from .subdivision import child_path

GEOMETRY_FEATURES = 16  # numbers in h
MAX_LOG_SIGMA = 15.0


@dataclass(frozen=True)
class Field:
    """What a model file holds: all that an image depends on, besides the current vertices."""

    rest_vertices: np.ndarray  # [V, 3] model units
    tets: np.ndarray  # [T, 4] int
    masks: np.ndarray  # [T] uint64
    encoding: Encoding
    density_layers: tuple
    color_layers: tuple
    piece_length: float  # Δ, see image.py; model units
    color_per_ray: bool  # files of version 3; else each sample has a color, as in the paper


def is_occupied(masks, tet, alpha):
    """Whether points, α in their tets, are in descendants that may hold density.  [N] bool"""
    path = child_path(alpha, levels=2).astype(np.uint64)
    return ((masks[tet] >> path) & np.uint64(1)) > 0


def geometry(field: Field, tet, alpha):
    """h of points, α in their tets.  [N, 16]"""
    return mlp(encode(field.encoding, tet, alpha), field.density_layers)


def sigma_from(h):
    """σ [N] from h [N, 16]."""
    return np.exp(np.minimum(h[:, 0], MAX_LOG_SIGMA))


def colors(h, directions, color_layers):
    """Colors for h [N, 16], seen along directions at rest [N, 3].  [N, 3]"""
    return sigmoid(color_logits(h, directions, color_layers))


def color_logits(h, directions, color_layers):
    """The same before the sigmoid."""
    return mlp(np.concatenate([h, spherical_harmonics(directions)], axis=1), color_layers)


def mlp(x, layers):
    """Apply a network.  [N, in] -> [N, out]"""
    for weights, bias in layers[:-1]:
        x = np.maximum(x @ weights + bias, 0.0)
    weights, bias = layers[-1]
    return x @ weights + bias


def sigmoid(x):
    """1 / (1 + exp(-x)) = ½ (tanh(x/2) + 1), which does not overflow."""
    return 0.5 * (np.tanh(0.5 * x) + 1.0)


def spherical_harmonics(directions):
    """Y_lm of unit vectors, orthonormal, l = 0..3, m = −l..l, signs (−1)^m.  [N, 3] -> [N, 16]"""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    functions = (
        np.full_like(x, 0.28209479177387814),  # √(1/4π)
        -0.4886025119029199 * y,  # √(3/4π)
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,  # √(15/4π)
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (3.0 * zz - 1.0),  # √(5/16π)
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3.0 * xx - yy),  # √(35/32π)
        2.890611442640554 * x * y * z,  # √(105/4π)
        -0.4570457994644658 * y * (5.0 * zz - 1.0),  # √(21/32π)
        0.3731763325901154 * z * (5.0 * zz - 3.0),  # √(7/16π)
        -0.4570457994644658 * x * (5.0 * zz - 1.0),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3.0 * yy),
    )
    return np.stack(functions, axis=-1)
