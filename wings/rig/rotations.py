"""Rotations as unit quaternions (x, y, z, w), the order of glTF, in float64.

Every function works on arrays of any leading shape: quaternions [..., 4], vectors [..., 3].
"""

import numpy as np

IDENTITY = (0.0, 0.0, 0.0, 1.0)
# Rows of the matrix:  1 − 2 (yy + zz), 2 (xy − zw), 2 (xz + yw);  2 (xy + zw), 1 − 2 (xx + zz),
# 2 (yz − xw);  2 (xz − yw), 2 (yz + xw), 1 − 2 (xx + yy), by where q qᵀ has the products.
FIRST, SECOND = [5, 1, 2, 1, 0, 6, 2, 6, 0], [10, 11, 7, 11, 10, 3, 7, 3, 5]
SIGNS = np.array([1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
IDENTITY_MATRIX = np.eye(3)
TWICE = 2.0 - 4.0 * IDENTITY_MATRIX
NEXT, LAST = [1, 2, 0], [2, 0, 1]  # axes of a cross product; np.cross is slow for a few vectors
CLOSE = 1.0 - 1e-9  # cosine above which slerp is a straight line: no division by a small sine


def product(a, b):
    """The rotation b, then a: the Hamilton product a·b.  [..., 4]"""
    a, b = np.asarray(a, float), np.asarray(b, float)
    xyz = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3]
    xyz = xyz + (a[..., NEXT] * b[..., LAST] - a[..., LAST] * b[..., NEXT])
    w = a[..., 3:] * b[..., 3:] - np.sum(a[..., :3] * b[..., :3], axis=-1, keepdims=True)
    return np.concatenate([xyz, w], axis=-1)


def inverse(q):
    """The rotation back.  [..., 4]"""
    return np.asarray(q, float) * (-1.0, -1.0, -1.0, 1.0)


def unit(q):
    """The quaternion of length 1; the identity for one of length 0.  [..., 4]"""
    q = np.asarray(q, float)
    length = np.sqrt(np.add.reduce(q * q, axis=-1, keepdims=True))
    if (length > 1e-12).all():
        return q / length
    return np.where(length > 1e-12, q / np.maximum(length, 1e-12), IDENTITY)


def matrix_of(q):
    """The rotation matrix of a unit quaternion.  [..., 3, 3]"""
    q = np.asarray(q, float)
    products = (q[..., :, None] * q[..., None, :]).reshape(*q.shape[:-1], 16)
    entries = products[..., FIRST] + SIGNS * products[..., SECOND]
    return IDENTITY_MATRIX + TWICE * entries.reshape(*q.shape[:-1], 3, 3)


def quaternion_of(matrices):
    """The unit quaternion of a rotation matrix, its largest component positive.  [..., 4]

    4·q·qᵀ is linear in the matrix; its row of largest diagonal is q up to a factor, so nothing
    small is divided by (Shepperd 1978).
    """
    m = np.asarray(matrices, float)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    outer = np.empty((*m.shape[:-2], 4, 4))
    outer[..., 0, 0], outer[..., 1, 1] = 1 + xx - yy - zz, 1 - xx + yy - zz
    outer[..., 2, 2], outer[..., 3, 3] = 1 - xx - yy + zz, 1 + xx + yy + zz
    for i, j, k in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
        outer[..., i, j] = outer[..., j, i] = m[..., j, i] + m[..., i, j]
        sign = 1.0 if (i, j) != (0, 2) else -1.0
        outer[..., k, 3] = outer[..., 3, k] = sign * (m[..., j, i] - m[..., i, j])
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    return unit(np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :])


def of_vector(vector):
    """The rotation about `vector`, by its length as angle [radians].  [..., 4]"""
    vector = np.asarray(vector, float)
    half = 0.5 * np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(half / np.pi) * vector, np.cos(half)], axis=-1)


def between(a, b):
    """The shortest rotation that turns the direction of a to that of b [..., 3].  [..., 4]"""
    a, b = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in np.broadcast_arrays(a, b))
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    # Opposite directions: half a turn about any axis across a.
    helper = np.eye(3)[np.argmin(np.abs(a), axis=-1)]
    across = np.concatenate([np.cross(a, helper), np.zeros_like(cosine)], axis=-1)
    direct = np.concatenate([np.cross(a, b), 1.0 + cosine], axis=-1)
    return unit(np.where(cosine > -1.0 + 1e-12, direct, across))


def rotated(q, vectors):
    """Vectors turned by unit quaternions.  [..., 3]"""
    q, vectors = np.asarray(q, float), np.asarray(vectors, float)
    across = 2.0 * np.cross(q[..., :3], vectors)
    return vectors + q[..., 3:] * across + np.cross(q[..., :3], across)


def slerp(a, b, share):
    """From a (share 0) to b (share 1) at constant speed, the shorter way.  [..., 4]"""
    a, b = np.asarray(a, float), np.asarray(b, float)
    share = np.asarray(share, float)[..., None]
    cosine = np.add.reduce(a * b, axis=-1, keepdims=True)  # np.sum takes longer on few
    b, cosine = np.where(cosine < 0.0, -b, b), np.abs(cosine)
    angle = np.arccos(np.minimum(cosine, CLOSE))
    on_arc = (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
    return unit(np.where(cosine < CLOSE, on_arc, (1.0 - share) * a + share * b))
