"""What substeps hold of a material: a bending test measures what is claimed, also near ν = ½."""

import numpy as np
import pytest
from beams import beam

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver
from deformrf.core.geometry import A15, BCC
from deformrf.wings.lab.dynamics.energy import material_energy
from deformrf.wings.lab.dynamics.measure import response

GRAVITY = (0.0, 0.0, -1.0)


def solver_of(body, material, count, **options):
    rest, tets = body.mesh.rest_vertices, body.mesh.tets
    options = XpbdOptions(substep_count=count, **options)
    return XpbdSolver(rest, tets, material, body.clamped, options)


@pytest.mark.parametrize("ratio", [0.3, 0.45, 0.49])
def test_a_solid_with_less_bulk_modulus_has_the_modulus_of_its_uniaxial_test(ratio):
    material, share = Material(poisson_ratio=ratio), np.random.default_rng().uniform(0.05, 1.0)
    mu, k = material.shear_modulus, share * material.bulk_modulus
    # Stretched by 1 along x, the sides free: σ_y = 0 gives the strain across.
    stiffness = np.array([[k + 3.0 * mu, 2.0 * (k + mu)], [k + mu, 2.0 * (k + 2.0 * mu)]])
    across = -stiffness[1, 0] / stiffness[1, 1]
    of_share = stiffness[0] @ [1.0, across]
    assert material.young_modulus_at(1e9, share) == pytest.approx(of_share, rel=1e-6)
    assert material.young_modulus_at(1e9) == pytest.approx(material.young_modulus, rel=1e-6)


@pytest.mark.parametrize("lattice", [A15, BCC], ids=["a15", "bcc"])
def test_a_nearly_incompressible_cantilever_sags_as_its_held_modulus_says(lattice):
    body = beam(lattice, 1 / 24)
    material = Material(young_modulus=1e6, poisson_ratio=0.49, damping=20.0)
    rest, tets = body.mesh.rest_vertices, body.mesh.tets
    sag = body.tip(response(material_energy(rest, tets, material), rest, body.clamped, GRAVITY))[2]
    claims = []
    for count in (12, 24):
        xpbd = solver_of(body, material, count, gravity=GRAVITY, sleep_motion=0.0)
        claimed = xpbd.held_young_modulus() / material.young_modulus
        for _ in range(180):
            xpbd.step(TIME_STEP)
        real = sag / body.tip(xpbd.vertices.numpy() - rest)[2]
        print(lattice, count, claimed, real)
        assert claimed == pytest.approx(real, rel=0.02)
        claims.append(claimed)
    assert claims[0] < 0.975 < claims[1]


def test_near_incompressibility_more_substeps_are_taken_in_steps_of_poissons_ratio():
    body, counts = beam(A15, 1 / 48), []
    for ratio in (0.25, 0.35, 0.47, 0.49):
        xpbd = solver_of(body, Material(poisson_ratio=ratio), 24)
        counts.append(xpbd.substeps_that_hold())
    assert counts[0] == counts[1] < counts[2] < counts[3]
