"""The definition of a contact's projection: facts that hold for every pose."""

import numpy as np
import pytest

from deformrf.core.definition import contact
from deformrf.core.definition.contact import Contacts
from deformrf.core.deform.contact.listing import NO_BEVEL

H = 1e-3
HELD = np.array([[0.0] * 6 + [1.0] * 3])  # bevels of a triangle without sharp edges
DEEP = np.array([[NO_BEVEL] * 6 + [-NO_BEVEL] * 3])
LOWER = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def push_apart(contacts, x, before, w, h, friction):
    """Positions of contact.push_apart: a mean velocity in the substep stays one."""
    v = (x - before) / h
    x, before, v = contact.push_apart(contacts, x, before, v, w, h, friction)
    np.testing.assert_allclose(v, (x - before) / h, atol=1e-9)
    return x, before


def one_contact(height, before_height, way=(0.0, 0.0), share=0.0, at=(0.2, 0.3)):
    """A vertex (or the middle of an edge) over a triangle, now and at the substep's start."""
    points = np.array([[*at, height], [at[0], at[1], height]])
    before = points + np.array([-way[0], -way[1], before_height - height])
    contacts = Contacts(
        np.array([[0, 1 if share else 0, 2, 3, 4]]), np.array([share]), HELD, 0.01, 1.0
    )
    return contacts, np.concatenate([points, LOWER]), np.concatenate([before, LOWER])


def gap(x, share=0.0):
    """The height of the point over the triangle."""
    a, b, c = x[2:]
    normal = np.cross(b - a, c - a)
    point = (1.0 - share) * x[0] + share * x[1]
    return (point - a) @ normal / np.linalg.norm(normal)


def random_contacts():
    """Contacts between two sheets of 20 vertices each, at random."""
    random = np.random.default_rng()
    ids = np.concatenate(
        [random.integers(0, 20, (60, 2)), random.integers(20, 40, (60, 3))], axis=1
    )
    ids = ids[[len(set(row[2:])) == 3 for row in ids]]
    shares = np.where(ids[:, 0] == ids[:, 1], 0.0, 0.5)
    x = random.normal(size=(40, 3)) * [1.0, 1.0, 0.1]
    before = x + random.normal(scale=0.01, size=x.shape)
    bevels = np.repeat(DEEP, len(ids), axis=0)
    return Contacts(ids, shares, bevels, 0.01, 2.0), x, before, random.uniform(0.1, 2.0, 40)


def test_momentum_is_conserved():
    contacts, x, before, w = random_contacts()
    moved, start = push_apart(contacts, x, before, w, H, 0.5)
    assert np.abs(moved - x).max() > 1e-3
    for change in (moved - x, start - before):
        np.testing.assert_allclose((change / w[:, None]).sum(axis=0), 0.0, atol=1e-12)


def test_velocities_of_their_own_are_stopped_with_their_momentum():
    """What is pushed parts no slower than its positions do, and momentum is conserved."""
    contacts, x, before, w = random_contacts()
    v = (x - before) / H + np.random.default_rng().normal(scale=1.0, size=x.shape)
    after = contact.push_apart(contacts, x, before, v, w, H, 0.5)[2]
    assert np.abs(after - v).max() > 1e-3
    np.testing.assert_allclose(((after - v) / w[:, None]).sum(axis=0), 0.0, atol=1e-9)
    for speed, expected in ((-3.0, 0.0), (5.0, 5.0)):  # m/s along the normal; positions stand still
        single, x, before = one_contact(-0.01, 0.0)
        v = np.zeros_like(x)
        v[:2, 2] = speed
        w = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
        after = contact.push_apart(single, x, before, v, w, H, 0.5)[2]
        assert after[0, 2] == pytest.approx(expected, abs=1e-9)


def test_kinematic_vertices_stay():
    contacts, x, before, w = random_contacts()
    w[20:] = 0.0
    moved, start = push_apart(contacts, x, before, w, H, 0.5)
    assert np.abs(moved[:20] - x[:20]).max() > 1e-3
    np.testing.assert_array_equal(moved[20:], x[20:])
    np.testing.assert_array_equal(start[20:], before[20:])
    w[:] = 0.0
    np.testing.assert_array_equal(push_apart(contacts, x, before, w, H, 0.5)[0], x)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_point_that_comes_through_returns_to_the_triangle(share):
    contacts, x, before = one_contact(-0.01, 0.02, share=share)
    moved, start = push_apart(contacts, x, before, np.array([1.0, 1.0, 2.0, 3.0, 4.0]), H, 0.0)
    assert gap(moved, share) == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_array_equal(start, before)


def test_a_point_in_front_or_beside_the_triangle_is_left_alone():
    for height, at in ((0.01, (0.2, 0.3)), (-0.01, (0.7, 0.7)), (-0.01, (-0.1, 0.3))):
        contacts, x, before = one_contact(height, 0.1, at=at)
        np.testing.assert_array_equal(push_apart(contacts, x, before, np.ones(5), H, 1.0)[0], x)
    contacts, x, before = one_contact(-0.01, 0.1, at=(0.7, 0.7))
    contacts = contacts._replace(bevels=DEEP)  # deep: beside it, too
    assert np.abs(push_apart(contacts, x, before, np.ones(5), H, 1.0)[0] - x).max() > 1e-3


def test_a_bevel_gives_a_point_near_an_edge_to_the_face_across_it():
    """At a right angle a point belongs to the face that it is nearer to."""
    for inset, mine in ((0.02, True), (0.005, False)):
        contacts, x, before = one_contact(-0.01, 0.01, at=(0.4, inset))
        bevels = HELD + np.eye(9)[2]  # of the edge y = 0
        contacts = contacts._replace(bevels=bevels)
        moved, _ = push_apart(contacts, x, before, np.ones(5), H, 0.0)
        assert (np.abs(moved - x).max() > 1e-3) == mine


def test_a_deep_point_comes_out_slowly_and_without_a_velocity():
    w = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    contacts, x, before = one_contact(-0.1, -0.1)
    moved, start = push_apart(contacts, x, before, w, H, 0.0)
    assert gap(moved) == pytest.approx(-0.1 + H * contacts.speed)
    np.testing.assert_allclose(moved - start, x - before, atol=1e-12)
    contacts, x, before = one_contact(-1e-3, -1e-3)
    assert gap(push_apart(contacts, x, before, w, H, 0.0)[0]) == pytest.approx(-0.96e-3)


def test_a_body_inside_is_not_held_back_when_it_leaves():
    contacts, x, before = one_contact(-0.05, -0.06)
    moved, start = push_apart(contacts, x, before, np.ones(5), H, 0.5)
    np.testing.assert_allclose(moved - start, x - before, atol=1e-12)


@pytest.mark.parametrize(("way", "friction"), [(0.004, 0.5), (0.02, 0.5), (0.02, 3.0), (0.02, 0.0)])
def test_friction_undoes_the_way_along_the_triangle_up_to_coulombs_limit(way, friction):
    contacts, x, before = one_contact(-0.01, 0.0, (way, 0.0))
    w = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    moved, _ = push_apart(contacts, x, before, w, H, friction)
    left = moved[0, 0] - before[0, 0]
    assert left == pytest.approx(max(way - friction * 0.01, 0.0), abs=1e-12)


def test_rigid_bodies_stop_exactly_however_many_contacts_they_have():
    """All vertices of a sheet over another one, each in several contacts."""
    random = np.random.default_rng()
    grid = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2) / 3.0
    lower = np.column_stack([grid, np.zeros(16)])
    count = 30
    upper = np.column_stack([random.uniform(0.0, 1.0, (count, 2)), np.full(count, -0.01)])
    x = np.concatenate([upper, lower])
    before = x + [0.0, 0.0, 0.02] * (np.arange(len(x)) < count)[:, None]
    ids = []
    for i, (u, v) in enumerate(upper[:, :2] * 3.0):
        a, b = min(int(u), 2), min(int(v), 2)
        corners = [(a, b), (a + 1, b), (a + 1, b + 1)]
        if v - b > u - a:
            corners = [(a, b), (a + 1, b + 1), (a, b + 1)]
        ids.append([i, i, *(count + 4 * q + p for p, q in corners)])
    contacts = Contacts(np.array(ids), np.zeros(count), np.repeat(HELD, count, axis=0), 0.01, 1.0)
    w = np.full(len(x), 2.0)
    moved, _ = push_apart(contacts, x, before, w, H, 0.0)
    change = ((moved - x) / w[:, None])[:, 2]
    assert change[:count].sum() == pytest.approx(-change[count:].sum())
    # Each divides its own mass: the relative approach along each contact is undone on average.
    heights = []
    for i, _, a, b, c in ids:
        normal = np.cross(moved[b] - moved[a], moved[c] - moved[a])
        heights.append((moved[i] - moved[a]) @ normal / np.linalg.norm(normal))
    assert np.mean(heights) > -0.004


def test_no_contacts_change_nothing():
    x = np.random.default_rng().normal(size=(5, 3))
    none = Contacts(np.empty((0, 5), int), np.empty(0), np.empty((0, 9)), 1.0, 0.0)
    np.testing.assert_array_equal(push_apart(none, x, x - 0.1, np.ones(5), H, 0.5)[0], x)
