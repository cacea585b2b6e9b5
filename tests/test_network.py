"""The networks: torch and NumPy agree, and the view basis is orthonormal."""

import numpy as np
import pytest
import torch
import warp as wp

from deformrf.core.field import Networks, basis_of, basis_vector
from deformrf.core.field.networks import reference as network
from deformrf.core.field.networks.reference import spherical_harmonics
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


@pytest.mark.parametrize("activation", ["relu", "sigmoid"])
def test_torch_and_numpy_networks_agree(make_ball_field, activation):
    field = make_ball_field(
        np.random.default_rng().integers(1000),
        density_activation=activation,
        density_hidden=(64, 64),
    )
    features = np.random.default_rng().normal(size=(300, 24))
    basis = spherical_harmonics(random_directions(300))
    layers = field.density_layers, field.color_layers
    sigma, rgb = network.evaluate(features.copy(), basis, *layers, field.options)
    networks = Networks(*layers, activation).double()
    with torch.no_grad():
        torch_sigma, torch_rgb = networks(torch.from_numpy(features), torch.from_numpy(basis))
    np.testing.assert_allclose(torch_sigma, sigma, rtol=1e-5)  # sigma is float32 by design
    np.testing.assert_allclose(torch_rgb, rgb, atol=1e-6)
    for ours, theirs in zip(layers, networks.layers(), strict=True):
        for (w, b), (w2, b2) in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(w2, w, rtol=1e-6)
            np.testing.assert_array_equal(b2, b)


@pytest.mark.parametrize("activation", ["relu", "sigmoid"])
@pytest.mark.parametrize("levels", [6, 4])
def test_networks_in_blocks_agree_with_the_reference(make_ball_field, activation, levels):
    """Also with biases, without the finest levels, and where the last block isn't full."""
    rng = np.random.default_rng()
    field = make_ball_field(0, density_activation=activation, density_hidden=(64, 32))
    density, color = (
        tuple((w, rng.normal(size=b.shape).astype(np.float32)) for w, b in layers)
        for layers in (field.density_layers, field.color_layers)
    )
    count = network.BLOCK + 100
    features = rng.normal(size=(count, 24)).astype(np.float32)
    features[:, 4 * levels :] = 0.0
    basis = spherical_harmonics(random_directions(count)).astype(np.float32)
    networks = network.BlockedNetworks(density, color, field.options)
    sigma, rgb = networks.evaluate(features[:, : 4 * levels], basis)
    double = [
        [(w.astype(float), b.astype(float)) for w, b in layers] for layers in (density, color)
    ]
    expected_sigma, expected_rgb = network.evaluate(
        features.astype(float), basis.astype(float), *double, field.options
    )
    np.testing.assert_allclose(sigma, expected_sigma, rtol=1e-4)
    np.testing.assert_allclose(rgb, expected_rgb, atol=1e-5)


def test_sigmoid_does_not_overflow():
    x = np.array([-1e4, -1.0, 0.0, 1.0, 1e4])
    np.testing.assert_allclose(network.sigmoid(x.copy()), [0, 0.26894142, 0.5, 0.73105858, 1])


def test_truncated_exp_has_the_gradient_of_exp_and_stays_finite():
    x = torch.tensor([-3.0, 0.0, 5.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(TruncatedExp.apply, x)
    huge = torch.tensor([100.0], requires_grad=True)
    y = TruncatedExp.apply(huge)
    y.backward()
    assert torch.isfinite(y).all()
    assert torch.isfinite(huge.grad).all()
