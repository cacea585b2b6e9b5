"""Nothing breaks a body for good; and what measures that isn't fooled."""

import warnings

import numpy as np

from deformrf.core.deform.material import Material
from deformrf.core.geometry.lattice import a15_grid, bcc_grid, kuhn_grid
from deformrf.core.geometry.mesh import TetMesh, extract
from deformrf.core.study import stress
from deformrf.core.study.stability import run_case

CASES = {case.name: case for case in stress.CASES}
ONE_TET = TetMesh(
    rest_vertices=np.array([[-0.3, -0.3, 0.2], [0.3, -0.3, 0.2], [0.0, 0.4, 0.2], [0, 0, 0.7]]),
    addresses=np.zeros((4, 3), np.int32),
    tets=np.array([[0, 1, 2, 3]], np.int32),
)


def cut(grid, spacing):
    """A ball of diameter 0.6."""
    mesh = grid(spacing)
    away = np.linalg.norm(mesh.rest_vertices[mesh.tets].mean(axis=1) - 0.5, axis=1)
    return extract(mesh, away < 0.3)[0]


BODIES = {
    "A15": cut(a15_grid, 0.042),
    "BCC": cut(bcc_grid, 0.06),
    "Kuhn": cut(kuhn_grid, 0.09),
}


def material(young_modulus, poisson_ratio=0.35):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ratios below 1/4 are part of the tests
        return Material(young_modulus=young_modulus, poisson_ratio=poisson_ratio)


def fresh_seed():
    return int(np.random.default_rng().integers(2**32))


def assert_passes(body, case, device, **arguments):
    seed = fresh_seed()
    mesh = BODIES.get(body, ONE_TET)
    result = run_case(mesh, case=CASES[case], device=device, seed=seed, **arguments)
    assert result.passed, f"{body}, seed {seed}: {result}"
