"""How far a scene's object is from its shape at rest."""

import numpy as np


def displacements(scene):
    """Distance of each vertex from its rest position, in object sizes.  [V]"""
    return np.linalg.norm(scene.positions - scene.solver.rest_vertices, axis=1) / scene.size
