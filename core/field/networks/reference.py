"""The two small networks and the basis of the view direction, in NumPy: the definition.

    h = density network(features)             [N, 16]
    sigma = exp(min(h[:, 0], 15))             per unit of rest length
    rgb = sigmoid(color network([h, Y(d)]))

Y is the real spherical-harmonics basis of degree 0..3 of the sample's direction d
(Ramamoorthi & Hanrahan 2001; the same as Instant-NGP's).  The functions compute in the
precision of their arguments, float64 for the reference.

A network is a tuple of layers (weights [in, out], bias [out]) with ReLU between them.
"""

import numpy as np
import warp as wp

GEOMETRY_FEATURES = 16  # h; its first column is the logarithm of sigma
BASIS_COUNT = 16  # spherical harmonics of degree < 4
CONSTANT_BASIS = (0.28209479177387814, *[0.0] * (BASIS_COUNT - 1))  # no direction in it
MAX_LOG_SIGMA = 15.0  # exp stays far from float32's and float16's limits; 3e6 is opaque

# The shape that the fused kernels (mma.py, triton.py) are written for.
WIDTH = 64  # of the hidden layers: one for density, two for color
MAX_FEATURES = 32  # 4 L

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]


def has_usual_shape(shapes) -> bool:
    """Whether the layers' shapes (in, out), density's first, are those of the fused kernels."""
    shapes = [tuple(shape) for shape in shapes]
    color = [(GEOMETRY_FEATURES + BASIS_COUNT, WIDTH), (WIDTH, WIDTH), (WIDTH, 3)]
    return has_usual_density(shapes[:2]) and shapes[2:] == color


def has_usual_density(shapes) -> bool:
    """Whether the density layers' shapes (in, out) are those of the fused kernels."""
    (feature_count, width), *others = [tuple(shape) for shape in shapes]
    usual = feature_count <= MAX_FEATURES and width == WIDTH
    return usual and others == [(WIDTH, GEOMETRY_FEATURES)]


def sigmoid(x):
    """1 / (1 + exp(-x)), in place and without overflow."""
    np.multiply(x, 0.5, out=x)
    np.tanh(x, out=x)
    x += 1
    return np.multiply(x, 0.5, out=x)


def mlp(x, layers: Layers):
    """Apply a network.  [N, in] -> [N, out]"""
    for weights, bias in layers[:-1]:
        x = np.maximum(x @ weights + bias, 0)
    weights, bias = layers[-1]
    return x @ weights + bias


def sigma_from(h: np.ndarray) -> np.ndarray:
    """Density per unit of rest length from the density network's output.  [N]"""
    return np.exp(np.minimum(h[:, 0], MAX_LOG_SIGMA))


def spherical_harmonics(directions: np.ndarray) -> np.ndarray:
    """The 16 real spherical harmonics of degree 0..3 of unit vectors.  [N, 3] -> [N, 16]"""
    x, y, z = directions[:, 0], directions[:, 1], directions[:, 2]
    xx, yy, zz = x * x, y * y, z * z
    return np.stack(
        [
            np.full_like(x, 0.28209479177387814),
            -0.4886025119029199 * y,
            0.4886025119029199 * z,
            -0.4886025119029199 * x,
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (3.0 * zz - 1.0),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
            -0.5900435899266435 * y * (3.0 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (5.0 * zz - 1.0),
            0.3731763325901154 * z * (5.0 * zz - 3.0),
            -0.4570457994644658 * x * (5.0 * zz - 1.0),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3.0 * yy),
        ],
        axis=-1,
    )


basis_vector = wp.types.vector(length=BASIS_COUNT, dtype=wp.float32)


@wp.func
def basis_of(d: wp.vec3):
    """`spherical_harmonics` of one direction."""
    x = d[0]
    y = d[1]
    z = d[2]
    xx = x * x
    yy = y * y
    zz = z * z
    return basis_vector(
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (3.0 * zz - 1.0),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3.0 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (5.0 * zz - 1.0),
        0.3731763325901154 * z * (5.0 * zz - 3.0),
        -0.4570457994644658 * x * (5.0 * zz - 1.0),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3.0 * yy),
    )


def evaluate(features, basis, density_layers: Layers, color_layers: Layers):
    """sigma [N] and rgb [N, 3] of samples, from features [N, L·F] and Y(d) [N, 16]."""
    h = mlp(features, density_layers)
    rgb = sigmoid(mlp(np.concatenate([h, basis], axis=1), color_layers))
    return sigma_from(h), rgb
