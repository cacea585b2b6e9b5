"""The solver's options at work: springs, frame rates, compliances, masses, parts."""

import numpy as np
import pytest

from deformrf.core.deform import (
    PRESETS,
    Material,
    XpbdOptions,
    XpbdSolver,
    constraints,
    lowest_pins,
)
from deformrf.core.geometry import a15_grid, extract, signed_volumes

DT = 1.0 / 60.0
G = 9.81


def columns(*centers, spacing=0.06, radius=0.15, high=0.8):
    """Upright cylinders around points of the ground plane, z from 0.2."""
    mesh = a15_grid(spacing)
    middle = mesh.rest_vertices[mesh.tets].mean(axis=1)
    keep = np.zeros(mesh.tet_count, bool)
    for center in centers:
        keep |= np.linalg.norm(middle[:, :2] - center, axis=1) < radius
    return extract(mesh, keep & (middle[:, 2] > 0.2) & (middle[:, 2] < high))[0]


ONE = columns((0.5, 0.5))
SLAB = columns((0.5, 0.5), radius=0.3, high=0.4)
TWO = columns((0.25, 0.25), (0.75, 0.75), radius=0.13)


def foot(mesh):
    return lowest_pins(mesh.rest_vertices, mesh.tets)


def head(mesh):
    return np.flatnonzero(mesh.rest_vertices[:, 2] > mesh.rest_vertices[:, 2].max() - 0.03)


def solver(mesh, pinned, device="cpu", material=None, **options):
    options = XpbdOptions(**options)
    material = material or Material()
    return XpbdSolver(mesh.rest_vertices, mesh.tets, material, pinned, options, device)


def free(mesh):
    return np.zeros(mesh.vertex_count, bool)


def run(x, seconds, dt=DT):
    for _ in range(round(seconds / dt)):
        x.step(dt)


def positions(x):
    return x.vertices.numpy().astype(np.float64)


# -- springs -------------------------------------------------------------------------------


def test_a_spring_stretches_by_the_weight_over_its_stiffness(device):
    k = 500.0
    x = solver(ONE, free(ONE), device, Material(damping=5.0), gravity=(0, 0, -G), rescue=False)
    mass = constraints.lumped_masses(x.rest_vertices, ONE.tets, 1000.0).sum()
    ids = head(ONE)
    x.grab(ids, stiffness=k * np.ones(len(ids)))
    run(x, 6.0)
    below = (x.rest_vertices - positions(x))[ids, 2].mean()
    assert below == pytest.approx(mass * G / (k * len(ids)), rel=0.01)


def test_a_force_limit_is_not_exceeded(device):
    """A free body that is pulled with F moves like its mass under F."""
    x = solver(ONE, free(ONE), device, Material(damping=0.0))
    mass = constraints.lumped_masses(x.rest_vertices, ONE.tets, 1000.0).sum()
    ids, limit = head(ONE)[:4], 3.0
    x.grab(ids, stiffness=1e5, force_limit=limit)
    x.move(x.rest_vertices[ids] + [50.0, 0.0, 0.0])
    x.step(DT)
    x.move(x.rest_vertices[ids] + [50.0, 0.0, 0.0])
    run(x, 1.0)
    masses = constraints.lumped_masses(x.rest_vertices, ONE.tets, 1000.0)
    speed = (masses[:, None] * x.velocities.numpy()).sum(axis=0) / mass
    assert speed[0] == pytest.approx(len(ids) * limit / mass * (1.0 + DT), rel=0.02)
    assert np.abs(speed[1:]).max() < 0.01 * speed[0]


def test_what_is_thrown_flies_on(device):
    """Handles that are released keep the velocity of their way."""
    x = solver(ONE, free(ONE), device, Material(damping=0.0))
    everything = np.arange(len(x.rest_vertices))
    x.grab(everything)
    velocity = np.array([1.5, -0.5, 1.0])
    for frame in range(1, 31):
        x.move(x.rest_vertices + frame * DT * velocity)
        x.step(DT)
    np.testing.assert_allclose(x.velocities.numpy() - velocity, 0.0, atol=1e-4)
    x.release()
    before = positions(x)
    run(x, 1.0)
    np.testing.assert_allclose(positions(x) - before - velocity, 0.0, atol=1e-3)
    x.grab(everything)
    run(x, 2 * DT)
    x.release()
    before = positions(x)
    run(x, 1.0)
    np.testing.assert_allclose(positions(x), before, atol=1e-5)  # roundings of 1 s


def test_a_spring_with_an_unreachable_target_stays_finite(device):
    x = solver(ONE, foot(ONE), device)
    ids = head(ONE)
    x.grab(ids, stiffness=1e4, force_limit=100.0)
    x.move(x.rest_vertices[ids] + 1000.0)
    run(x, 1.0)
    stretched = np.linalg.norm(positions(x) - x.rest_vertices, axis=1).max()
    assert 0.001 < stretched < 0.5
    x.release()
    run(x, 5.0)
    assert np.linalg.norm(positions(x) - x.rest_vertices, axis=1).max() < 0.01


def test_springs_and_exact_handles_can_alternate_and_pins_win(device):
    x = solver(ONE, foot(ONE), device)
    ids, pin = head(ONE), np.flatnonzero(foot(ONE))[:1]
    x.grab(np.append(ids, pin), stiffness=1e6)
    targets = np.append(x.rest_vertices[ids], x.rest_vertices[pin] - 0.5, axis=0)
    x.move(targets + 0.02)
    run(x, 0.2)
    np.testing.assert_array_equal(positions(x)[pin], x.rest_vertices[pin])
    x.grab(ids)
    x.move(x.rest_vertices[ids] + 0.05)
    x.step(DT)
    np.testing.assert_allclose(positions(x)[ids], x.rest_vertices[ids] + 0.05, atol=1e-6)


# -- time ----------------------------------------------------------------------------------


def test_substeps_follow_the_length_of_a_step():
    options = XpbdOptions(substep_count=20)
    rates = {240: 5, 144: 8, 60: 20, 30: 40, 10: 120, 1: 120}
    assert {rate: options.substeps(1 / rate) for rate in rates} == rates
    assert XpbdOptions(substep_count=1).substeps(1 / 1000) == 1


@pytest.mark.parametrize("ratio", [0.25, 0.4])
def test_a_pose_under_a_drag_does_not_depend_on_the_frame_rate(device, ratio):
    poses, sizes = [], None
    for rate in (30, 60, 144):
        x = solver(ONE, foot(ONE), device, Material(poisson_ratio=ratio))
        ids = head(ONE)
        x.grab(ids)
        seen = []
        for frame in range(rate):
            way = min(2.0 * (frame + 1) / rate, 1.0)  # half a second, then held
            x.move(x.rest_vertices[ids] + np.array([0.2, 0.1, 0.0]) * way)
            x.step(1 / rate)
            if frame + 1 in (rate // 2, rate):
                seen.append(positions(x))
        poses.append(seen)
        sizes = x.object_size
    for other in (poses[0], poses[2]):
        for here, there in zip(poses[1], other, strict=True):
            assert np.linalg.norm(here - there, axis=1).max() < 0.01 * sizes


# -- stiffness, masses ---------------------------------------------------------------------


def test_given_compliances_hold_until_the_material_is_set(device):
    material = Material(poisson_ratio=0.4)
    one, other = (solver(ONE, foot(ONE), device, material) for _ in range(2))
    other.set_material(Material(young_modulus=1e3, poisson_ratio=0.25))
    other.set_compliances(*one.compliances)
    other.grab(head(ONE))
    one.grab(head(ONE))
    for x in (one, other):
        x.move(x.rest_vertices[head(ONE)] + 0.02)
        run(x, 0.3)
    np.testing.assert_array_equal(positions(one), positions(other))
    other.set_compliances(0.0, None)
    assert other.stiffness_ratio() == 0.0
    other.set_material(material)
    assert one.stiffness_ratio() == other.stiffness_ratio()


@pytest.mark.parametrize("ratio", [0.25, 0.4])
def test_a_body_sags_by_the_held_modulus(device, ratio):
    """The sag under a load, against that of a soft material, which the substeps do hold."""
    mesh, sags = columns((0.5, 0.5), spacing=0.04), []
    for modulus, count in ((2e5, 60), (5e6, 20), (5e7, 20)):
        material = Material(young_modulus=modulus, poisson_ratio=ratio, damping=8.0)
        load = -0.5 * min(modulus / 2e5, 20.0)
        options = {"gravity": (load, 0, 0), "substep_count": count}
        x = solver(mesh, foot(mesh), device, material, **options)
        run(x, 4.0)
        sag = (positions(x) - x.rest_vertices)[head(mesh), 0].mean()
        assert x.held_young_modulus() < modulus
        sags.append(sag / load * x.held_young_modulus())
    assert x.held_young_modulus() < 0.5 * modulus
    soft, stiff, stiffest = sags
    assert stiff == pytest.approx(soft, rel=0.15)
    assert stiffest == pytest.approx(soft, rel=0.2)  # all at the floor


@pytest.mark.parametrize("modulus", [1e7, 1e8])
def test_substeps_that_are_to_hold_a_material_hold_it(device, modulus):
    """In bending, against a soft material under as much less of a load."""
    mesh, sags = columns((0.5, 0.5), spacing=0.04), []
    x = solver(mesh, foot(mesh), device, Material(young_modulus=modulus))
    for e, count in ((2e5, 60), (modulus, x.substeps_that_hold())):
        load = -0.5 * e / 2e5, 0.0, 0.0
        material = Material(young_modulus=e, damping=8.0)
        x = solver(mesh, foot(mesh), device, material, gravity=load, substep_count=count)
        run(x, 4.0)
        sags.append((positions(x) - x.rest_vertices)[head(mesh), 0].mean())
    assert sags[1] == pytest.approx(sags[0], rel=0.1)


def test_20_substeps_cannot_hold_what_is_called_stiff():
    x = solver(ONE, foot(ONE), material=PRESETS["stiff"])
    assert x.held_young_modulus() < 0.1 * PRESETS["stiff"].young_modulus
    soft = solver(ONE, foot(ONE), material=PRESETS["plush"])
    assert soft.held_young_modulus() > 0.5 * PRESETS["plush"].young_modulus


@pytest.mark.parametrize("name", sorted(set(PRESETS) - {"clay"}))  # which keeps its shape
def test_every_preset_can_be_dragged_and_returns(device, name):
    x = solver(ONE, foot(ONE), device, PRESETS[name])
    ids = head(ONE)
    x.grab(ids)
    for frame in range(30):
        x.move(x.rest_vertices[ids] + np.array([0.2, 0, 0]) * (frame + 1) / 30)
        x.step(DT)
    x.release()
    run(x, 8.0)
    assert np.linalg.norm(positions(x) - x.rest_vertices, axis=1).max() < 0.01


def test_a_mass_ratio_of_a_million_stays_finite(device):
    x = solver(ONE, free(ONE), device)
    heavy = np.random.default_rng().uniform(size=ONE.vertex_count) < 0.5
    x.set_masses(np.where(heavy, 100.0, 1e-4))
    center = x.rest_vertices.mean(axis=0)
    x.set_state(center + 0.3 * (x.rest_vertices - center))
    run(x, 1.0)
    assert np.isfinite(positions(x)).all()
    masses = np.ones(ONE.vertex_count)
    masses[7] = 0.0
    x.set_masses(masses)  # a vertex without mass stays where it is
    before = positions(x)[7].copy()
    run(x, 0.5)
    np.testing.assert_array_equal(positions(x)[7], before)


# -- parts that nothing happens to ---------------------------------------------------------


def test_constraints_of_untouched_parts_are_left_out(device):
    x = solver(TWO, foot(TWO), device)
    left = TWO.rest_vertices[:, 0] < 0.5
    ids = head(TWO)[left[head(TWO)]]
    x.grab(ids)
    x.move(x.rest_vertices[ids] + [0.1, 0, 0])
    x.step(DT)
    in_use = x.edges.vertices[x._lists[0].in_use]
    assert left[in_use].all() and len(in_use) < 0.6 * len(x.edges.vertices)
    assert (~foot(TWO)[in_use]).any(axis=1).all()  # nor what lies between pins
    x.release()
    run(x, 9.0)
    assert x.settled
    np.testing.assert_array_equal(positions(x)[~left], x.rest_vertices[~left])

    ids = head(TWO)[~left[head(TWO)]]
    x.grab(ids)
    x.step(DT)
    assert not left[x.edges.vertices[x._lists[0].in_use]].any()


def test_leaving_a_part_out_does_not_change_the_others(device):
    left = TWO.rest_vertices[:, 0] < 0.5
    ids = head(TWO)[left[head(TWO)]]
    poses = []
    for touch in (False, True):
        x = solver(TWO, foot(TWO), device)
        if touch:
            x.set_state(x.rest_vertices)  # everything is worked on
        x.grab(ids)
        x.move(x.rest_vertices[ids] + [0.1, 0, 0])
        run(x, 0.5)
        poses.append(positions(x))
    np.testing.assert_array_equal(poses[0][left], poses[1][left])
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-6)


def test_gravity_wakes_all_parts_and_a_freed_pin_its_own(device):
    x = solver(TWO, foot(TWO), device, gravity=(0, 0, -G))
    run(x, 0.1)
    assert len(np.unique(x._part_of[x.edges.vertices[x._lists[0].in_use]])) == 2
    x.set_options(XpbdOptions())
    run(x, 9.0)
    assert x.settled
    pins = foot(TWO) & (TWO.rest_vertices[:, 0] < 0.5)
    x.set_pinned(pins)
    x.step(DT)
    in_use = x.edges.vertices[x._lists[0].in_use]
    assert (TWO.rest_vertices[in_use, 0] > 0.5).all()


# -- meshes that are none ------------------------------------------------------------------

TET = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])


@pytest.mark.parametrize("ratio", [0.25, 0.4])
@pytest.mark.parametrize("order", [[0, 1, 2, 3], [0, 1, 3, 2]], ids=["upright", "inverted"])
def test_a_mesh_may_be_one_tet(device, ratio, order):
    x = XpbdSolver(
        TET, np.array([order]), Material(poisson_ratio=ratio), np.zeros(4, bool), device=device
    )
    x.set_state(TET * [1, 1, 0])
    run(x, 6.0)
    now = positions(x)
    lengths = [np.linalg.norm(now[a] - now[b]) for a, b in ((0, 1), (0, 3), (1, 2), (2, 3))]
    np.testing.assert_allclose(lengths, [1, 1, 2**0.5, 2**0.5], rtol=0.01)
    assert np.linalg.det(now[1:] - now[0]) > 0.9


def test_flat_tets_coincident_and_unused_vertices_stay_finite(device):
    """Tets: a sound one, one with two corners in one place, a flat one beside it."""
    rest = np.concatenate([TET, [[0, 0, 1.0], [0.5, 0.5, 0.0], [9, 9, 9]]])
    tets = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [0, 1, 2, 5]])
    for ratio in (0.25, 0.4):
        x = XpbdSolver(rest, tets, Material(poisson_ratio=ratio), np.zeros(7, bool), device=device)
        x.set_state(x.rest_vertices)
        run(x, 0.5)
        np.testing.assert_allclose(positions(x), rest, atol=1e-5)
        x.grab([4])
        x.move([[0.0, 0.0, 2.0]])
        run(x, 2.0)
        now = positions(x)
        assert np.isfinite(now).all()
        np.testing.assert_array_equal(now[6], rest[6])
        assert now[5, 2] > 0.3  # what hangs on flat tets alone comes along


def test_a_mesh_without_any_volume_is_refused():
    with pytest.raises(ValueError, match="no tet has a volume"):
        XpbdSolver(TET * [1, 1, 0], np.array([[0, 1, 2, 3]]), Material(), np.zeros(4, bool))


def test_a_body_that_was_pulled_through_itself_comes_back_without_a_rescue(device):
    """With few tets alone it stays mirrored until the rescue."""
    x = solver(ONE, foot(ONE), device, Material(), rescue=False)
    x.grab(head(ONE))
    height = np.ptp(x.rest_vertices[:, 2])
    for share in np.linspace(0.0, 1.0, 60):
        x.move(x.rest_vertices[head(ONE)] - [0.0, 0.0, 1.3 * share * height])
        x.step(DT)
    run(x, 0.5)
    assert (signed_volumes(positions(x), ONE.tets) < 0.0).any()
    assert x._guard.parts.any()
    x.release()
    run(x, 6.0)
    away = np.linalg.norm(positions(x) - x.rest_vertices, axis=1).max()
    assert away < 0.02 * x.object_size
    assert not x._guard.parts.any()
