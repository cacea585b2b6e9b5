"""The networks: torch, NumPy in blocks and the definition agree; the view basis is orthonormal."""

import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import warp as wp
from both_networks import evaluate

from deformrf.core.base.paths import ROOT
from deformrf.core.definition.networks import mlp, sigmoid, spherical_harmonics
from deformrf.core.field import TorchNetworks, basis_of, basis_vector, evaluators
from deformrf.core.field.networks import cpu
from deformrf.core.field.networks.shapes import has_usual_shape
from deformrf.core.field.networks.torch import TruncatedExp


def random_directions(count):
    d = np.random.default_rng().normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def test_spherical_harmonics_are_orthonormal():
    """∫ Y_i Y_j = δ_ij, by a quadrature that is exact for these degrees."""
    z, weight = np.polynomial.legendre.leggauss(8)
    phi = np.arange(16) * 2 * np.pi / 16
    r = np.sqrt(1 - z**2)
    d = np.stack(
        [np.outer(r, np.cos(phi)), np.outer(r, np.sin(phi)), np.outer(z, np.ones(16))], axis=-1
    ).reshape(-1, 3)
    weights = np.repeat(weight, 16) * 2 * np.pi / 16
    y = spherical_harmonics(d)
    np.testing.assert_allclose((y * weights[:, None]).T @ y, np.eye(16), atol=1e-12)


@wp.kernel
def basis_kernel(directions: wp.array(dtype=wp.vec3), basis: wp.array(dtype=basis_vector)):
    n = wp.tid()
    basis[n] = basis_of(directions[n])


def test_basis_kernel_matches_numpy(device):
    d = random_directions(1000)
    basis = wp.empty(1000, dtype=basis_vector, device=device)
    directions = wp.array(d.astype(np.float32), dtype=wp.vec3, device=device)
    wp.launch(basis_kernel, dim=1000, inputs=[directions], outputs=[basis], device=device)
    np.testing.assert_allclose(basis.numpy(), spherical_harmonics(d), atol=2e-6)


@pytest.mark.parametrize("hidden", [(64,), (64, 64), ()])
def test_torch_and_numpy_networks_agree(make_ball_field, hidden):
    field = make_ball_field(np.random.default_rng().integers(1000), density_hidden=hidden)
    features = np.random.default_rng().normal(size=(300, 24))
    basis = spherical_harmonics(random_directions(300))
    layers = field.density_layers, field.color_layers
    sigma, rgb = evaluate(features, basis, *layers)
    networks = TorchNetworks(*layers).double()
    with torch.no_grad():
        torch_sigma, torch_rgb = networks(torch.from_numpy(features), torch.from_numpy(basis))
    np.testing.assert_allclose(torch_sigma, sigma, rtol=1e-5)  # sigma is float32 by design
    np.testing.assert_allclose(torch_rgb, rgb, atol=1e-6)
    for ours, theirs in zip(layers, networks.layers(), strict=True):
        for (w, b), (w2, b2) in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(w2, w, rtol=1e-6)
            np.testing.assert_array_equal(b2, b)


@pytest.mark.parametrize("hidden", [(64, 32), ()])
@pytest.mark.parametrize("levels", [6, 4])
def test_networks_in_blocks_agree_with_the_reference(make_ball_field, hidden, levels):
    """Also with biases, without the finest levels, and where the last block isn't full."""
    rng = np.random.default_rng()
    field = make_ball_field(0, density_hidden=hidden)
    density, color = (
        tuple((w, rng.normal(size=b.shape).astype(np.float32)) for w, b in layers)
        for layers in (field.density_layers, field.color_layers)
    )
    count = cpu.NETWORK_BLOCK + 31
    features = rng.normal(size=(count, 24)).astype(np.float32)
    features[:, 4 * levels :] = 0.0
    basis = spherical_harmonics(random_directions(count)).astype(np.float32)
    networks = cpu.CpuNetworks(density, color)
    x = wp.array(features.reshape(count, 6, 4)[:, :levels], dtype=wp.vec4, device="cpu")
    sigma, h = networks.geometry(x)
    rgb = networks.colors(h, wp.array(basis, dtype=basis_vector, device="cpu"))
    double = [
        [(w.astype(float), b.astype(float)) for w, b in layers] for layers in (density, color)
    ]
    expected_sigma, expected_rgb = evaluate(features.astype(float), basis.astype(float), *double)
    np.testing.assert_allclose(sigma.numpy(), expected_sigma, rtol=1e-4)
    np.testing.assert_allclose(rgb.numpy(), expected_rgb, atol=1e-5)


def in_halves(x, layers):
    """`mlp` whose products take numbers and weights as bfloat16."""
    for number, (weights, bias) in enumerate(layers):
        x = cpu.bfloat16(x).astype(float) @ cpu.bfloat16(weights).astype(float) + bias
        x = x if number + 1 == len(layers) else np.maximum(x, 0)
    return x


@pytest.mark.parametrize("widths", [(64,), (), (24,), (5, 128), (7, 3)])
def test_pairs_agree_with_their_reference(make_ball_field, widths):
    """Also where a last row of weights has none beside it, and the last block isn't full."""
    if not cpu.multiplies_pairs():
        pytest.skip("this processor does not multiply pairs of bfloat16")
    rng = np.random.default_rng()
    field = make_ball_field(0, density_hidden=widths, color_hidden=widths)
    density, color = (
        tuple((w, rng.normal(size=b.shape).astype(np.float32)) for w, b in layers)
        for layers in (field.density_layers, field.color_layers)
    )
    count = cpu.NETWORK_BLOCK + 31
    features = rng.normal(size=(count, 24)).astype(np.float32)
    basis = spherical_harmonics(random_directions(count)).astype(np.float32)
    networks = cpu.CpuNetworks(density, color)
    x = wp.array(features.reshape(count, 6, 4), dtype=wp.vec4, device="cpu")
    _, h = networks.geometry(x, half=True)
    rgb = networks.colors(h, wp.array(basis, dtype=basis_vector, device="cpu"), half=True)
    joined = np.concatenate([h.numpy(), basis], axis=1)
    for found, rows, layers, last in (
        (h, features, density, np.copy),
        (rgb, joined, color, sigmoid),
    ):
        expected, single = last(in_halves(rows, layers)), last(mlp(rows.astype(float), layers))
        spread = np.abs(single - expected).mean()
        assert spread > 1e-4  # the rounding is there
        # A sum that lies between two numbers rounds to either.
        error = np.abs(found.numpy() - expected)
        assert np.median(error) < 0.1 * spread and error.mean() < spread


def test_bfloat16_is_the_nearest():
    rng = np.random.default_rng()
    x = (rng.normal(size=5000) * np.exp(rng.normal(size=5000, scale=9))).astype(np.float32)
    found = cpu.bfloat16(x)
    assert not (found.view(np.uint32) & 0xFFFF).any()
    np.testing.assert_array_equal(found, torch.from_numpy(x).bfloat16().float().numpy())
    pairs = cpu.row_pairs(x[:15].reshape(5, 3))
    assert pairs.shape == (3, 3) and pairs.dtype == np.int32
    halves = pairs.view(np.uint16).reshape(3, 3, 2).swapaxes(1, 2).reshape(6, 3)
    np.testing.assert_array_equal(
        (halves[:5].astype(np.uint32) << 16).view(np.float32), found[:15].reshape(5, 3)
    )
    assert not halves[5].any()


@pytest.mark.parametrize("hidden", [(64,), (64, 64, 64), (32,)])
@pytest.mark.parametrize("half", [False, True])
def test_the_evaluator_of_a_device_agrees_with_the_reference(make_ball_field, device, hidden, half):
    """Networks of any shape, on every device, without the finest level."""
    rng, device = np.random.default_rng(), wp.get_device(device)
    field = make_ball_field(int(rng.integers(1000)), density_hidden=hidden)
    count, levels = 700, 5
    features = rng.normal(size=(count, levels, 4)).astype(np.float32)
    basis = spherical_harmonics(random_directions(count)).astype(np.float32)
    networks = evaluators(field, device)
    sigma, h = networks.geometry(wp.array(features, dtype=wp.vec4, device=device), half)
    rgb = networks.colors(h, wp.array(basis, dtype=basis_vector, device=device), half)
    whole = np.concatenate([features.reshape(count, -1), np.zeros((count, 4))], axis=1)
    expected_sigma, expected_rgb = evaluate(
        whole, basis.astype(float), field.density_layers, field.color_layers
    )
    if half and device.is_cpu and cpu.multiplies_pairs():
        expected_h = in_halves(whole, field.density_layers)
        joined = np.concatenate([h.numpy(), basis], axis=1)
        expected_sigma = np.exp(expected_h[:, 0])
        expected_rgb = sigmoid(in_halves(joined, field.color_layers))
        for error in (np.log(sigma.numpy() / expected_sigma), rgb.numpy() - expected_rgb):
            assert np.median(np.abs(error)) < 1e-4 and np.abs(error).max() < 5e-2
        return
    tolerance = 3e-2 if half and device.is_cuda else 1e-3
    logs = np.log(sigma.numpy()), np.log(expected_sigma)
    np.testing.assert_allclose(*logs, atol=tolerance)
    np.testing.assert_allclose(rgb.numpy(), expected_rgb, atol=tolerance)


def test_no_samples_have_no_values(make_ball_field, device):
    networks = evaluators(make_ball_field(1), wp.get_device(device))
    sigma, h = networks.geometry(wp.empty((0, 6), dtype=wp.vec4, device=device), False)
    rgb = networks.colors(h, wp.empty(0, dtype=basis_vector, device=device), False)
    assert (sigma.shape, h.shape, rgb.shape) == ((0,), (0, 16), (0,))


@pytest.mark.parametrize("torch_is", ["missing", "a CPU build"])
def test_numpy_evaluates_for_a_gpu_that_torch_does_not_serve(
    make_ball_field, device, monkeypatch, torch_is
):
    """A GPU of an old kind; on the CPU, a device that only says that it is one."""
    if torch_is == "missing":
        monkeypatch.setitem(sys.modules, "torch", None)
    else:
        monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    rng, count = np.random.default_rng(), 700
    field = make_ball_field(int(rng.integers(1000)))
    networks = evaluators(field, SimpleNamespace(is_cuda=True, arch=70, ordinal=0))
    assert networks.in_place is None
    features = rng.normal(size=(count, 6, 4)).astype(np.float32)
    basis = spherical_harmonics(random_directions(count)).astype(np.float32)
    arrays = (
        wp.array(features, dtype=wp.vec4, device=device),
        wp.array(basis, dtype=basis_vector, device=device),
    )
    expected_sigma, expected_rgb = evaluate(
        features.reshape(count, -1), basis.astype(float), field.density_layers, field.color_layers
    )
    for half in (False, True):
        sigma, h = networks.geometry(arrays[0], half)
        rgb = networks.colors(h, arrays[1], half)
        assert sigma.device == rgb.device == wp.get_device(device)
        tolerance = 0.15 if half and cpu.multiplies_pairs() else 1e-3
        np.testing.assert_allclose(np.log(sigma.numpy()), np.log(expected_sigma), atol=tolerance)
        np.testing.assert_allclose(rgb.numpy(), expected_rgb, atol=tolerance)


@pytest.mark.gpu
@pytest.mark.parametrize("hidden, fused", [((64,), True), ((64, 64), False), ((32,), False)])
def test_only_the_usual_shape_runs_in_place(make_ball_field, hidden, fused):
    field = make_ball_field(1, density_hidden=hidden)
    assert (evaluators(field, wp.get_device("cuda:0")).in_place is not None) == fused


def test_the_usual_shape():
    usual = [(24, 64), (64, 16), (32, 64), (64, 64), (64, 3)]
    assert has_usual_shape(usual) and has_usual_shape([(4, 64), *usual[1:]])
    assert not has_usual_shape([(36, 64), *usual[1:]])
    assert not has_usual_shape([usual[0], (64, 64), *usual[1:]])
    assert not has_usual_shape([(24, 32), (32, 16), *usual[2:]])


def test_sigmoid_does_not_overflow():
    x = np.array([-1e4, -1.0, 0.0, 1.0, 1e4])
    np.testing.assert_allclose(sigmoid(x.copy()), [0, 0.26894142, 0.5, 0.73105858, 1])


def test_truncated_exp_has_the_gradient_of_exp_and_stays_finite():
    x = torch.tensor([-3.0, 0.0, 5.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(TruncatedExp.apply, x)
    huge = torch.tensor([100.0], requires_grad=True)
    y = TruncatedExp.apply(huge)
    y.backward()
    assert torch.isfinite(y).all()
    assert torch.isfinite(huge.grad).all()


def test_the_documented_harmonics_are_those_of_the_program():
    """docs/model-format.md writes them out for other programs."""
    text = (ROOT / "docs/model-format.md").read_text(encoding="utf-8")
    rows = text.split("| i | Yᵢ | i | Yᵢ |")[1].split("\n\n")[0].splitlines()[2:]
    cells = [cell.strip() for row in rows for cell in row.strip("|").split("|")]
    formulas = dict(zip(map(int, cells[::2]), cells[1::2], strict=True))
    directions = np.random.default_rng().normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    names = dict(zip("xyz", directions.T, strict=True))
    expected = spherical_harmonics(directions)
    for i in range(16):
        formula = formulas[i].replace("−", "-").replace("²", "**2")
        formula = re.sub(r"(?<=[\dxyz)])\s*(?=[xyz(])", "*", formula)
        np.testing.assert_allclose(eval(formula, names) + 0 * names["x"], expected[:, i])
