"""Inertia and handles: closed forms of one substep, and kernels that agree with NumPy."""

import numpy as np
import warp as wp

from deformrf.core.deform import integration

COUNT = 500


def state(device):
    """Random vertices, deltas, velocities, targets and inverse masses, a third of them 0."""
    random = np.random.default_rng()
    vectors = random.normal(size=(4, COUNT, 3)).astype(np.float32)
    w = (random.uniform(size=COUNT) * (random.uniform(size=COUNT) > 1 / 3)).astype(np.float32)
    arrays = [wp.array(v, dtype=wp.vec3, device=device) for v in vectors]
    return vectors.astype(np.float64), w, arrays, wp.array(w, device=device)


def test_predict_kernel_matches_numpy(device):
    (x, d, v, target), w, arrays, w_array = state(device)
    h, decay, limit, gravity, fraction = 0.01, 0.9, 1.5, np.array([0.0, 1.0, -10.0]), 0.3
    speeds = decay * v + h * gravity
    norm = np.linalg.norm(speeds, axis=1, keepdims=True)
    assert (norm > limit).any() and (norm < limit).any()
    free = d + h * speeds * np.minimum(1.0, limit / norm)
    expected = np.where((w > 0)[:, None], free, fraction * (target - x))

    previous = wp.zeros_like(arrays[1])
    timing = wp.array([h, decay, limit, *gravity], dtype=float, device=device)
    inputs = [*arrays[:3], w_array, arrays[3], timing, fraction, previous]
    wp.launch(integration.predict_kernel, COUNT, inputs, device=device)
    np.testing.assert_allclose(arrays[1].numpy(), expected, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(previous.numpy(), d)


def test_velocities_are_the_way_gone_by_the_time(device):
    (_, now, before, _), _, arrays, _ = state(device)
    timing = wp.array([0.25, 1.0, 1.0], dtype=float, device=device)
    velocities = wp.zeros_like(arrays[0])
    inputs = [arrays[1], arrays[2], timing, velocities]
    wp.launch(integration.update_velocities_kernel, COUNT, inputs, device=device)
    np.testing.assert_allclose(velocities.numpy(), (now - before) / 0.25, rtol=1e-6, atol=1e-6)


def test_at_the_frames_end_nothing_is_rounded_away(device):
    (x, d, _, target), w, arrays, w_array = state(device)
    motion = wp.zeros(1, dtype=float, device=device)
    anchors = wp.zeros_like(arrays[3])
    inputs = [arrays[0], arrays[1], w_array, arrays[3], anchors, motion]
    wp.launch(integration.end_frame_kernel, COUNT, inputs, device=device)
    moved, rest = arrays[0].numpy(), arrays[1].numpy()
    free = w > 0
    # Exact unless the delta is larger than the position, where some bits are beyond both.
    np.testing.assert_allclose((moved.astype(np.float64) + rest)[free], (x + d)[free], atol=5e-7)
    small = free & (np.abs(d) <= np.abs(x)).all(axis=1)
    np.testing.assert_array_equal((moved.astype(np.float64) + rest)[small], (x + d)[small])
    np.testing.assert_array_equal(moved[~free], target[~free])
    assert (rest[~free] == 0).all()
    np.testing.assert_array_equal(anchors.numpy(), target)
    np.testing.assert_allclose(motion.numpy()[0], np.linalg.norm(d, axis=1).max(), rtol=1e-6)


def test_holding_and_moving_set_targets(device):
    (x, _, _, target), _, arrays, _ = state(device)
    held = np.zeros(COUNT, bool)
    held[::3] = True
    flags = wp.array(held, dtype=bool, device=device)
    anchors = wp.zeros_like(arrays[3])
    inputs = [arrays[0], flags, anchors, arrays[3]]
    wp.launch(integration.hold_kernel, COUNT, inputs, device=device)
    np.testing.assert_array_equal(anchors.numpy(), np.where(held[:, None], x, 0.0))
    expected = np.where(held[:, None], x, target)
    np.testing.assert_array_equal(arrays[3].numpy(), expected)

    ids = np.array([5, 0, 9], np.int32)
    inputs = [wp.array(ids, device=device), arrays[2], arrays[3]]
    wp.launch(integration.move_kernel, 3, inputs, device=device)
    expected[ids] = arrays[2].numpy()[:3]
    np.testing.assert_array_equal(arrays[3].numpy(), expected)
