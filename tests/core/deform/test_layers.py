"""Layers of a clamped body: the same works and displacements as of the whole matrix."""

import numpy as np
import pytest

from deformrf.core.deform.layers import Layers
from deformrf.core.deform.quadratic import consistent_masses, element_stiffnesses
from deformrf.core.geometry import A15, EDGES, edges, signed_volumes
from deformrf.core.geometry.lattice import grid

MESH = grid(A15, 0.125)
REST = MESH.rest_vertices.astype(np.float64)
ENDS = edges(MESH.tets)


def test_each_depth_of_the_clamp_has_the_solution_of_the_whole_matrix():
    count, random = len(REST), np.random.default_rng()
    layers = np.unique(REST[:, 0], return_inverse=True)[1]  # a tet has vertices in up to five
    pairs = np.sort(MESH.tets[:, EDGES], axis=2)
    keys = ENDS[:, 0].astype(int) * count + ENDS[:, 1]
    middles = np.searchsorted(keys, pairs[..., 0].astype(int) * count + pairs[..., 1])
    nodes = np.concatenate([MESH.tets, middles + count], axis=1)
    of_ends = layers[ENDS]
    places = np.concatenate([REST, REST[ENDS].mean(axis=1)])
    layers = np.append(layers, of_ends.max(axis=1))
    loads = random.normal(size=(len(layers), 3, 2))
    blocks = element_stiffnesses(REST, MESH.tets, 2.0, 1.0)
    layered = Layers(places, layers, [(nodes, blocks)], loads)

    whole = np.zeros((3 * len(layers),) * 2)
    freedoms = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), 30)
    np.add.at(whole, (freedoms[:, :, None], freedoms[:, None]), blocks)
    assert len(layered.works) == layers.max() > 2
    for clamp, (work, moved) in enumerate(zip(layered.works, layered.moved(), strict=True)):
        free = np.repeat(layers > clamp, 3)
        right = loads.reshape(-1, 2)[free]
        expected = np.linalg.solve(whole[np.ix_(free, free)], right)
        np.testing.assert_allclose(moved.reshape(-1, 2)[free], expected, atol=1e-4)
        assert not moved.reshape(-1, 2)[~free].any()
        np.testing.assert_allclose(work, right.T @ expected, rtol=1e-5)


def test_quadratic_elements_store_the_energy_of_a_strain_and_none_of_a_turn():
    random, lame, mu = np.random.default_rng(), 2.0, 3.0
    slope = random.normal(size=(3, 3))
    strain = (slope + slope.T) / 2.0
    tets, volumes = MESH.tets, np.abs(signed_volumes(REST, MESH.tets))
    nodes = np.concatenate([REST[tets], REST[tets[:, EDGES]].mean(axis=2)], axis=1)
    blocks = element_stiffnesses(REST, tets, lame, mu)

    def energies(slopes):
        moved = (nodes @ slopes.T).reshape(-1, 30)
        return 0.5 * np.einsum("ti,tij,tj->t", moved, blocks, moved)

    density = 0.5 * lame * np.trace(strain) ** 2 + mu * (strain**2).sum()
    np.testing.assert_allclose(energies(slope), density * volumes, rtol=1e-9)
    assert np.abs(energies(slope - slope.T)).max() < 1e-9
    heights = nodes[..., 2]
    masses = consistent_masses(REST, tets)
    by_corners = (heights[:, :4].sum(axis=1) ** 2 + (heights[:, :4] ** 2).sum(axis=1)) / 20.0
    of_squares = np.einsum("ta,tab,tb->t", heights, masses, heights)
    assert of_squares == pytest.approx(by_corners * volumes)
