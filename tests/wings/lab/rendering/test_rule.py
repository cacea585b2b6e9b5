"""The rule takes the cheapest setting that is good enough."""

import numpy as np

from deformrf.wings.lab.rendering.section import cheapest, shares


def turns(*medians):
    """Ten turns that all take the same time.  [S, 10]"""
    return np.repeat(np.array(medians, float)[:, None], 10, axis=1)


def test_the_cheapest_within_the_bound_is_taken():
    times, errors = turns(4.0, 3.0, 2.0, 1.0), [0.1, 0.9, 1.0, 1.1]
    assert cheapest(times, errors, 1.0) == 2
    assert cheapest(times, errors, 0.99) == 1
    assert cheapest(times, errors, 0.5) == 0


def test_without_one_within_the_bound_there_is_none():
    assert cheapest(turns(2.0, 1.0), [0.2, np.inf], 0.1) is None


def test_of_equally_cheap_ones_the_most_exact_is_taken():
    errors = np.random.default_rng().uniform(size=7)
    assert cheapest(turns(*[3.0] * 7), errors, 1.0) == errors.argmin()


def test_it_is_turns_that_are_compared():
    """A machine that slows down and up again spreads both settings; one is always slower."""
    pace = np.random.default_rng().uniform(1.0, 10.0, 40)
    times = np.stack([pace, 1.01 * pace])
    assert cheapest(times, [0.3, 0.2], 1.0) == 0


def test_what_is_slow_and_noisy_beside_them_does_not_matter():
    """As float32 on CUDA, which takes seven times as long as any other, give or take."""
    rng = np.random.default_rng()
    times = np.stack([np.ones(24), np.full(24, 0.99), rng.uniform(3.0, 30.0, 24)])
    assert cheapest(times, [0.1, 0.2, 9.0], 1.0) == 1
    assert cheapest(times, [0.1, 0.2, 0.0], 1.0, base=2) == 1


def test_shares_are_of_the_same_turn():
    times = np.random.default_rng().uniform(1.0, 9.0, (4, 10))
    for base in range(4):
        found = shares(times, base)
        np.testing.assert_array_equal(found[base], 1.0)
        np.testing.assert_allclose(found * times[base], times)


def test_what_is_outside_the_bound_is_no_measure_of_cheap():
    times = turns(1.0, 5.0, 5.0)
    assert cheapest(times, [9.0, 0.2, 0.1], 1.0) == 2


def test_one_setting_is_its_own_choice():
    assert cheapest([[2.0]], [0.5], 1.0) == 0
