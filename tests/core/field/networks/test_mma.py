"""Networks on tensor cores: the weights' order, and the same values as in NumPy."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from both_networks import evaluate

from deformrf.core.base.wide import vec4h
from deformrf.core.definition.networks import mlp, sigmoid
from deformrf.core.field import BASIS_COUNT
from deformrf.core.field.networks import density_rows, mma
from deformrf.core.render.rounds import slots


def test_fragments_are_what_the_products_of_a_warp_take():
    """Of mma.m16n8k16 thread l has column l / 4 and rows 2 (l % 4) + 0, 1, 8, 9."""
    rng = np.random.default_rng()
    weights = rng.normal(size=(64, 16)).astype(np.float16)
    tiles = mma.fragments(weights).reshape(2, 4, 32, 4)
    for n, k, lane, i in rng.integers(0, (2, 4, 32, 4), (50, 4)):
        row = 16 * k + 2 * (lane % 4) + (i % 2) + 8 * (i // 2)
        assert tiles[n, k, lane, i] == weights[row, 8 * n + lane // 4]


def test_missing_columns_are_zero():
    tiles = mma.fragments(np.ones((64, 3)))
    assert tiles.shape == (4, 32, 4)
    assert tiles.sum() == 64 * 3


def test_widened_layers_compute_the_same():
    rng = np.random.default_rng()
    widths = (32, 20, 100, 3)
    layers = [(rng.normal(size=(i, o)), rng.normal(size=o)) for i, o in pairwise(widths)]
    wide = mma.widened(layers)
    assert [weights.shape for weights, _ in wide] == [(32, 32), (32, 128), (128, 3)]
    x = rng.normal(size=(50, 32))
    np.testing.assert_allclose(mlp(x, wide), mlp(x, layers), rtol=1e-12)


def test_the_cpu_has_no_tensor_cores(make_ball_field):
    assert not mma.fits(make_ball_field(1), wp.get_device("cpu"))


@pytest.mark.gpu
@pytest.mark.parametrize("level_count", [1, 3, 6, 7])
@pytest.mark.parametrize("count", [1, 31, 33, 50_000])
def test_values_are_those_of_numpy(make_ball_field, level_count, count):
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), level_count=level_count)
    device = wp.get_device("cuda:0")
    assert mma.fits(field, device)
    room = count + 7  # samples that aren't there cost nothing, and have no values
    features = rng.normal(size=(room, 4 * level_count)).astype(np.float16)
    basis = rng.normal(size=(room, BASIS_COUNT)).astype(np.float16)
    sigma, rgb = wp.zeros(room, device=device), wp.zeros(room, dtype=wp.vec3, device=device)
    mma.TensorCoreNetworks(field, device).evaluate(
        *(wp.array(a.reshape(-1, 4), dtype=vec4h, device=device) for a in (features, basis)),
        wp.full(1, count, dtype=int, device=device),
        sigma,
        rgb,
    )
    expected_sigma, expected_rgb = evaluate(
        features.astype(float),
        basis.astype(float),
        field.density_layers,
        field.color_layers,
    )
    # float16 weights and hidden layers, as in test_triton.py.
    logs = np.log(sigma.numpy()[:count]), np.log(expected_sigma[:count])
    np.testing.assert_allclose(*logs, atol=3e-2)
    np.testing.assert_allclose(rgb.numpy()[:count], expected_rgb[:count], atol=2e-2)
    assert not sigma.numpy()[count:].any()
    assert not rgb.numpy()[count:].any()


@pytest.mark.gpu
@pytest.mark.parametrize("level_count", [1, 6, 7])
@pytest.mark.parametrize("count", [1, 33, 50_000])
def test_the_density_network_alone_is_that_of_numpy(make_ball_field, level_count, count):
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), level_count=level_count, deferred=True)
    device, room = wp.get_device("cuda:0"), count + 7
    features = rng.normal(size=(room, 4 * level_count)).astype(np.float16)
    sigma = wp.zeros(room, dtype=float, device=device)
    h = wp.zeros(4 * room, dtype=vec4h, device=device)
    x = wp.array(features.reshape(-1, 4), dtype=vec4h, device=device)
    total = wp.full(1, count, dtype=int, device=device)
    mma.TensorCoreNetworks(field, device).geometry(x, total, sigma, h)
    expected = mlp(features.astype(float), field.density_layers)[:count]
    found = h.numpy().reshape(room, -1).astype(float)
    np.testing.assert_allclose(found[:count], expected, atol=3e-2, rtol=1e-2)
    np.testing.assert_allclose(np.log(sigma.numpy()[:count]), expected[:, 0], atol=3e-2)
    assert not found[count:].any() and not sigma.numpy()[count:].any()


@pytest.mark.gpu
@pytest.mark.parametrize("deferred", [False, True])
def test_free_slots_may_have_no_values_and_used_ones_have(make_ball_field, deferred):
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), deferred=deferred)
    device, stride, places = wp.get_device("cuda:0"), 64 * int(rng.integers(1, 9)), 5
    counts = rng.integers(0, 6, stride) * (np.arange(stride) // 32 % 2)  # whole tiles are free
    used = (np.arange(places)[:, None] < counts).ravel()
    count = len(used)
    features = rng.normal(size=(count, 24)).astype(np.float16)
    x = wp.array(features.reshape(-1, 4), dtype=vec4h, device=device)
    basis = wp.zeros(4 * count, dtype=vec4h, device=device)
    total = wp.full(1, count, dtype=int, device=device)
    slots = [wp.array(a, dtype=int, device=device) for a in (counts, [stride])]
    sigma, networks = wp.zeros(count, device=device), mma.TensorCoreNetworks(field, device)
    if deferred:
        networks.geometry(x, total, sigma, basis, slots)
    else:
        rgb = wp.zeros(count, dtype=wp.vec3, device=device)
        networks.evaluate(x, basis, total, sigma, rgb, slots)
    expected = mlp(features.astype(float), field.density_layers)[:, 0]
    np.testing.assert_allclose(np.log(sigma.numpy()[used]), expected[used], atol=3e-2)
    assert (sigma.numpy() == 0.0).any()


@pytest.mark.gpu
@pytest.mark.parametrize(
    "hidden", [(64, 64), (32,), (20, 100), (128,), (180, 192), (256, 64, 256), ()]
)
@pytest.mark.parametrize("count", [0, 1, 65, 40_000])
def test_the_colors_of_rays_are_those_of_numpy(make_ball_field, hidden, count):
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)), color_hidden=hidden, deferred=True)
    device, room = wp.get_device("cuda:0"), count + 7
    assert mma.fits(field, device)
    layers = [(w, rng.normal(0.0, 0.3, b.shape).astype("f4")) for w, b in field.color_layers]
    field = replace(field, color_layers=tuple(layers))
    rows = rng.normal(size=(room, 32)).astype(np.float16)
    x = wp.array(rows.reshape(-1, 4), dtype=vec4h, device=device)
    rgb = wp.zeros(room, dtype=wp.vec3, device=device)
    total = wp.full(1, count, dtype=int, device=device)
    mma.TensorCoreNetworks(field, device).colors(x, total, rgb)
    expected = sigmoid(mlp(rows.astype(float), field.color_layers))
    np.testing.assert_allclose(rgb.numpy()[:count], expected[:count], atol=2e-2)
    assert not rgb.numpy()[count:].any()


@pytest.mark.gpu
@pytest.mark.parametrize("hidden, takes", [((300,), False), ((96,), True), ((256, 32), True)])
def test_which_widths_of_a_color_a_ray_it_takes(make_ball_field, hidden, takes):
    field = make_ball_field(1, color_hidden=hidden, deferred=True)
    assert mma.fits(field, wp.get_device("cuda:0")) == takes


def test_rows_of_a_block_are_those_of_the_slots_kernel():
    """`density_rows` keeps features in shared memory, a row for each thread of a block."""
    assert density_rows.BLOCK_SIZE == slots.BLOCK_SIZE
