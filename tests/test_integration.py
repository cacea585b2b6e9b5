"""Springs' coefficients, and handles that are held and moved.  Frames: test_reference.py."""

import numpy as np
import warp as wp

from deformrf.core.deform import integration

COUNT = 500


def test_holding_and_moving_set_targets(device):
    vectors = np.random.default_rng().normal(size=(3, COUNT, 3)).astype(np.float32)
    x, places, target = vectors
    arrays = [wp.array(v, dtype=wp.vec3, device=device) for v in vectors]
    held = np.zeros(COUNT, bool)
    held[::3] = True
    flags = wp.array(held, dtype=bool, device=device)
    anchors = wp.zeros_like(arrays[2])
    inputs = [arrays[0], flags, anchors, arrays[2]]
    wp.launch(integration.hold_kernel, COUNT, inputs, device=device)
    np.testing.assert_array_equal(anchors.numpy(), np.where(held[:, None], x, 0.0))
    expected = np.where(held[:, None], x, target)
    np.testing.assert_array_equal(arrays[2].numpy(), expected)

    ids = np.array([5, 0, 9], np.int32)
    inputs = [wp.array(ids, device=device), arrays[1], arrays[2]]
    wp.launch(integration.move_kernel, 3, inputs, device=device)
    expected[ids] = places[:3]
    np.testing.assert_array_equal(arrays[2].numpy(), expected)
