import numpy as np
import pytest
import warp as wp

from deformrf.core.base.feed import Feed


@pytest.mark.parametrize("dtype, shape", [(wp.vec3, (5, 3)), (wp.mat44, (5, 4, 4)), (float, (5,))])
def test_an_array_has_what_was_put_last(device, dtype, shape):
    array = wp.zeros(5, dtype=dtype, device=device)
    feed, rng = Feed(array), np.random.default_rng()
    for _ in range(3):
        values = rng.normal(size=shape)
        feed.put(values)
        wanted = values.astype(np.float32)
        values[:] = np.nan  # the caller's array is free again
        np.testing.assert_array_equal(array.numpy(), wanted)
    with pytest.raises(ValueError):
        feed.put(np.zeros((4, *shape[1:])))
