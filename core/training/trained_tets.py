"""The tets that a stage trains on: those in the scene box, then those near what stage 1 found."""

import numpy as np

from ..geometry import TetMesh, extract, face_components, fill_enclosed, tet_neighbours
from .data import DatasetError
from .run import TrainingField

SMALLEST_COMPONENT = 0.005  # of the occupied tets; smaller ones are floaters


def boxed(mesh: TetMesh, box, spacing) -> TetMesh:
    """The tets of a grid that lie in a box or at its border."""
    centers = mesh.rest_vertices[mesh.tets].mean(axis=1)
    inside = ((centers > box[0] - spacing) & (centers < box[1] + spacing)).all(axis=1)
    return mesh if inside.all() else extract(mesh, inside)[0]


def kept_mesh(field: TrainingField) -> TetMesh:
    """The tets of stage 2: occupied, their neighbours, enclosed; no floaters.

    Raises:
        DatasetError: Nothing is occupied.
    """
    mesh, neighbours = field.mesh, tet_neighbours(field.mesh.tets)
    occupied = field.occupied.any(dim=1).cpu().numpy()
    if not occupied.any():
        raise DatasetError(
            "stage 1 found nothing: it had too few --steps, or the object doesn't lie in the "
            "scene box (--scene-radius is half the box's edge)"
        )
    keep, beside = occupied.copy(), neighbours[occupied]
    keep[beside[beside >= 0]] = True
    keep = fill_enclosed(keep, neighbours)
    labels = face_components(neighbours, keep)
    sizes = np.bincount(labels[occupied])  # neighbours would make six times as much of a speck
    keep[keep] = sizes[labels[keep]] >= SMALLEST_COMPONENT * occupied.sum()
    return extract(mesh, keep)[0]
