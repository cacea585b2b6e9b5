"""Where photographs were taken, as a model file keeps it: one row of numbers for each.

0..11   the first three rows of the pose, camera to model space, OpenGL's axes
12..15  left, right, bottom and top border of the picture, as x / -z and y / -z in camera
        space; without the lens's distortion
"""

from collections.abc import Sequence

import numpy as np

from .camera import Camera
from .lens import Lens

ROW = 16
MOST, DIGITS = 2000, 5  # rows, of a file; after the point
RIGID, FARTHEST, WIDEST = 0.01, 1e4, 100.0  # of what a file says: rotation, place, borders


def rows_of_views(poses: np.ndarray, lenses: Sequence[Lens]) -> list[list[float]]:
    """Poses [n, 4, 4] in model space and lenses [n] as such rows, at most MOST, evenly chosen."""
    step = 1 + len(poses) // MOST
    poses, lenses = poses[::step], lenses[::step]
    rows = np.empty((len(poses), ROW))
    rows[:, :12] = np.reshape(poses[:, :3], (-1, 12))
    for row, lens in zip(rows, lenses, strict=True):
        (fx, fy), (cx, cy) = lens.focal, lens.center
        row[12:] = -cx / fx, (lens.width - cx) / fx, (cy - lens.height) / fy, cy / fy
    return rows.round(DIGITS).tolist()


def views_of_rows(rows: Sequence[Sequence[float]], width: int) -> list[Camera]:
    """Cameras with so many square pixels across; rows that are no camera's are left out."""
    cameras = []
    for row in np.reshape(rows, (-1, ROW)):
        pose, (left, right, bottom, top) = np.eye(4), row[12:]
        pose[:3] = row[:12].reshape(3, 4)
        turn = pose[:3, :3]
        rigid = abs(turn @ turn.T - np.eye(3)).max() < RIGID
        if not rigid or abs(row).max() > FARTHEST or abs(row[12:]).max() > WIDEST:
            continue
        if right - left < 1e-3 or not 0.1 < (top - bottom) / (right - left) < 10.0:
            continue
        focal = width / (right - left)
        height, center = max(round(focal * (top - bottom)), 1), (-left * focal, top * focal)
        cameras.append(Camera(pose, Lens(width, height, (focal, focal), center)))
    return cameras
