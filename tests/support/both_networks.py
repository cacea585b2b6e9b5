"""The definition's two networks one after the other, for tests that have features and Y."""

import numpy as np

from deformrf.core.definition.networks import mlp, sigma_from, sigmoid


def evaluate(features, basis, density_layers, color_layers):
    """σ [N] and color [N, 3], from features [N, L F] and Y(d) [N, 16]."""
    h = mlp(features, density_layers)
    return sigma_from(h), sigmoid(mlp(np.concatenate([h, basis], axis=1), color_layers))
