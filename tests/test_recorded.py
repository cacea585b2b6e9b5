"""Recorded launches do the same as others, each time."""

import numpy as np
import warp as wp

from deformrf.core.recorded import Recorded


@wp.kernel
def double_kernel(values: wp.array(dtype=float)):
    values[wp.tid()] *= 2.0


def test_each_call_launches_with_what_the_arrays_hold_then(device):
    values = wp.array(np.arange(5.0, dtype=np.float32), device=device)
    calls = []

    def launch():
        calls.append(None)
        wp.launch(double_kernel, len(values), [values], device=device)
        wp.launch(double_kernel, len(values), [values], device=device)

    double_twice = Recorded(launch, device)
    for _ in range(4):
        double_twice()
    np.testing.assert_array_equal(values.numpy(), 256.0 * np.arange(5))
    values.assign(np.ones(5, np.float32))
    double_twice()
    np.testing.assert_array_equal(values.numpy(), np.full(5, 4.0))
    assert len(calls) == (2 if wp.get_device(device).is_cuda else 5)
