"""The weights as native code reads them: numbers rounded to bfloat16, in pairs."""

import numpy as np
import torch

from deformrf.core.field.networks import layers


def test_bfloat16_is_the_nearest():
    rng = np.random.default_rng()
    x = (rng.normal(size=5000) * np.exp(rng.normal(size=5000, scale=9))).astype(np.float32)
    found = layers.bfloat16(x)
    assert not (found.view(np.uint32) & 0xFFFF).any()
    np.testing.assert_array_equal(found, torch.from_numpy(x).bfloat16().float().numpy())
    pairs = layers.row_pairs(x[:15].reshape(5, 3))
    assert pairs.shape == (3, 3) and pairs.dtype == np.int32
    halves = pairs.view(np.uint16).reshape(3, 3, 2).swapaxes(1, 2).reshape(6, 3)
    np.testing.assert_array_equal(
        (halves[:5].astype(np.uint32) << 16).view(np.float32), found[:15].reshape(5, 3)
    )
    assert not halves[5].any()
