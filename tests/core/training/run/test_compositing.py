"""Compositing: closed forms of the volume-rendering sum, and its gradients."""

import numpy as np
import pytest
import torch
import warp as wp
from compositing import composite

from deformrf.core.field import GEOMETRY_FEATURES
from deformrf.core.training.run.compositing import LEAST_TRANSMITTANCE
from deformrf.core.training.run.differentiable import Composite


def random_samples(ray_count=40, longest=100, channels=3):
    """Packed samples of rays, some of which have none."""
    rng = np.random.default_rng()
    counts = rng.integers(0, longest, ray_count)
    total = counts.sum()
    length = rng.uniform(0.01, 0.3, total)
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    ends = np.cumsum(length)
    t = ends - 0.5 * length - np.concatenate([[0], ends])[starts]
    return rng.exponential(3.0, total), rng.uniform(size=(total, channels)), length, t, counts


def test_a_homogeneous_medium_absorbs_exponentially():
    color, opacity, depth, _, lead = composite(
        np.full(1000, 2.0),
        np.tile([0.2, 0.4, 0.6], (1000, 1)),
        np.full(1000, 1e-3),
        (np.arange(1000) + 0.5) * 1e-3,
        np.array([1000]),
    )
    assert opacity[0] == pytest.approx(1 - np.exp(-2.0))
    np.testing.assert_allclose(color[0], opacity[0] * np.array([0.2, 0.4, 0.6]))
    mean_depth = (1 - 3 * np.exp(-2.0)) / 2 / (1 - np.exp(-2.0))  # ∫ t σ e^(-σ t) / opacity
    assert depth[0] == pytest.approx(mean_depth, rel=1e-5)
    assert lead[0] == pytest.approx(opacity[0] * (0.9995 - mean_depth), rel=1e-5)


def test_splitting_pieces_changes_no_pixel():
    sigma, rgb, length, t, counts = random_samples()
    whole = composite(sigma, rgb, length, t, counts)
    halves = composite(
        np.repeat(sigma, 2), np.repeat(rgb, 2, axis=0), np.repeat(length / 2, 2),
        np.repeat(t, 2), 2 * counts,
    )  # fmt: skip
    np.testing.assert_allclose(halves[0], whole[0], atol=1e-12)
    np.testing.assert_allclose(halves[1], whole[1], atol=1e-12)


def test_one_opaque_piece_has_only_the_distortion_of_its_own_extent():
    _, opacity, _, distortion, lead = composite(
        np.array([1e6]), np.ones((1, 3)), np.array([0.3]), np.array([1.0]), np.array([1])
    )
    assert opacity[0] == 1.0
    assert distortion[0] == pytest.approx(0.1)
    assert lead[0] == 0.0


def on_device(samples, device):
    sigma, rgb, length, t, counts = samples
    torch_device = wp.device_to_torch(device)
    return (
        torch.tensor(sigma, dtype=torch.float32, device=torch_device, requires_grad=True),
        torch.tensor(rgb, dtype=torch.float32, device=torch_device, requires_grad=True),
        wp.array(length.astype(np.float32), dtype=float, device=device),
        wp.array(t.astype(np.float32), dtype=float, device=device),
        wp.array(counts.astype(np.int32), dtype=int, device=device),
        wp.array(np.cumsum(counts).astype(np.int32), dtype=int, device=device),
    )


@pytest.mark.parametrize("channels", [3, GEOMETRY_FEATURES])
def test_forward_kernel_matches_the_reference(device, channels):
    samples = random_samples(channels=channels)
    color, opacity, _, *others = composite(*samples)
    outputs = Composite.apply(*on_device(samples, device))
    for ours, expected in zip(outputs, (color, opacity, *others), strict=False):
        np.testing.assert_allclose(ours.detach().cpu(), expected, atol=2e-6, rtol=2e-6)


def test_samples_behind_something_opaque_are_not_visible(device):
    samples = random_samples()
    sigma, length, counts = samples[0], samples[2], samples[4]
    *_, visible = Composite.apply(*on_device(samples, device))
    ends = np.cumsum(counts)
    depths = np.cumsum(sigma * length) - sigma * length
    before = depths - np.repeat(depths[np.minimum(ends - counts, len(depths) - 1)], counts)
    is_visible = np.exp(-before) > float(LEAST_TRANSMITTANCE)
    expected = np.array([part.sum() for part in np.split(is_visible, ends[:-1])])
    found = visible.cpu().numpy()
    assert (found < counts).any() and (found == counts).any()
    assert np.abs(found - expected).max() <= 1  # where rounding decides
    assert (found != expected).mean() < 0.1


@pytest.mark.parametrize("channels", [3, GEOMETRY_FEATURES])
def test_gradients_match_finite_differences_of_the_reference(device, channels):
    shape = {"ray_count": 12, "longest": 45 if channels == 3 else 15}
    sigma, rgb, length, t, counts = samples = random_samples(**shape, channels=channels)
    rng = np.random.default_rng()
    weights = [rng.normal(size=s) for s in ((12, channels), 12, 12, 12)]

    def loss(sigma, rgb):
        color, opacity, _, *others = composite(sigma, rgb, length, t, counts)
        return sum((w * x).sum() for w, x in zip(weights, (color, opacity, *others), strict=True))

    arguments = on_device(samples, device)
    outputs = Composite.apply(*arguments)
    upstream = [torch.tensor(w, dtype=torch.float32, device=arguments[0].device) for w in weights]
    sum((w * x).sum() for w, x in zip(upstream, outputs, strict=False)).backward()
    h = 1e-6
    for values, grad in ((sigma, arguments[0].grad), (rgb, arguments[1].grad)):
        expected = np.zeros_like(values)
        for i in np.ndindex(values.shape):
            change = np.zeros_like(values)
            change[i] = h
            if values is sigma:
                expected[i] = (loss(sigma + change, rgb) - loss(sigma - change, rgb)) / (2 * h)
            else:
                expected[i] = (loss(sigma, rgb + change) - loss(sigma, rgb - change)) / (2 * h)
        np.testing.assert_allclose(grad.cpu(), expected, atol=2e-5)
