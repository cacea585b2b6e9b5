"""What a stiff body holds is measured on itself: as bending has it, for any shape, once."""

from dataclasses import replace

import numpy as np
import pytest
from beams import beam

from deformrf.core.deform import TIME_STEP, Material, XpbdOptions, XpbdSolver, lowest_pins
from deformrf.core.deform import pull_test as pulls
from deformrf.core.geometry import A15, a15_grid, extract
from deformrf.wings.lab.dynamics.energy import material_energy
from deformrf.wings.lab.dynamics.measure import response

STIFF = Material(young_modulus=1e10, damping=20.0)


def cube():
    mesh = a15_grid(0.14)
    return mesh, lowest_pins(mesh.rest_vertices, mesh.tets)


def cantilever():
    body = beam(A15, 1 / 24)
    return body.mesh, body.clamped


def solver_of(mesh, pinned, material=STIFF, **options):
    return XpbdSolver(
        mesh.rest_vertices, mesh.tets, material, pinned, XpbdOptions(contact=False, **options)
    )


@pytest.mark.parametrize("count", [24, 96])
@pytest.mark.parametrize("make", [cantilever, cube], ids=["cantilever", "cube"])
def test_the_held_modulus_is_what_a_body_has_under_a_load(make, count):
    mesh, pinned = make()
    rest = mesh.rest_vertices.astype(np.float32).astype(np.float64)
    energy = material_energy(rest, mesh.tets, STIFF)
    claimed = solver_of(mesh, pinned, substep_count=count).held_young_modulus()
    assert claimed < 0.75 * STIFF.young_modulus  # or nothing would be at the floor
    # Small strains: as if it were a body of that modulus, which yields in proportion.
    pull = np.array([0.0, 0.0, -1e-4 * claimed / STIFF.density])
    options = {"gravity": tuple(pull), "sleep_motion": 0.0, "substep_count": count}
    xpbd = solver_of(mesh, pinned, **options)
    for _ in range(120):
        xpbd.step(TIME_STEP)
    ways = xpbd.vertices.numpy() - rest, response(energy, rest, pinned, pull)
    found, asked = (energy.masses @ way @ pull for way in ways)
    assert claimed / STIFF.young_modulus == pytest.approx(asked / found, rel=0.2)


def test_the_body_that_is_asked_stays_as_it_is():
    xpbd = solver_of(*cube())
    xpbd.grab([5])
    xpbd.move(xpbd.rest_vertices[[5]] + 0.1)
    xpbd.step(TIME_STEP)
    before, material, options = xpbd.vertices.numpy(), xpbd.material, xpbd.options
    assert xpbd.held_young_modulus() > 1.05 * xpbd.estimated_young_modulus()
    np.testing.assert_array_equal(xpbd.vertices.numpy(), before)
    assert (xpbd.material, xpbd.options) == (material, options)


def test_it_is_pulled_once_for_its_pins(monkeypatch):
    calls = []

    def floor_share(solver, part_of):
        calls.append(solver)
        return 1.5

    monkeypatch.setattr("deformrf.core.deform.xpbd.floor_share", floor_share)
    mesh, pinned = cube()
    xpbd = solver_of(mesh, pinned)
    xpbd.held_young_modulus()
    xpbd.set_material(replace(STIFF, young_modulus=1e11))
    assert xpbd.held_young_modulus() == pytest.approx(1.5 * xpbd.estimated_young_modulus(), rel=0.1)
    assert len(calls) == 1
    xpbd.set_pinned(mesh.rest_vertices[:, 2] < 0.4)
    xpbd.held_young_modulus()
    xpbd.set_stiffness(np.full(mesh.vertex_count, 2.0))
    xpbd.held_young_modulus()
    assert len(calls) == 2
    xpbd.set_material(Material())
    assert xpbd.held_young_modulus() == xpbd.estimated_young_modulus() and len(calls) == 2


def test_parts_without_pins_are_left_out():
    mesh, _ = cube()
    middles = mesh.rest_vertices[mesh.tets].mean(axis=1)[:, 0]
    halves, _ = extract(mesh, np.abs(middles - 0.5) > 0.2)
    left, _ = extract(halves, halves.rest_vertices[halves.tets].mean(axis=1)[:, 0] < 0.5)
    shares = []
    for body in halves, left:
        pinned = (body.rest_vertices[:, 0] < 0.5) & (body.rest_vertices[:, 2] < 0.1)
        xpbd = solver_of(body, pinned, rescue=False, sleep_motion=0.0)
        shares.append(pulls.floor_share(xpbd, xpbd._part_of))
    assert shares[0] == pytest.approx(shares[1], rel=0.02) and shares[0] > 1.05


@pytest.mark.parametrize("pinned", [False, True], ids=["free", "pinned whole"])
def test_without_pins_or_with_nothing_else_there_is_nothing_to_pull(pinned):
    mesh, _ = cube()
    xpbd = solver_of(mesh, np.full(mesh.vertex_count, pinned))
    assert pulls.floor_share(xpbd, xpbd._part_of) == 1.0
