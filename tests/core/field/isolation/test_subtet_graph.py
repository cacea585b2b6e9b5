"""The graph of occupied sub-tets: who touches whom, and what is in them."""

from dataclasses import replace

import numpy as np
from solids import ball, matter_where

from deformrf.core.definition.networks import GEOMETRY_FEATURES, colors, geometry, sigma_from
from deformrf.core.field import subtet_colors, subtet_corners, unpack_mask
from deformrf.core.field.isolation.subtet_graph import graph_of


def test_each_sub_tet_inside_a_solid_touches_four():
    graph = matter_where(lambda points: np.ones(len(points), bool), spacing=0.2)
    counts = np.bincount(graph.pairs.ravel(), minlength=len(graph.tets))
    inner = (abs(graph.middles - 0.5) < 0.3).all(axis=1)
    assert inner.sum() > 100
    assert (counts[inner] == 4).all() and counts.max() == 4


def test_those_that_touch_are_near_each_other():
    graph = matter_where(ball((0.5, 0.5, 0.5), 0.35))
    a, b = graph.middles[graph.pairs.T]
    assert (np.linalg.norm(a - b, axis=1) < graph.edge).all()
    assert abs(graph.areas.mean() - 1.0) < 1e-9
    assert (graph.pairs[:, 0] < graph.pairs[:, 1]).all()


def test_groups_are_tets_and_children_within_these():
    graph = matter_where(ball((0.5, 0.5, 0.5), 0.35))
    tets, children = graph.groups
    np.testing.assert_array_equal(tets, graph.tets)
    for child in np.unique(children)[:20]:
        own = graph.middles[children == child]
        assert len(own) <= 8 and len(np.unique(tets[children == child])) == 1
        assert np.ptp(own, axis=0).max() < 2.0 * graph.edge


def test_its_volume_is_the_volume_of_the_solid():
    graph = matter_where(ball((0.5, 0.5, 0.5), 0.35), spacing=0.04)
    assert abs(graph.volumes.sum() / (4.0 / 3.0 * np.pi * 0.35**3) - 1.0) < 0.02


def test_a_field_gives_densities_and_masks_come_back(make_ball_field):
    field = make_ball_field(0)
    graph = graph_of(field)
    np.testing.assert_array_equal(graph.masks(np.ones(len(graph.tets), bool)), field.occupancy)
    assert len(graph.tets) == unpack_mask(field.occupancy).sum()
    # By the method's definition in float64, where density is nearly the same all over a sub-tet.
    middle = subtet_corners().mean(axis=1)[graph.subtets]
    corners = subtet_corners()[graph.subtets]
    halves = [0.5 * (middle + corners[:, k]) for k in range(4)]
    places = [middle, *halves]
    sigma = np.mean(
        [sigma_from(geometry(field.definition, graph.tets, place)) for place in places], axis=0
    )
    edges = np.cbrt(6.0 * np.sqrt(2.0) * graph.volumes)
    np.testing.assert_allclose(graph.depths, sigma * edges, rtol=1e-4)
    assert ((graph.colors >= 0.0) & (graph.colors <= 1.0)).all()


def test_a_sub_tets_color_is_that_of_its_middle(make_ball_field):
    """From any side, in a field whose colors don't depend on the direction."""
    field = make_ball_field(0)
    weights, bias = field.color_layers[0]
    weights = weights.copy()
    weights[GEOMETRY_FEATURES:] = 0.0
    field = replace(field, color_layers=((weights, bias), *field.color_layers[1:]))
    tets, subtets = np.nonzero(unpack_mask(field.occupancy))
    h = geometry(field.definition, tets, subtet_corners().mean(axis=1)[subtets])
    directions = np.random.default_rng().normal(size=(len(tets), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = colors(h, directions, field.definition.color_layers)
    np.testing.assert_allclose(subtet_colors(field, tets, subtets), expected, atol=1e-5)
    assert np.ptp(expected, axis=0).min() > 0.05
