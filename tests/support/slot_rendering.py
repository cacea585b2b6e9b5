"""The wavefront on a CPU, and what its images are compared with."""

import numpy as np
from both_networks import evaluate

from deformrf.core.definition.networks import mlp, sigma_from, sigmoid


def in_slots(renderer):
    """Let a renderer on the CPU use the wavefront, too, with NumPy's networks."""
    if renderer.device.is_cuda:
        return renderer
    renderer.shading.in_place = NumpyNetworks(renderer.field)
    return renderer


class NumpyNetworks:
    """What TensorCoreNetworks does, on a CPU."""

    def __init__(self, field):
        self._layers = field.density_layers, field.color_layers

    def evaluate(self, features, basis, total, sigma, rgb, _slots=None):
        x, y = _rows(features, len(sigma), total), _rows(basis, len(sigma), total)
        if len(x):
            sigma.numpy()[: len(x)], rgb.numpy()[: len(x)] = evaluate(x, y, *self._layers)

    def geometry(self, features, total, sigma, h, _slots=None):
        x = _rows(features, len(sigma), total)
        if len(x):
            found = mlp(x, self._layers[0])
            h.numpy().reshape(len(sigma), -1)[: len(x)] = found
            sigma.numpy()[: len(x)] = sigma_from(found)

    def colors(self, x, count, rgb):
        rows = _rows(x, len(rgb), count)
        if len(rows):
            rgb.numpy()[: len(rows)] = sigmoid(mlp(rows, self._layers[1]))


def _rows(array, count, total):
    return array.numpy().reshape(count, -1)[: int(total.numpy()[0])].astype(float)


def assert_alike(image, expected):
    """One of them has half precision: a few levels of 255 at most, almost none on average."""
    difference = np.abs(image.color_array().astype(int) - expected.color_array())
    assert difference.mean() < 0.3
    assert (difference.max(axis=-1) > 6).mean() < 5e-3
    seen = np.isfinite(expected.depth_array()) & np.isfinite(image.depth_array())
    depths = image.depth_array()[seen], expected.depth_array()[seen]
    assert np.isclose(*depths, atol=3e-3).mean() > 0.99
    assert (np.isfinite(image.depth_array()) == np.isfinite(expected.depth_array())).mean() > 0.99
