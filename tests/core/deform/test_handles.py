"""Handles: pins hold every component, control vertices cover the object."""

import numpy as np

from deformrf.core.deform import control_vertices, falloff, lowest_pins, vertices_within
from deformrf.core.geometry import a15_grid, extract


def columns(*centers, spacing=0.06, radius=0.15, low=0.2, high=0.8):
    """Upright cylinders around points of the ground plane."""
    mesh = a15_grid(spacing)
    middle = mesh.rest_vertices[mesh.tets].mean(axis=1)
    keep = np.zeros(mesh.tet_count, bool)
    for center in centers:
        keep |= np.linalg.norm(middle[:, :2] - center, axis=1) < radius
    return extract(mesh, keep & (middle[:, 2] > low) & (middle[:, 2] < high))[0]


def test_pins_are_the_lowest_vertices():
    mesh = columns((0.5, 0.5))
    pins = lowest_pins(mesh.rest_vertices, mesh.tets)
    height = mesh.rest_vertices[:, 2]
    assert pins.any() and not pins.all()
    assert height[pins].max() < height[~pins].min()
    limit = height.min() + 0.05 * np.ptp(height)
    assert pins[height <= limit].all()


def test_every_component_stands_on_its_own_pins():
    mesh = columns((0.25, 0.25), (0.75, 0.75))
    pins = lowest_pins(mesh.rest_vertices, mesh.tets)
    left = mesh.rest_vertices[:, 0] < 0.5
    assert pins[left].sum() >= 3 and pins[~left].sum() >= 3


def test_an_object_that_stands_on_a_tip_gets_a_wider_foot():
    mesh = columns((0.5, 0.5))
    height = mesh.rest_vertices[:, 2] - mesh.rest_vertices[:, 2].min()
    cone = mesh.rest_vertices.copy()
    cone[:, :2] = 0.5 + (cone[:, :2] - 0.5) * height[:, None]  # a point at the bottom
    pins = lowest_pins(cone, mesh.tets)
    assert (np.ptp(cone[pins], axis=0)[:2] > 0.04 * height.max()).all()


def test_pins_of_a_single_tet_are_found():
    tet = np.array([[0, 0, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1.0]])
    assert lowest_pins(tet, np.array([[0, 1, 2, 3]])).any()


def test_control_vertices_are_spread_evenly():
    mesh = columns((0.5, 0.5))
    ids = control_vertices(mesh.rest_vertices, mesh.tets, count=24)
    assert len(np.unique(ids)) == 24
    chosen = mesh.rest_vertices[ids]
    apart = np.linalg.norm(chosen[:, None] - chosen, axis=-1) + np.eye(24)
    away = np.linalg.norm(mesh.rest_vertices[:, None] - chosen, axis=-1).min(axis=1)
    # Farthest-point sampling: no vertex is farther from the sample than samples are apart.
    assert away.max() <= apart.min() + 1e-12


def test_asking_for_too_many_control_vertices_gives_all():
    tet = np.eye(4, 3)
    assert sorted(control_vertices(tet, np.array([[0, 1, 2, 3]]), count=9)) == [0, 1, 2, 3]


def test_vertices_without_a_tet_are_neither_pins_nor_controls():
    vertices = np.array([[0, 0, -5], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    tets = np.array([[1, 2, 3, 4]])
    assert not lowest_pins(vertices, tets)[0]
    assert 0 not in control_vertices(vertices, tets)


def test_vertices_within_a_radius_include_the_center():
    vertices = np.array([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0]])
    assert vertices_within(vertices, 0, 0.0).tolist() == [0]
    assert vertices_within(vertices, 0, 0.1).tolist() == [0, 1]
    assert vertices_within(vertices, 1, 0.2).tolist() == [0, 1, 2]


def test_a_pull_falls_off_smoothly():
    vertices = np.zeros((6, 3))
    vertices[:, 0] = [0.0, 0.05, 0.1, 0.15, 0.2, 0.0]
    pull = falloff(vertices, 0, np.arange(6), 0.2)
    np.testing.assert_allclose(pull, [1, 0.9375**2, 0.75**2, 0.4375**2, 0, 1])
    assert falloff(vertices, 0, np.array([0]), 0.0).tolist() == [1.0]
