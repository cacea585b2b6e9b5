"""The encoding's entries."""

import numpy as np
import pytest

from deformrf.core.definition import encoding


@pytest.mark.parametrize("level", [0, 1, 2])
def test_dense_entries_are_the_programs(make_ball_field, level):
    field = make_ball_field(1, table_size=2**15).definition.encoding
    assert len(field.dense_entries) > level
    found = encoding.dense_entries(field.corner_addresses, level)
    np.testing.assert_array_equal(found, field.dense_entries[level])


def test_the_hash_is_that_of_exact_integers():
    for address in np.random.default_rng().integers(0, 2**20, (50, 3)).tolist():
        x, y, z = (a * prime % 2**32 for a, prime in zip(address, encoding.PRIMES, strict=True))
        assert encoding.hash_address(np.array(address), 2**18) == (x ^ y ^ z) % 2**18
