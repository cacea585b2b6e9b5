"""Boxes and contacts of random poses: the kernels against the float64 reference."""

import contact_search
import numpy as np
import pytest
from contact_scenes import box, joined, pressed_balls, two_balls

from deformrf.core.deform import FIRST_INTEGRATOR, Material, XpbdOptions, XpbdSolver
from deformrf.core.deform.contact.boxes import ASLEEP, AWAKE, OUT
from deformrf.core.deform.contact.clusters import make_clusters
from deformrf.core.deform.contact.contact import REST_GAP, Contact
from deformrf.core.deform.contact.detection import DEEP, NO_FACE
from deformrf.core.deform.contact.surface import exits, make_surface
from deformrf.core.geometry import edges

DT = 1.0 / 60.0


REST, TETS, _ = two_balls(0.095, 1.0)
BOTH = np.ones(2, bool)
UPPER = REST[:, 2] > 0.8


def expected(solver, contact, state, velocities, exits_before=None):
    """What the reference finds, and its clusters and surface."""
    rest, tets = solver.rest_vertices, solver.volumes.vertices
    edge = np.linalg.norm(np.diff(rest[edges(tets)], axis=1)[:, 0], axis=1).mean()
    clusters = make_clusters(rest, tets, REST_GAP * edge)
    surface = make_surface(rest, tets, clusters)
    ways = DT * velocities
    boxes = contact_search.boxes(clusters, state, ways, contact._margin)
    partners = contact_search.overlaps(clusters, *boxes, np.full(len(boxes[0]), AWAKE))
    if exits_before is None:
        exits_before = np.full(len(surface.ends), NO_FACE)
    limits = contact._margin, contact._tolerance
    inputs = exits(rest, surface), rest, state, ways, partners
    return contact_search.find(clusters, surface, *inputs, *limits, exits_before), boxes, partners


@pytest.mark.parametrize("depth", [-0.06, 0.03, 0.12])
def test_contacts_are_those_of_the_reference(device, depth):
    solver, contact, state, velocities = pressed_balls(device, depth, DT)
    found, boxes, partners = expected(solver, contact, state, velocities)
    np.testing.assert_allclose(contact._boxes.numpy(), np.concatenate(boxes, axis=1).T, atol=1e-6)
    counts = contact._touched.numpy()[: len(partners)]
    overlaps = contact._overlaps.numpy()
    for row, count, others in zip(overlaps, counts, partners, strict=True):
        assert row[:count].tolist() == others.tolist()
    listed = contact._found.numpy()
    counts = contact._counts.numpy()
    same = []
    for row, count, (wanted, _) in zip(listed, counts, found, strict=True):
        same.append(sorted(row[:count].tolist()) == sorted(wanted))
    assert np.mean(same) > 0.98  # in float32 a distance may be on the other side of a limit
    assert sum(len(wanted) for wanted, _ in found) > 20
    leaves_by = np.array([face for _, face in found])
    assert np.mean(contact._exits.numpy() == leaves_by) > 0.99
    assert ((leaves_by != NO_FACE).sum() > 5) == (depth > 0.0)


def test_a_sample_leaves_where_it_left_before(device):
    """Unless another face is much nearer: none of a random choice is kept, of near ones many."""
    solver, contact, state, velocities = pressed_balls(device, 0.12, DT)
    first = contact._exits.numpy().copy()
    before = np.where(first == NO_FACE, NO_FACE, 0)
    inside = np.flatnonzero(first != NO_FACE)
    shape = contact._shape
    beside = shape.exits.numpy()
    of_face = {int(face): row for row in beside for face in row[:1]}
    for sample in inside:
        before[sample] = of_face.get(int(first[sample]), [first[sample]] * 3)[2]
    contact._exits.assign(before.astype(np.int32))
    contact.find(DT, BOTH, ~BOTH)
    found, _, _ = expected(solver, contact, state, velocities, exits_before=before)
    kept = contact._exits.numpy()
    assert np.mean(kept == [face for _, face in found]) > 0.99
    changed = kept[inside] != first[inside]
    assert changed.any() and (kept[inside][changed] == before[inside][changed]).all()
    assert not changed.all()


@pytest.mark.parametrize("gap", [-0.002, 0.002])
def test_a_plane_counts_once(device, gap):
    """Of boxes one on the other, with vertices upon vertices, in front of faces and behind them."""
    vertices, tets = box((3, 3, 1), 0.1)
    step = np.array([0.0, 0.0, 0.1 + gap])
    rest, tets, _ = joined((vertices, tets), (vertices + step, tets))
    solver = XpbdSolver(rest, tets, Material(), np.zeros(len(rest), bool), device=device)
    contact = Contact(solver.rest_vertices, solver.volumes.vertices, solver._state)
    most, default = {}, XpbdOptions.integrator
    for integrator in (default, FIRST_INTEGRATOR, default):
        contact.take(integrator)
        contact.find(DT, BOTH, ~BOTH)
        listed, shape = contact._found.numpy(), contact._shape
        faces, corners = np.where(listed <= DEEP, DEEP - listed, listed), shape.faces.numpy()
        a, b, c = (rest[corners[:, i]] for i in range(3))
        level = np.abs(np.cross(b - a, c - a)[:, :2]).max(axis=1) < 1e-9
        inner = np.abs(rest[shape.ends.numpy()][:, :, :2] - 0.15).max(axis=(1, 2)) < 0.1
        of_sample = ((faces != NO_FACE) & level[faces]).sum(axis=1)
        most[integrator] = of_sample.max()
        assert of_sample[inner].max() > 0
    assert most[default] == 1 < most[FIRST_INTEGRATOR]


def test_bodies_that_are_apart_have_no_contacts(device):
    solver = XpbdSolver(REST, TETS, Material(), np.zeros(len(REST), bool), device=device)
    contact = Contact(solver.rest_vertices, solver.volumes.vertices, solver._state)
    assert len(contact.find(DT, BOTH, ~BOTH)) == 0


def test_bodies_that_sleep_or_are_out_do_not_collide(device):
    _, contact, _, _ = pressed_balls(device, 0.05, DT)
    first = np.array([True, False])
    assert contact.find(DT, BOTH, ~BOTH).tolist() == [0, 1]
    assert contact.find(DT, first, ~BOTH).tolist() == [0, 1]  # and so the other one wakes
    assert len(contact.find(DT, ~BOTH, ~BOTH)) == 0
    assert len(contact.find(DT, BOTH, first)) == 0
    assert OUT + AWAKE <= AWAKE < ASLEEP + AWAKE


def test_a_fast_body_is_seen_before_it_is_there(device):
    """It would pass through half of the other body within the frame."""
    solver = XpbdSolver(REST, TETS, Material(), np.zeros(len(REST), bool), device=device)
    velocities = np.where(UPPER[:, None], [0.0, 0.0, -0.7 / DT], 0.0)
    solver.set_state(REST, velocities)
    contact = Contact(solver.rest_vertices, solver.volumes.vertices, solver._state)
    contact.find(DT, BOTH, ~BOTH)
    assert contact._counts.numpy().sum() > 50
