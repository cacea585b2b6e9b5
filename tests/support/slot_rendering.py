"""The wavefront on a CPU, and what its images are compared with."""

import numpy as np

from deformrf.core.field.networks import evaluate as evaluate_reference


def in_slots(renderer):
    """Let a renderer on the CPU use the wavefront, too, with NumPy's networks."""
    if renderer.device.is_cuda:
        return renderer
    field = renderer.field

    def evaluate(features, basis, total, sigma, rgb):
        count = int(total.numpy()[0])
        rows = (a.numpy().reshape(len(sigma), -1)[:count].astype(float) for a in (features, basis))
        if count:
            values = evaluate_reference(*rows, field.density_layers, field.color_layers)
            sigma.numpy()[:count], rgb.numpy()[:count] = values

    renderer.shading.evaluate_slots = evaluate
    return renderer


def assert_alike(image, expected):
    """One of them has half precision: a few levels of 255 at most, almost none on average."""
    difference = np.abs(image.color_array().astype(int) - expected.color_array())
    assert difference.mean() < 0.3
    assert (difference.max(axis=-1) > 6).mean() < 5e-3
    seen = np.isfinite(expected.depth_array()) & np.isfinite(image.depth_array())
    depths = image.depth_array()[seen], expected.depth_array()[seen]
    assert np.isclose(*depths, atol=3e-3).mean() > 0.99
    assert (np.isfinite(image.depth_array()) == np.isfinite(expected.depth_array())).mean() > 0.99
