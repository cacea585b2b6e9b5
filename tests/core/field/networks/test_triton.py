"""The fused networks compute what torch's layers compute, forward and backward.

On a GPU as they are; without one, if Triton is installed, in its interpreter.
"""

import copy
import os

import numpy as np
import pytest
import torch

INTERPRETED = not torch.cuda.is_available()
if INTERPRETED:  # before Triton is imported
    os.environ.setdefault("TRITON_INTERPRET", "1")

from deformrf.core.field import FieldOptions, TorchNetworks  # noqa: E402
from deformrf.core.field.field import layer_widths  # noqa: E402
from deformrf.core.field.networks import triton as fused  # noqa: E402
from deformrf.core.field.networks.torch import TruncatedExp  # noqa: E402

# float16 has 11 bits: one rounding is off by up to 2^-11 = 5e-4 of the value.  A sum over 64
# rounded terms keeps that relative error or less, and a sample passes five to seven layers.
FORWARD = 1e-2  # of log sigma and rgb, against no rounding
SAME_ROUNDING = 4e-3  # of gradients, if the reference rounds hidden layers too
# Against no rounding, more units come out on the other side of 0 than the reference's, and
# then their gradients are wrong as a whole: 0.03 was seen.  It finds what is quite wrong.
NO_ROUNDING = 0.15
# With the same rounding, sums in float32 and float64 may still round to neighbours, 2e-3 apart
# where h is 2 to 4; units as close to 0 as that decide nothing about the kernels.
CLOSE = 2e-3


def version(module):
    """Major and minor."""
    return tuple(int(part) for part in module.__version__.split(".")[:2])


@pytest.fixture(params=["interpreter", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request):
    """Where the kernels run, by torch's name."""
    if request.param != "interpreter":
        return request.param
    if fused.kernels is None:
        pytest.skip("needs Triton")
    if not INTERPRETED:
        pytest.skip("there is a GPU: Triton compiles the kernels")
    if version(fused.kernels.triton) < (3, 7) and version(np) >= (2, 4):
        pytest.skip("Triton's interpreter before 3.7 can't count loops with NumPy 2.4")
    if "Interpreted" not in type(fused.kernels.forward_kernel).__name__:
        pytest.skip("Triton was imported without its interpreter: run this file alone")
    return "cpu"


def random_networks(device, hidden=1, level_count=6, width=64, color_hidden=2):
    rng = np.random.default_rng()
    hiddens = {"density_hidden": (width,) * hidden, "color_hidden": (width,) * color_hidden}
    options = FieldOptions(level_count, **hiddens)

    def layers(widths):
        bound = [np.sqrt(6.0 / fan_in) for fan_in in widths[:-1]]
        return tuple(
            (rng.uniform(-b, b, (i, o)).astype(np.float32), rng.normal(0.0, 0.3, o).astype("f4"))
            for b, i, o in zip(bound, widths[:-1], widths[1:], strict=True)
        )

    density, color = (layers(widths) for widths in layer_widths(options))
    return TorchNetworks(density, color).to(device)


def random_samples(count, device, column_count=24):
    """features, basis, and gradients of sigma and rgb."""
    rng = np.random.default_rng()
    arrays = [rng.normal(size=(count, n)) for n in (column_count, 16, 1, 3)]
    x, y, g_sigma, g_rgb = (torch.tensor(a, dtype=torch.float32, device=device) for a in arrays)
    return x.requires_grad_(), y, g_sigma[:, 0], g_rgb


def rounded(x):
    """float16's value, with the gradient of x."""
    return x + (x.half().double() - x).detach()


def reference(networks, features, basis, rounding, closest=None):
    """networks(features, basis) in float64; rounded where the kernels round, or nowhere.

    `closest` [N] gets the least absolute value that a sample brings to a ReLU.
    """
    near = rounded if rounding else lambda x: x

    def linear(layer, x):
        return near(x) @ near(layer.weight).T + layer.bias

    def activated(x):
        if closest is not None:
            torch.minimum(closest, x.detach().abs().amin(dim=1), out=closest)
        return torch.relu(x)

    x = features
    for layer in networks.density[:-1]:
        x = activated(linear(layer, x))
    h = linear(networks.density[-1], x)
    x = torch.cat([h, basis], dim=1)
    for layer in networks.color[:-1]:
        x = activated(linear(layer, x))
    return TruncatedExp.apply(h[:, 0]), torch.sigmoid(linear(networks.color[-1], x))


def gradients(outputs, features, networks, *given):
    return torch.autograd.grad(outputs, [features, *networks.parameters()], given)


def reference_gradients(networks, x, y, g_sigma, g_rgb, rounding):
    double = copy.deepcopy(networks).double()
    x = x.detach().double().requires_grad_()
    outputs = reference(double, x, y.double(), rounding)
    return gradients(outputs, x, double, g_sigma.double(), g_rgb.double())


def drop_close_calls(networks, x, y, *given):
    """Take gradients from the samples in which a ReLU's side is a matter of rounding."""
    closest = torch.full((len(x),), torch.inf, dtype=torch.float64, device=x.device)
    with torch.no_grad():
        double = copy.deepcopy(networks).double()
        reference(double, x.double(), y.double(), rounding=True, closest=closest)
        for g in given:
            g[closest < CLOSE] = 0.0
    assert (closest >= CLOSE).sum() > len(x) / 4


def relative_error(ours, expected):
    return float((ours.double() - expected).norm() / expected.norm())


@pytest.mark.parametrize(("width", "color_hidden"), [(64, 2), (64, 1), (32, 1), (5, 1)])
def test_values_and_gradients_match_float64(device, width, color_hidden):
    networks = random_networks(device, width=width, color_hidden=color_hidden)
    x, y, g_sigma, g_rgb = random_samples(np.random.default_rng().integers(300, 700), device)
    sigma, rgb = fused.evaluate(networks, x, y)
    assert sigma.dtype == rgb.dtype == torch.float32
    with torch.no_grad():
        exact_sigma, exact_rgb = reference(
            copy.deepcopy(networks).double(), x.double(), y.double(), rounding=False
        )
    # log sigma is a sum of 64 terms, and its error is relative to the largest of them.
    log_sigma, exact_log = sigma.double().log(), exact_sigma.log()
    scale = exact_log.abs().max().clamp(min=1.0)
    torch.testing.assert_close(log_sigma, exact_log, rtol=0.0, atol=FORWARD * float(scale))
    torch.testing.assert_close(rgb.double(), exact_rgb, rtol=0.0, atol=FORWARD)

    g_sigma /= sigma.detach()  # as compositing's are; else a single sample outweighs all others
    drop_close_calls(networks, x, y, g_sigma, g_rgb)
    ours = gradients((sigma, rgb), x, networks, g_sigma, g_rgb)
    for rounding, tolerance in ((True, SAME_ROUNDING), (False, NO_ROUNDING)):
        expected = reference_gradients(networks, x, y, g_sigma, g_rgb, rounding)
        errors = [relative_error(a, b) for a, b in zip(ours, expected, strict=True)]
        assert max(errors) < tolerance, (rounding, errors)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float16])
def test_the_density_network_alone_matches_float64(device, dtype):
    networks = random_networks(device)
    x, y, g_sigma, _ = random_samples(np.random.default_rng().integers(300, 700), device)
    x = x.detach().to(dtype).requires_grad_()
    sigma, h = fused.evaluate_density(networks, x)
    assert sigma.dtype == h.dtype == torch.float32
    double = copy.deepcopy(networks).double()
    with torch.no_grad():
        exact = double.density_features(x.double())
    scale = float(exact.abs().max().clamp(min=1.0))
    torch.testing.assert_close(h.double(), exact, rtol=0.0, atol=FORWARD * scale)
    torch.testing.assert_close(sigma, h[:, 0].exp(), rtol=1e-6, atol=0.0)

    g_h = torch.randn_like(h)
    g_sigma /= sigma.detach()
    drop_close_calls(networks, x.float(), y, g_sigma, g_h)
    weights = [x, *networks.density.parameters()]
    ours = torch.autograd.grad((sigma, h), weights, (g_sigma, g_h))
    assert ours[0].dtype == dtype
    x = x.detach().double().requires_grad_()
    near = rounded(
        torch.relu(rounded(x) @ rounded(double.density[0].weight).T + double.density[0].bias)
    )
    h = near @ rounded(double.density[1].weight).T + double.density[1].bias
    weights = [x, *double.density.parameters()]
    given = (g_sigma.double(), g_h.double())
    expected = torch.autograd.grad((TruncatedExp.apply(h[:, 0]), h), weights, given)
    errors = [relative_error(a, b) for a, b in zip(ours, expected, strict=True)]
    assert max(errors) < SAME_ROUNDING, errors


@pytest.mark.parametrize("count", [0, 1, 200])
def test_the_density_of_samples_past_the_count_is_neither_read_nor_written(device, count):
    networks = random_networks(device)
    x, _, g_sigma, _ = random_samples(300, device)
    counter = torch.tensor([count], dtype=torch.int32, device=device)
    g_h = torch.randn(300, 16, device=device)
    with torch.no_grad():
        for array in (x, g_sigma, g_h):
            array[count:] = torch.nan
    weights = list(networks.density.parameters())
    outputs = fused.evaluate_density(networks, x, counter)
    ours = torch.autograd.grad(outputs, [x, *weights], (g_sigma, g_h))
    few = x[:count].detach().requires_grad_()
    outputs = fused.evaluate_density(networks, few)
    expected = torch.autograd.grad(outputs, [few, *weights], (g_sigma[:count], g_h[:count]))
    torch.testing.assert_close(ours[0][:count], expected[0], rtol=0.0, atol=0.0)
    for a, b in zip(ours[1:], expected[1:], strict=True):
        torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-5 * float(b.abs().max()))


@pytest.mark.parametrize("level_count", [1, 3, 8])
def test_any_number_of_levels_up_to_eight(device, level_count):
    networks = random_networks(device, level_count=level_count)
    x, y, *given = random_samples(200, device, 4 * level_count)
    drop_close_calls(networks, x, y, *given)
    ours = gradients(fused.evaluate(networks, x, y), x, networks, *given)
    expected = reference_gradients(networks, x, y, *given, rounding=True)
    errors = [relative_error(a, b) for a, b in zip(ours, expected, strict=True)]
    assert max(errors) < SAME_ROUNDING, errors


def test_half_features_get_half_gradients(device):
    networks = random_networks(device)
    x, y, *given = random_samples(100, device)
    half = x.detach().half().requires_grad_()
    ours = gradients(fused.evaluate(networks, half, y), half, networks, *given)
    assert ours[0].dtype == torch.float16
    expected = gradients(fused.evaluate(networks, x, y), x, networks, *given)
    torch.testing.assert_close(ours[0].float(), expected[0], rtol=1e-3, atol=1e-6)
    for a, b in zip(ours[1:], expected[1:], strict=True):
        torch.testing.assert_close(a, b, rtol=0.0, atol=0.0)


def test_no_samples(device):
    networks = random_networks(device)
    x, y, *given = random_samples(0, device)
    sigma, rgb = fused.evaluate(networks, x, y)
    assert sigma.shape == (0,)
    assert rgb.shape == (0, 3)
    x_grad, *rest = gradients((sigma, rgb), x, networks, *given)
    assert x_grad.shape == x.shape
    assert not any(gradient.any() for gradient in rest)


@pytest.mark.parametrize("count", [0, 1, 200, 1000])
def test_samples_past_the_count_are_neither_read_nor_written(device, count):
    room = 1000
    networks = random_networks(device)
    x, y, g_sigma, g_rgb = random_samples(room, device)
    counter = torch.tensor([count], dtype=torch.int32, device=device)
    with torch.no_grad():
        for array in (x, y, g_sigma, g_rgb):
            array[count:] = torch.nan
    ours = gradients(fused.evaluate(networks, x, y, counter), x, networks, g_sigma, g_rgb)
    few = x[:count].detach().requires_grad_()
    outputs = fused.evaluate(networks, few, y[:count])
    expected = gradients(outputs, few, networks, g_sigma[:count], g_rgb[:count])
    torch.testing.assert_close(ours[0][:count], expected[0], rtol=0.0, atol=0.0)
    for a, b in zip(ours[1:], expected[1:], strict=True):  # other programs, other order of sums
        torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-5 * float(b.abs().max()))

    sigma, rgb = torch.full((room,), -1.0, device=device), torch.full((room, 3), -1.0).to(device)
    parameters = fused.pack(fused.widened(networks)).detach()
    given = x.detach(), y, parameters, counter
    fused._launch(fused.kernels.forward_kernel, fused.FORWARD, *given, sigma, rgb)
    assert torch.equal(sigma[:count], outputs[0])
    assert (sigma[count:] == -1.0).all()
    assert (rgb[count:] == -1.0).all()


@pytest.mark.parametrize("exponent", [-60, -20, 20, 60])
def test_gradients_follow_the_scale_of_the_loss(device, exponent):
    """Far outside float16's range: the kernels measure gradients in units of their own."""
    networks = random_networks(device)
    x, y, g_sigma, g_rgb = random_samples(100, device)
    outputs = fused.evaluate(networks, x, y)
    ours = torch.autograd.grad(outputs, x, [g_sigma, g_rgb], retain_graph=True)[0]
    scale = 2.0**exponent
    scaled = torch.autograd.grad(outputs, x, [g_sigma * scale, g_rgb * scale])[0]
    torch.testing.assert_close(scaled / scale, ours, rtol=1e-2, atol=1e-4 * float(ours.abs().max()))


def test_small_gradients_of_the_color_survive_large_ones_of_sigma(device):
    networks = random_networks(device)
    x, y, g_sigma, g_rgb = random_samples(200, device)
    given = (g_sigma * 1e6, g_rgb * 1e-6)
    drop_close_calls(networks, x, y, *given)
    ours = gradients(fused.evaluate(networks, x, y), x, networks, *given)
    expected = reference_gradients(networks, x, y, *given, rounding=True)
    errors = [relative_error(a, b) for a, b in zip(ours, expected, strict=True)]
    assert max(errors) < SAME_ROUNDING, errors


def test_sigma_keeps_the_gradient_of_the_torch_layers_beyond_its_limit(device):
    networks = random_networks(device)
    with torch.no_grad():
        networks.density[-1].bias[0] = 30.0
    x, y, g_sigma, g_rgb = random_samples(50, device)
    sigma, rgb = fused.evaluate(networks, x, y)
    torch.testing.assert_close(sigma, torch.full_like(sigma, np.exp(15.0)), rtol=1e-5, atol=0.0)
    bias_grad = gradients((sigma, rgb), x, networks, g_sigma, 0.0 * g_rgb)[4]
    assert len(bias_grad) == 16
    expected = float(g_sigma.double().sum() * np.exp(15.0))
    assert abs(float(bias_grad[0]) - expected) < 1e-5 * float(g_sigma.abs().sum()) * np.exp(15.0)


def test_a_gradient_that_is_no_number_shows(device):
    networks = random_networks(device)
    x, y, g_sigma, g_rgb = random_samples(50, device)
    g_rgb[7, 1] = torch.nan
    x_grad, *rest = gradients(fused.evaluate(networks, x, y), x, networks, g_sigma, g_rgb)
    assert x_grad[7].isnan().any()
    assert all(gradient.isnan().any() for gradient in rest)


def test_the_same_again_gives_the_same(device):
    networks = random_networks(device)
    x, y, *given = random_samples(1000, device)
    first, second = (
        gradients(fused.evaluate(networks, x, y), x, networks, *given) for _ in range(2)
    )
    assert all(torch.equal(a, b) for a, b in zip(first, second, strict=True))


def test_the_cpu_has_the_torch_layers():
    networks = random_networks("cpu")
    assert not fused.fits(networks)
    x, y, *_ = random_samples(10, "cpu")
    for ours, expected in zip(networks.evaluate(x, y), networks(x, y), strict=True):
        assert torch.equal(ours, expected)


@pytest.mark.gpu
def test_what_the_kernels_take():
    assert fused.kernels is not None, "torch for CUDA comes with Triton"
    assert fused.fits(random_networks("cuda:0"))
    assert not fused.fits(random_networks("cuda:0", hidden=2))
    assert not fused.fits(random_networks("cuda:0", level_count=9))
    assert fused.fits(random_networks("cuda:0", width=32, color_hidden=1))
    assert not fused.fits(random_networks("cuda:0", width=128, color_hidden=1))
    assert not fused.fits(random_networks("cuda:0", width=32))


@pytest.mark.gpu
def test_a_graph_holds_forward_and_backward():
    """Recorded with one count, replayed with another: nothing about it is in the graph."""
    networks = random_networks("cuda:0")
    x, y, *given = random_samples(3000, "cuda:0")
    counter = torch.tensor([100], dtype=torch.int32, device="cuda:0")

    def work():
        outputs = fused.evaluate(networks, x, y, counter)
        return gradients(outputs, x, networks, *given)

    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        work()
    torch.cuda.current_stream().wait_stream(stream)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        recorded = work()
    counter.fill_(2500)
    graph.replay()
    for ours, expected in zip(recorded[1:], work()[1:], strict=True):
        torch.testing.assert_close(ours, expected, rtol=0.0, atol=0.0)
    torch.testing.assert_close(recorded[0][:2500], work()[0][:2500], rtol=0.0, atol=0.0)
