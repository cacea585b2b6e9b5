"""What all cameras share: the point that they look at, and what is up."""

import numpy as np

PARALLEL = 0.02  # below this smallest eigenvalue of the mean projector views have no focus


def focus(poses):
    """The point nearest to all cameras' axes by squared distance; None if these are parallel.  [3]

    Args:
        poses: Camera to world, OpenGL's axes.  [n, 4, 4]
    """
    origins, axes = poses[:, :3, 3], poses[:, :3, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # projectors across each axis
    mean = across.mean(axis=0)
    if np.linalg.eigvalsh(mean)[0] < PARALLEL:
        return None
    return np.linalg.solve(mean, np.einsum("nij,nj->i", across, origins) / len(poses))


def upright(up):
    """The smallest rotation that takes a direction to +z.  [3, 3]"""
    up = np.asarray(up, float) / max(np.linalg.norm(up), 1e-12)
    z = np.array([0.0, 0.0, 1.0])
    axis, cosine = np.cross(up, z), up @ z
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + cosine)
