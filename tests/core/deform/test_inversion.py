"""Where few tets hold the volume: inverted tets bring in the others, for as long as needed."""

import numpy as np
import pytest

from deformrf.core.deform import Material, constraints
from deformrf.core.deform.inversion import LOOK_EVERY, WHILES, InversionGuard
from deformrf.core.geometry import BCC, a15_grid
from deformrf.core.geometry.lattice import grid

DT = 1.0 / 60.0
ONE = a15_grid(0.12)
EVEN = np.ones(2 * ONE.vertex_count)  # factors of Young's modulus in two parts


def guard_of_two_parts():
    rest = np.concatenate([ONE.rest_vertices, ONE.rest_vertices + np.array([2.4, 0.0, 0.0])])
    tets = np.concatenate([ONE.tets, ONE.tets + len(ONE.rest_vertices)])
    volumes = constraints.volume_constraints(rest, tets)
    part_of = np.repeat([0, 1], len(ONE.rest_vertices))
    return InversionGuard(volumes, part_of), volumes, part_of


def test_only_the_part_with_an_inverted_tet_is_guarded():
    guard, volumes, part_of = guard_of_two_parts()
    material = Material()
    guard.take(material, EVEN)
    usual = volumes.compliances(material.bulk_modulus)
    assert guard.guarded(usual) is usual
    assert guard.report(np.array([0, 3]), np.array([0, 5]))
    assert guard.parts.tolist() == [False, True]
    second = part_of[volumes.vertices[:, 0]] == 1
    guarded = guard.guarded(usual)
    assert np.isfinite(guarded[second]).all()
    np.testing.assert_array_equal(guarded[~second], usual[~second])
    held = 1.0 / guarded[second] * volumes.rest_values[second] ** 2
    assert held.sum() == pytest.approx(
        (1.0 / usual[second] * volumes.rest_values[second] ** 2).sum()
    )


def test_it_ends_after_a_while_twice_and_then_waits_for_the_user():
    guard, *_ = guard_of_two_parts()
    guard.take(Material(), EVEN)

    def seconds_guarded():
        guard.report(np.array([1, 0]), np.array([1, 0]))
        for frame in range(10_000):
            if guard.begin(DT) and guard.report(np.zeros(2), np.zeros(2)):
                return (frame + 1) * DT
        return None

    for expected in WHILES[:2]:
        assert seconds_guarded() == pytest.approx(expected, abs=2 * LOOK_EVERY * DT)
    assert seconds_guarded() is None
    guard.touch()
    assert seconds_guarded() == pytest.approx(WHILES[0], abs=2 * LOOK_EVERY * DT)


def test_it_stays_while_tets_are_squeezed():
    guard, *_ = guard_of_two_parts()
    guard.take(Material(), EVEN)
    guard.report(np.array([1, 0]), np.array([1, 0]))
    for _ in range(200):
        assert not guard.begin(DT) or not guard.report(np.zeros(2), np.array([1, 0]))
    assert guard.parts.tolist() == [True, False]


def test_a_look_that_did_not_arrive_stays_due():
    guard, *_ = guard_of_two_parts()
    guard.take(Material(), EVEN)
    guard.report(np.array([1, 0]), np.array([1, 0]))
    for frame in range(1, 100):
        assert guard.begin(DT) == (frame >= LOOK_EVERY)
    guard.reset()
    assert not guard.parts.any() and not guard.begin(DT)


def test_there_is_none_where_all_tets_hold_or_none_does():
    mesh = grid(BCC, 0.2)
    volumes = constraints.volume_constraints(mesh.rest_vertices, mesh.tets)
    guard = InversionGuard(volumes, np.zeros(len(mesh.rest_vertices), int))
    guard.take(Material(), EVEN)
    assert not guard.report(np.ones(1), np.ones(1))
    guard, *_ = guard_of_two_parts()
    guard.take(Material(poisson_ratio=0.25))
    assert not guard.report(np.array([1, 1]), np.array([1, 1]))
    guard.take(None)
    assert not any(guard.begin(DT) for _ in range(2 * LOOK_EVERY))
