import numpy as np
import pytest

from deformrf.core.training.metrics import C1, C2, WINDOW_SIGMA, psnr, ssim


def images(seed, shape=(17, 20, 3), noise=0.1):
    rng = np.random.default_rng(seed)
    a = rng.random(shape)
    return a, np.clip(a + noise * rng.standard_normal(shape), 0, 1)


def ssim_reference(a, b):
    """Every window of every channel by itself, straight from the definition."""
    y, x = np.mgrid[-5:6, -5:6]
    weights = np.exp(-(x**2 + y**2) / (2 * WINDOW_SIGMA**2))
    weights /= weights.sum()
    values = []
    for row in range(a.shape[0] - 10):
        for column in range(a.shape[1] - 10):
            for channel in range(a.shape[2]):
                p = a[row : row + 11, column : column + 11, channel]
                q = b[row : row + 11, column : column + 11, channel]
                mp, mq = (weights * p).sum(), (weights * q).sum()
                vp, vq = (weights * (p - mp) ** 2).sum(), (weights * (q - mq) ** 2).sum()
                cov = (weights * (p - mp) * (q - mq)).sum()
                top = (2 * mp * mq + C1) * (2 * cov + C2)
                values.append(top / ((mp**2 + mq**2 + C1) * (vp + vq + C2)))
    return np.mean(values)


@pytest.mark.parametrize("error, decibel", [(1.0, 0.0), (0.1, 20.0), (0.01, 40.0)])
def test_psnr_of_a_constant_error_is_minus_20_log10(error, decibel):
    a = np.zeros((4, 5, 3))
    assert psnr(a, a + error) == pytest.approx(decibel, abs=1e-9)


def test_equal_images_are_as_close_as_can_be():
    a, _ = images(0)
    assert psnr(a, a) == float("inf")
    assert ssim(a, a) == pytest.approx(1.0, abs=1e-12)


def test_ssim_matches_the_definition_window_by_window():
    for seed in range(3):
        a, b = images(seed)
        assert ssim(a, b) == pytest.approx(ssim_reference(a, b), abs=1e-12)


def test_ssim_of_flat_images_is_the_luminance_term():
    """No variance, no covariance: only (2 p q + C1) / (p² + q² + C1) remains."""
    p, q = 0.3, 0.7
    expected = (2 * p * q + C1) / (p * p + q * q + C1)
    assert ssim(np.full((12, 15, 3), p), np.full((12, 15, 3), q)) == pytest.approx(expected)


def test_ssim_is_symmetric_and_falls_with_noise():
    a, b = images(4, noise=0.05)
    _, c = images(4, noise=0.2)
    assert ssim(a, b) == pytest.approx(ssim(b, a), abs=1e-12)
    assert 1.0 > ssim(a, b) > ssim(a, c)


def test_grayscale_images_have_no_channel_axis():
    a, b = images(5)
    assert ssim(a[..., 0], b[..., 0]) == pytest.approx(ssim(a[..., :1], b[..., :1]), abs=1e-12)


def test_wrong_input_is_named():
    a, _ = images(6)
    with pytest.raises(ValueError, match=r"\(17, 20, 3\) and \(17, 19, 3\)"):
        psnr(a, a[:, 1:])
    with pytest.raises(ValueError, match="11x11 pixels, these have 20x9"):
        ssim(a[:9], a[:9])
    with pytest.raises(ValueError, match="not uint8"):
        psnr(np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.uint8))
