"""Native shading on a CPU: a round's pixels are those of encoding, networks and sums one by one."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from both_networks import evaluate
from compositing import composite

from deformrf.core.definition.encoding import encode
from deformrf.core.definition.networks import (
    geometry,
    mlp,
    sigma_from,
    sigmoid,
    spherical_harmonics,
)
from deformrf.core.field import modelfile, multiplies_pairs, subtet_corners, unpack_mask
from deformrf.core.field.networks.layers import bfloat16
from deformrf.core.render import (
    RaySamples,
    Renderer,
    RenderOptions,
    camera_rays,
    empty_rays,
    empty_samples,
    from_field_of_view,
    look_at,
)
from deformrf.core.render.rounds import cpu
from deformrf.core.render.rounds.compositing import empty_pixels
from deformrf.core.training.metrics import psnr

SLOTS, RAYS = 16, 700


@pytest.fixture
def round_of(make_ball_field):
    """Shade one round of random rays: pixels, the rays that are left, and what was shaded."""

    def shaded(options, slot_count=SLOTS, **field_options):
        rng = np.random.default_rng()
        field = make_ball_field(int(rng.integers(1000)), **field_options)
        renderer = Renderer(field, "cpu")
        origins = rng.normal(size=(RAYS, 3))
        origins = 0.5 + 1.5 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
        directions = rng.uniform(0.25, 0.75, (RAYS, 3)) - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        rays, pixels = empty_rays(RAYS, "cpu"), empty_pixels(RAYS, "cpu")
        rays.origins.assign(origins.astype(np.float32))
        rays.directions.assign(directions.astype(np.float32))
        alive = wp.array(np.arange(RAYS), dtype=int, device="cpu")
        rounds = renderer.host_rounds
        slots, counts = rounds._march(rays, alive, slot_count, pixels, options)
        left, count = rounds._on_cpu.shade(rays, alive, slots, counts, pixels, options)
        assert count == counts.numpy().sum() > 0
        return renderer, rays, slots, counts.numpy(), pixels, left.numpy()

    return shaded


def composited(renderer, rays, slots, counts, level_count=None):
    """The float64 definition of a round: color, opacity, depth."""
    shown = renderer.shown
    taken = (np.arange(SLOTS) < counts[:, None]).ravel()
    tet, bary = slots.tet.numpy()[taken], slots.bary.numpy()[taken].astype(float)
    encoding = shown.definition.encoding
    encoding = replace(encoding, tables=encoding.tables[:level_count])
    features = encode(encoding, tet, bary)
    features = np.pad(features, ((0, 0), (0, 4 * shown.layout.level_count - features.shape[1])))
    directions = np.repeat(rays.directions.numpy(), counts, axis=0)
    if not shown.options.view_dependence:
        basis = spherical_harmonics(directions) * (np.arange(16) == 0)
    else:
        turned = np.einsum("nji,nj->ni", renderer.shading.rotations.numpy()[tet], directions)
        basis = spherical_harmonics(turned.astype(float))
    layers = (
        [(w.astype(float), b) for w, b in n] for n in (shown.density_layers, shown.color_layers)
    )
    sigma, rgb = evaluate(features, basis, *layers)
    lengths, t = slots.length.numpy()[taken], slots.t.numpy()[taken]
    return composite(sigma, rgb, lengths.astype(float), t.astype(float), counts)[:3]


def with_biases(field):
    rng = np.random.default_rng()
    density, color = (
        tuple((w, rng.normal(size=b.shape).astype(np.float32)) for w, b in layers)
        for layers in (field.density_layers, field.color_layers)
    )
    return replace(field, density_layers=density, color_layers=color)


def random_samples(field, count=RAYS + 31):
    """A Renderer, rays, packed samples of these anywhere, what the networks get: features, Y."""
    rng, renderer = np.random.default_rng(), Renderer(field, "cpu")
    rays, found = empty_rays(RAYS, "cpu"), RaySamples()
    directions = rng.normal(size=(RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays.directions.assign(directions.astype(np.float32))
    ids = rng.permutation(RAYS)[: RAYS // 2]
    counts = rng.multinomial(count, np.full(len(ids), 1 / len(ids)))
    tets = rng.integers(0, len(renderer.shown.mesh.tets), count)
    bary = rng.dirichlet(np.ones(4), count).astype(np.float32)
    found.ids, found.counts, found.ends = (
        wp.array(a, dtype=int, device="cpu") for a in (ids, counts, np.cumsum(counts))
    )
    found.samples = empty_samples(count, "cpu")
    found.samples.tet.assign(tets.astype(np.int32))
    found.samples.bary.assign(bary)
    features = encode(renderer.shown.definition.encoding, tets, bary.astype(float))
    turned = np.einsum(
        "nji,nj->ni", renderer.shading.rotations.numpy()[tets], directions[np.repeat(ids, counts)]
    )
    return renderer, rays, found, features, turned


@pytest.mark.parametrize("hidden", [(64, 32), (), (5, 128)])
@pytest.mark.parametrize("deferred", [False, True])
def test_values_of_samples_are_those_of_the_networks(make_ball_field, hidden, deferred):
    """Also with biases, and where the last block isn't full."""
    field = with_biases(make_ball_field(0, density_hidden=hidden, deferred=deferred))
    renderer, rays, found, features, turned = random_samples(field)
    options = RenderOptions(conformance=True)
    sigma, values = renderer.shading.on_cpu.values(rays, found, options)
    basis = spherical_harmonics(turned)
    expected_sigma, rgb = evaluate(features, basis, field.density_layers, field.color_layers)
    np.testing.assert_allclose(sigma.numpy(), expected_sigma, rtol=1e-4)
    if not deferred:
        np.testing.assert_allclose(values.numpy(), rgb, atol=1e-5)
        return
    h = mlp(features, field.density_layers)
    expected = np.concatenate([h, turned, np.zeros((len(h), 1))], axis=1)
    np.testing.assert_allclose(values.numpy(), expected, atol=1e-4)


def in_halves(x, layers):
    """`mlp` whose products take numbers and weights as bfloat16."""
    for number, (weights, bias) in enumerate(layers):
        x = bfloat16(x).astype(float) @ bfloat16(weights).astype(float) + bias
        x = x if number + 1 == len(layers) else np.maximum(x, 0)
    return x


@pytest.mark.parametrize("widths", [(64,), (), (24,), (5, 128), (7, 3)])
def test_pairs_agree_with_their_reference(make_ball_field, widths):
    """Also where a last row of weights has none beside it, and the last block isn't full."""
    if not multiplies_pairs():
        pytest.skip("this processor does not multiply pairs of bfloat16")
    field = with_biases(make_ball_field(0, density_hidden=widths, color_hidden=widths))
    renderer, rays, found, features, turned = random_samples(field)
    sigma, rgb = renderer.shading.on_cpu.values(rays, found, RenderOptions())
    basis = spherical_harmonics(turned)

    def outputs(network):
        h = network(features, field.density_layers)
        joined = np.concatenate([h, basis], axis=1)
        return h[:, 0], sigmoid(network(joined, field.color_layers))

    shaded = np.log(sigma.numpy()), rgb.numpy()
    for ours, expected, single in zip(shaded, outputs(in_halves), outputs(mlp), strict=True):
        spread = np.abs(single - expected).mean()
        assert spread > 1e-4  # the rounding is there
        # A sum that lies between two numbers rounds to either.
        error = np.abs(ours - expected)
        assert np.median(error) < 0.1 * spread and error.mean() < spread


@pytest.mark.parametrize(
    "field_options, level_count",
    [
        ({}, None),
        ({}, 2),
        ({"view_dependence": False}, None),
        ({"density_hidden": (64, 32)}, None),
        ({"density_hidden": ()}, None),
        ({"level_count": 3, "dense_levels": 1}, None),
    ],
)
def test_a_round_sums_what_the_reference_sums(round_of, field_options, level_count):
    options = RenderOptions(conformance=True, termination=0.0, level_count=level_count)
    renderer, rays, slots, counts, pixels, left = round_of(options, **field_options)
    color, opacity, depth = composited(renderer, rays, slots, counts, level_count)
    np.testing.assert_allclose(pixels.color.numpy(), color, atol=2e-5)
    np.testing.assert_allclose(1.0 - pixels.transmittance.numpy(), opacity, atol=2e-5)
    np.testing.assert_allclose(pixels.depth.numpy(), depth * opacity, atol=1e-4)
    np.testing.assert_array_equal(pixels.sample_count.numpy(), counts)
    np.testing.assert_array_equal(left, np.flatnonzero(rays.tet.numpy() > -2))
    assert len(left) > 0 and opacity.max() > 0.5


def test_rays_end_where_they_are_opaque(round_of):
    options = RenderOptions(conformance=True, termination=0.3)
    renderer, rays, slots, counts, pixels, left = round_of(options)
    transmittance = pixels.transmittance.numpy()
    assert not set(left) & set(np.flatnonzero(transmittance < 0.3))
    assert (transmittance < 0.3).any() and (transmittance >= 0.3).any()
    _, opacity, _ = composited(renderer, rays, slots, counts)
    assert (1.0 - transmittance <= opacity + 2e-5).all()


def test_light_samples_lend_their_weight_to_others(round_of):
    """Default mode leaves colors out, and neither opacity nor depth."""
    options = RenderOptions(termination=0.0, single_precision=True)
    renderer, rays, slots, counts, pixels, _ = round_of(options)
    color, opacity, depth = composited(renderer, rays, slots, counts)
    np.testing.assert_allclose(1.0 - pixels.transmittance.numpy(), opacity, atol=2e-5)
    np.testing.assert_allclose(pixels.depth.numpy(), depth * opacity, atol=1e-4)
    error = np.abs(pixels.color.numpy() - color)
    assert 0.0 < error.max() < 0.03 and error.mean() < 2e-3


def test_rounds_without_samples_leave_the_pixels_alone(round_of):
    options = RenderOptions(termination=0.03)
    renderer, rays, _, _, pixels, _ = round_of(options)
    before = pixels.color.numpy().copy(), pixels.transmittance.numpy().copy()
    alive = wp.array([3, 5], dtype=int, device="cpu")
    slots, counts = renderer.host_rounds._march(rays, alive, 4, pixels, options)
    counts.zero_()
    renderer.host_rounds._on_cpu.shade(rays, alive, slots, counts, pixels, options)
    np.testing.assert_array_equal(pixels.color.numpy(), before[0])
    np.testing.assert_array_equal(pixels.transmittance.numpy(), before[1])


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("room", [cpu.SLOTS, 256])
def test_all_rounds_at_once_are_those_that_the_host_waits_for(
    make_ball_field, monkeypatch, room, exact
):
    """Timing the stages makes the host wait for rounds, and changes nothing but sums' order."""
    monkeypatch.setattr(cpu, "SLOTS", room)
    rng = np.random.default_rng()
    renderer = Renderer(make_ball_field(int(rng.integers(1000))), "cpu")
    eye = rng.normal(size=3)
    pose = look_at(0.5 + 1.6 * eye / np.linalg.norm(eye), (0.5, 0.5, 0.5))
    camera, options = from_field_of_view(pose, 0.6, 50, 40), RenderOptions(conformance=exact)
    options = replace(options, details=True)
    at_once = renderer.render(camera, options)
    renderer.stage.seconds = {}
    waited = renderer.render(camera, options)
    assert {"march", "shade"} <= set(renderer.stage.seconds)
    assert at_once.sample_count == waited.sample_count > 1000
    for name in ("color", "depth", "tet", "samples"):
        one, other = (getattr(image, name).numpy() for image in (at_once, waited))
        np.testing.assert_allclose(one.astype(float), other, atol=1.0 if name == "color" else 1e-6)


def test_the_bundled_model_looks_the_same_in_default_mode():
    from deformrf.core.base import paths

    renderer = Renderer(modelfile.load(paths.DEFAULT_MODEL), "cpu")
    camera = from_field_of_view(look_at((1.5, -1.0, 1.0), (0.5, 0.5, 0.45)), 0.5, 160, 160)
    exact, fast = (
        renderer.render(camera, replace(RenderOptions(), conformance=exactly)).color_array() / 255.0
        for exactly in (True, False)
    )
    assert psnr(fast[..., :3], exact[..., :3]) > 55.0


def test_rounds_without_a_color_of_their_own_take_the_color_so_far(make_ball_field):
    """Where all colors are the same, nothing is lost, however light a round is."""
    rng = np.random.default_rng()
    field = make_ball_field(int(rng.integers(1000)))
    weights, bias = field.color_layers[-1]
    field = replace(field, color_layers=(*field.color_layers[:-1], (0.0 * weights, 0.0 * bias)))
    renderer, options = Renderer(field, "cpu"), RenderOptions(termination=0.0)
    camera = from_field_of_view(look_at((1.7, -0.7, 1.0), (0.5, 0.5, 0.5)), 0.5, 30, 30)
    origins, directions = camera_rays(camera)
    rays, pixels = empty_rays(900, "cpu"), empty_pixels(900, "cpu")
    rays.origins.assign(origins.astype(np.float32))
    rays.directions.assign(directions.astype(np.float32))
    alive, rounds = wp.array(np.arange(900), dtype=int, device="cpu"), renderer.host_rounds
    for number in range(4):
        slots, counts = rounds._march(rays, alive, 4, pixels, options)
        if number % 2:
            slots.length.assign(1e-4 * slots.length.numpy())  # hardly anything is there
        alive, _ = rounds._on_cpu.shade(rays, alive, slots, counts, pixels, options)
    opacity = 1.0 - pixels.transmittance.numpy()
    assert (opacity > 0.3).sum() > 50
    np.testing.assert_allclose(pixels.color.numpy(), 0.5 * opacity[:, None].repeat(3, 1), atol=1e-5)


@pytest.mark.parametrize("expected", [0.0, 1e9, "random"])
def test_what_is_expected_changes_no_pixel(make_ball_field, expected):
    """Expected densities say when a ray's round ends early, not what it shows."""
    rng = np.random.default_rng()
    renderer = Renderer(make_ball_field(int(rng.integers(1000))), "cpu")
    exact = RenderOptions(conformance=True)  # light samples would lend weight within a round
    camera = from_field_of_view(look_at((1.7, -0.7, 1.0), (0.5, 0.5, 0.5)), 0.5, 60, 50)
    before = renderer.render(camera, exact)
    densities = renderer.shading.densities.numpy()
    assert (densities > 0.0).any()
    densities[:] = 10 ** rng.uniform(-3, 5, len(densities)) if expected == "random" else expected
    after = renderer.render(camera, exact)
    np.testing.assert_allclose(after.color.numpy(), before.color.numpy().astype(int), atol=1)
    np.testing.assert_allclose(after.depth.numpy(), before.depth.numpy(), atol=1e-5)
    if expected == 0.0:
        assert after.sample_count > before.sample_count
    if expected == 1e9:
        assert after.sample_count <= before.sample_count


def test_expected_densities_are_those_of_sub_tets_middles(make_ball_field):
    renderer = Renderer(make_ball_field(3), "cpu")
    shown = renderer.shown
    tets, subtets = np.nonzero(unpack_mask(shown.occupancy))
    middles = subtet_corners().mean(axis=1)[subtets]
    expected = sigma_from(geometry(shown.definition, tets, middles))
    found = renderer.shading.densities.numpy().reshape(-1, 64)
    np.testing.assert_allclose(found[tets, subtets], expected, rtol=2e-4)
    assert len(tets) and (found[unpack_mask(shown.occupancy) == 0] == 0.0).all()
