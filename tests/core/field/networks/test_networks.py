"""The networks: torch and the definition agree; the view basis is orthonormal."""

import re

import numpy as np
import pytest
import torch
import warp as wp
from both_networks import evaluate

from deformrf.core.base.paths import ROOT
from deformrf.core.definition.networks import sigmoid, spherical_harmonics
from deformrf.core.field import Evaluators, TorchNetworks, basis_of, basis_vector
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


@pytest.mark.gpu
@pytest.mark.parametrize("hidden", [(64,), (64, 64, 64), (32,)])
@pytest.mark.parametrize("half", [False, True])
def test_the_evaluator_of_a_device_agrees_with_the_reference(make_ball_field, hidden, half):
    """Networks of any shape."""
    rng, device = np.random.default_rng(), wp.get_device("cuda:0")
    field = make_ball_field(int(rng.integers(1000)), density_hidden=hidden)
    count, levels = 700, 6
    features = rng.normal(size=(count, levels, 4)).astype(np.float32)
    basis = spherical_harmonics(random_directions(count)).astype(np.float32)
    networks = Evaluators(field, device)
    sigma, h = networks.geometry(wp.array(features, dtype=wp.vec4, device=device), half)
    rgb = networks.colors(h, wp.array(basis, dtype=basis_vector, device=device), half)
    layers = field.density_layers, field.color_layers
    expected_sigma, expected_rgb = evaluate(
        features.reshape(count, -1), basis.astype(float), *layers
    )
    tolerance = 3e-2 if half else 1e-3
    logs = np.log(sigma.numpy()), np.log(expected_sigma)
    np.testing.assert_allclose(*logs, atol=tolerance)
    np.testing.assert_allclose(rgb.numpy(), expected_rgb, atol=tolerance)


@pytest.mark.gpu
def test_no_samples_have_no_values(make_ball_field):
    device = wp.get_device("cuda:0")
    networks = Evaluators(make_ball_field(1), device)
    sigma, h = networks.geometry(wp.empty((0, 6), dtype=wp.vec4, device=device), False)
    rgb = networks.colors(h, wp.empty(0, dtype=basis_vector, device=device), False)
    assert (sigma.shape, h.shape, rgb.shape) == ((0,), (0, 16), (0,))


@pytest.mark.gpu
@pytest.mark.parametrize("hidden, fused", [((64,), True), ((64, 64), False), ((32,), False)])
def test_only_the_usual_shape_runs_in_place(make_ball_field, hidden, fused):
    field = make_ball_field(1, density_hidden=hidden)
    assert (Evaluators(field, wp.get_device("cuda:0")).in_place is not None) == fused


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
