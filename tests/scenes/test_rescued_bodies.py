"""The solver's rescue: every tangled body returns to its rest shape, unless a load holds it."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.deform import Material, XpbdOptions, XpbdSolver
from deformrf.core.deform.rescue import SOFTENING
from deformrf.core.geometry import a15_grid, extract, signed_volumes

DT = 1.0 / 60.0


def pillar():
    """About 200 tets, upright, with a thin neck."""
    mesh = a15_grid(0.05)
    middle = mesh.rest_vertices[mesh.tets].mean(axis=1)
    height = (middle[:, 2] - 0.2) / 0.6
    radius = np.where(height < 0.15, 0.18, np.where(height < 0.5, 0.09, 0.15))
    away = np.linalg.norm(middle[:, :2] - 0.5, axis=1)
    return extract(mesh, (away < radius) & (height > 0) & (height < 1))[0]


MESH = pillar()
REST = MESH.rest_vertices
FOOT = REST[:, 2] < REST[:, 2].min() + 0.05 * np.ptp(REST[:, 2])
FREE = np.zeros(MESH.vertex_count, bool)


def make_solver(device, material, pinned=FOOT, **options):
    return XpbdSolver(REST, MESH.tets, material, pinned, XpbdOptions(**options), device)


def from_rest(positions, pinned):
    """The farthest that a vertex is from the rest pose, after a rotation if nothing is pinned."""
    x, rest = positions - positions.mean(axis=0), REST - REST.mean(axis=0)
    if pinned.any():
        x, rest = positions, REST
    else:
        u, _, vt = np.linalg.svd(x.T @ rest)
        x = x @ u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return np.linalg.norm(x - rest, axis=1).max() / np.ptp(REST, axis=0).max()


def start_of(name):
    """The rest pose, mirrored, collapsed or random.  [V, 3]"""
    center = REST.mean(axis=0)
    if name == "random":
        return np.random.default_rng().uniform(0.2, 0.8, REST.shape)
    scale = {"mirrored": [-1, 1, 1], "plane": [1, 1, 0], "line": [0, 0, 1], "point": [0, 0, 0]}
    return center + (REST - center) * scale[name]


@pytest.mark.parametrize("pinned", [FREE, FOOT], ids=["free", "pinned"])
@pytest.mark.parametrize("start", ["mirrored", "plane", "line", "point", "random"])
def test_without_volume_constraints_every_start_comes_back(device, start, pinned):
    x = make_solver(device, Material(poisson_ratio=0.25), pinned)
    spoiled = start_of(start)
    spoiled[pinned] = REST[pinned]
    x.set_state(spoiled)
    for _ in range(600):
        x.step(DT)
    now = x.vertices.numpy().astype(np.float64)
    assert (signed_volumes(now, MESH.tets) > 0).all()
    assert from_rest(now, pinned) < 0.02  # it may spin, and is wider then
    assert not x.rescue.counts.any()


def test_a_body_turned_inside_out_at_its_pins_comes_back_in_time(device):
    x = make_solver(device, Material(young_modulus=1e9))
    bottom = REST[:, 2].min()
    x.set_state(np.where(FOOT[:, None], REST, REST * [1, 1, -1] + [0, 0, 2 * bottom]))
    for _ in range(600):
        x.step(DT)
    assert from_rest(x.vertices.numpy().astype(np.float64), FOOT) < 0.01


@pytest.mark.parametrize("way", [(0.5, 0, 0), (0, 0.6, 0), (0, 0, -0.6), (10, 0, 0)])
def test_a_neck_that_a_drag_mirrored_returns_within_ten_seconds(device, way):
    """At a Poisson's ratio of 1/4; without the rescue it would stay 25 % away."""
    x = make_solver(device, Material(poisson_ratio=0.25))
    head = np.flatnonzero(REST[:, 2] > REST[:, 2].max() - 0.06)
    x.grab(head)
    for frame in range(30):
        x.move(REST[head] + np.array(way) * (frame + 1) / 30)
        x.step(DT)
    x.release()
    for _ in range(600):
        x.step(DT)
    assert from_rest(x.vertices.numpy().astype(np.float64), FOOT) < 0.01


def test_a_body_that_hangs_turned_over_at_its_pins_comes_back(device):
    """Its volumes are positive and no edge is wrapped, but many are twice as long."""
    x = make_solver(device, Material(young_modulus=1e4, poisson_ratio=0.45))
    low = REST[FOOT, 2].max()
    turned_over = REST * [1, -1, -1] + [0, 2 * REST[:, 1].mean(), 2 * low]  # half a turn
    x.set_state(np.where(FOOT[:, None], REST, turned_over))
    for _ in range(600):
        x.step(DT)
    assert from_rest(x.vertices.numpy().astype(np.float64), FOOT) < 0.01


def test_pins_that_stretch_a_body_are_no_tangle(device):
    """Pulled and pinned there, part of its neck is twice as long; it stays."""
    x = make_solver(device, Material())
    head = REST[:, 2] > REST[:, 2].max() - 0.06
    ids = np.flatnonzero(head)
    x.grab(ids)
    for frame in range(60):
        x.move(REST[ids] + np.array([0.0, 0.0, 0.8 * np.ptp(REST[:, 2])]) * (frame + 1) / 60)
        x.step(DT)
    x.set_pinned(FOOT | head)
    x.release()
    for _ in range(180):
        x.step(DT)
        assert not x.rescue.running
    ends = x.edges.vertices
    now = x.vertices.numpy()[ends]
    stretched = np.linalg.norm(now[:, 0] - now[:, 1], axis=1) / x.edges.rest_values
    assert (stretched > 2.0).sum() > 5


def test_a_body_that_falls_over_its_pins_is_left_lying(device):
    """Too soft for its weight: it tangles, and nothing pulls it up."""
    x = make_solver(device, Material(young_modulus=3e4))
    x.set_options(replace(x.options, gravity=(0.0, 0.0, -9.81)))
    for _ in range(1200):
        x.step(DT)
        assert not x.rescue.running
    assert x.rescue.held_by == "weight"
    assert from_rest(x.vertices.numpy().astype(np.float64), FOOT) > 0.1


def test_a_rescue_is_reported_and_the_solver_stays_awake(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE)
    x.set_state(start_of("mirrored"))  # without volumes that is an equilibrium
    rescued = 0
    for _ in range(150):
        assert not x.settled
        x.step(DT)
        rescued += x.rescue.running
    assert rescued == pytest.approx(SOFTENING / DT, abs=1)  # volumes turn a mirror image over
    for _ in range(240):
        x.step(DT)
    assert not x.rescue.counts.any() and x.settled


def test_only_tangled_parts_are_taken_back(device):
    rest = np.concatenate([REST, REST + np.array([1.0, 0.0, 0.0])])
    tets = np.concatenate([MESH.tets, MESH.tets + len(REST)])
    x = XpbdSolver(
        rest, tets, Material(poisson_ratio=0.25), np.zeros(len(rest), bool), device=device
    )
    spoiled = rest.copy()
    spoiled[: len(REST)] = start_of("mirrored")
    velocities = np.zeros_like(rest)
    velocities[len(REST) :] = [0.0, 0.5, 0.0]
    x.set_state(spoiled, velocities)
    for _ in range(70):
        x.step(DT)
    assert x.rescue.running
    moving = x.velocities.numpy()[len(REST) :]
    np.testing.assert_allclose(moving[:, 1], 0.5, rtol=1e-3)
    for _ in range(400):
        x.step(DT)
    assert from_rest(x.vertices.numpy()[: len(REST)], FREE) < 0.01


def test_a_vertex_at_nan_is_recovered(device):
    x = make_solver(device, Material(), FREE)
    x.set_state(REST)
    spoiled = x.vertices.numpy().copy()
    spoiled[7] = np.nan
    x.vertices.assign(spoiled)
    for _ in range(360):
        x.step(DT)
    assert from_rest(x.vertices.numpy().astype(np.float64), FREE) < 1e-5


def test_without_the_rescue_a_mirror_image_sleeps(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE, rescue=False)
    x.set_state(start_of("mirrored"))
    for _ in range(60):
        x.step(DT)
    assert x.settled and not x.rescue.running


def test_a_grab_stops_the_rescue(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE)
    mirrored = start_of("mirrored")
    x.set_state(mirrored)
    x.grab([0])
    for _ in range(90):
        x.step(DT)
        assert not x.rescue.running
    x.release()
    for _ in range(70):
        x.step(DT)
    assert x.rescue.running
    x.grab([0])
    x.step(DT)
    assert not x.rescue.running
    moving = np.linalg.norm(x.velocities.numpy(), axis=1)
    assert (moving[1:] > 0).all()  # they have their masses again


def test_inverted_tets_are_counted(device):
    x = make_solver(device, Material(), FREE)
    moved = REST.copy()
    moved[np.random.default_rng().integers(len(moved), size=5)] += 0.3
    x.set_state(moved, velocities=np.zeros_like(moved))
    x._feedback.end(x.vertices, count=True)
    _, _, (inverted, *_) = x._feedback.read()
    expected = (signed_volumes(moved.astype(np.float32), MESH.tets) <= 0).sum()
    assert inverted.sum() == expected > 0
