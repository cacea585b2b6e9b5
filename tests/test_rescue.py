"""When a tangled mesh is softened, and that it comes back, whatever happened to it."""

import numpy as np
import pytest

from deformrf.core.deform.material import Material
from deformrf.core.deform.rescue import DURATION, PATIENCE, RATIOS, TRIES, Rescue
from deformrf.core.deform.xpbd import XpbdOptions, XpbdSolver
from deformrf.core.geometry.lattice import a15_grid
from deformrf.core.geometry.mesh import extract, signed_volumes

DT = 1.0 / 60.0


class Body:
    """Stands in for the solver: `counts` says how many tets are inverted after each frame."""

    def __init__(self, count):
        self.rescue, self.count, self.time = Rescue(), count, 0.0
        self.ratios = []

    def run(self, seconds, dt=DT, handles_move=False):
        for _ in range(round(seconds / dt)):
            counted = self.rescue.advance(dt, handles_move)
            self.ratios.append(self.rescue.ratio)
            if counted:
                self.rescue.report(self.count)


@pytest.mark.parametrize("dt", [1 / 144, 1 / 60, 1 / 5])
def test_after_a_second_of_inversion_it_softens_for_a_while(dt):
    body = Body(count=3)
    body.run(PATIENCE - 0.05, dt)
    assert body.rescue.ratio is None
    body.run(0.15 + 2 * dt, dt)
    assert body.rescue.ratio == RATIOS[0]
    body.count = 0
    body.run(DURATION + dt, dt)
    assert body.rescue.ratio is None
    softened = dt * sum(ratio is not None for ratio in body.ratios)
    assert softened == pytest.approx(DURATION, abs=1.01 * dt)
    body.run(5.0, dt)
    assert body.rescue.ratio is None and body.rescue.may_sleep


def test_a_sound_mesh_is_left_alone_and_may_sleep():
    body = Body(count=0)
    assert not body.rescue.may_sleep  # nobody has looked yet
    body.run(3.0)
    assert body.ratios == [None] * 180
    assert body.rescue.may_sleep


def test_a_moving_handle_comes_first():
    body = Body(count=3)
    body.run(2.0, handles_move=True)
    assert body.rescue.count is None  # it isn't even counted
    body.run(1.2)
    assert body.rescue.ratio is not None
    body.run(DT, handles_move=True)
    assert body.rescue.ratio is None
    body.run(0.5)
    assert body.rescue.ratio is None  # patience begins anew


def test_tries_take_turns_and_end():
    body = Body(count=3)
    body.run(60.0)
    begun = [now for before, now in zip([None, *body.ratios], body.ratios, strict=False)
             if before is None and now is not None]  # fmt: skip
    assert begun == [RATIOS[k % len(RATIOS)] for k in range(TRIES)]
    assert body.rescue.given_up and body.rescue.may_sleep


def test_a_try_that_helped_is_not_counted_and_neither_is_one_before_an_action():
    body = Body(count=100)
    for _ in range(2 * TRIES):
        body.count -= 1
        body.run(PATIENCE + DURATION)
    assert not body.rescue.given_up
    body.run(60.0)
    assert body.rescue.given_up
    body.rescue.touch()
    body.run(1.2)
    assert body.rescue.ratio is not None


# -- bodies --------------------------------------------------------------------------------


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
    """The rest pose, spoiled; [V, 3]."""
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
    assert from_rest(now, pinned) < 0.01
    assert x.inverted_count == 0


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


def test_it_says_that_it_rescues_and_does_not_sleep_meanwhile(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE)
    x.set_state(start_of("mirrored"))  # without volumes that is an equilibrium
    rescued, slept = 0, False
    for _ in range(1200):
        x.step(DT)
        rescued += x.rescuing
        if rescued and x.inverted_count == 0 and not x.rescuing:
            break
        slept |= x.settled
    assert x.inverted_count == 0 and not slept
    frames = DURATION / DT
    assert rescued % frames == pytest.approx(0, abs=TRIES) and rescued < TRIES * frames


def test_without_the_option_a_mirror_image_sleeps(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE, rescue=False)
    x.set_state(start_of("mirrored"))
    for _ in range(60):
        x.step(DT)
    assert x.settled and not x.rescuing


def test_a_still_handle_does_not_prevent_it_and_a_moving_one_ends_it(device):
    x = make_solver(device, Material(poisson_ratio=0.25), FREE)
    mirrored = start_of("mirrored")
    x.set_state(mirrored)
    x.grab([0])
    for _ in range(80):
        x.move(mirrored[:1])  # the mouse is held still
        x.step(DT)
    assert x.rescuing
    x.move(mirrored[:1] + 0.01)
    x.step(DT)
    assert not x.rescuing


def test_it_counts_what_is_inverted(device):
    x = make_solver(device, Material(), FREE)
    moved = REST.copy()
    moved[np.random.default_rng().integers(len(moved), size=5)] += 0.3
    x.set_state(moved)
    x._feedback.end(x.vertices, x._volume_list)
    _, count = x._feedback.read()
    assert count == (signed_volumes(moved.astype(np.float32), MESH.tets) <= 0).sum() > 0
