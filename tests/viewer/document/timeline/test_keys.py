"""What lies between the keys of a timeline: easings, and the camera's way."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.document.timeline import keys as k


@pytest.mark.parametrize("share", np.linspace(0.0, 1.0, 11))
def test_easings_have_their_closed_forms(share):
    first, last = k.CameraKey(0, None, "linear"), k.CameraKey(60, None)
    expected = {"linear": share, "smooth": 3 * share**2 - 2 * share**3, "hold": float(share == 1.0)}
    for easing, wanted in expected.items():
        assert k.EASINGS[easing](share) == pytest.approx(wanted)
        found = k.around((replace(first, easing=easing), last), 60 * share)
        assert found[2] == pytest.approx(wanted if share < 1.0 else 0.0)  # the last key: arrived


def orbit_keys(yaws, times, easing="linear", **values):
    def orbit(yaw, index):
        others = {name: given[index] for name, given in values.items()}
        return orbits.Orbit(yaw=yaw, **others)

    return tuple(
        k.CameraKey(tick, orbit(yaw, n), easing)
        for n, (yaw, tick) in enumerate(zip(yaws, times, strict=True))
    )


@pytest.mark.parametrize("easing", k.EASINGS)
def test_the_camera_is_exactly_at_each_key(easing):
    keys = orbit_keys([0.1, 2.0, -1.0, 0.3], [0, 7, 60, 61], easing)
    for key in keys:
        assert k.orbit_at(keys, key.tick) is key.orbit
    assert k.orbit_at(keys, -5) is keys[0].orbit and k.orbit_at(keys, 99) is keys[-1].orbit


def test_the_camera_goes_straight_through_keys_on_a_line():
    keys = orbit_keys([0.0, 0.2, 1.0], [0, 10, 50], distance=[1.0, 1.2, 2.0])
    for tick in range(51):
        assert k.orbit_at(keys, tick).yaw == pytest.approx(tick / 50)
        assert k.orbit_at(keys, tick).distance == pytest.approx(1.0 + tick / 50)


def test_the_camera_passes_keys_without_a_jerk_and_stops_where_it_is_eased():
    keys = orbit_keys([0.0, 0.5, 0.2], [0, 20, 50], target=np.eye(3))

    def speed(keys, tick, step=1e-3):
        before, after = (k.orbit_at(keys, t) for t in (tick, tick + step))
        return (after.yaw - before.yaw) / step, (after.target - before.target) / step

    (yaw, target), (yaw_after, target_after) = speed(keys, 19.999), speed(keys, 20.0)
    assert yaw == pytest.approx(yaw_after, abs=1e-5)
    np.testing.assert_allclose(target, target_after, atol=1e-5)
    assert abs(target).max() > 1e-3
    eased = tuple(replace(key, easing="smooth") for key in keys)
    assert speed(eased, 20.0)[0] == pytest.approx(0.0, abs=1e-4)


def test_the_camera_turns_the_shorter_way_and_keeps_its_limits():
    keys = orbit_keys([3.0, -3.0], [0, 10])
    assert np.cos(k.orbit_at(keys, 5).yaw) == pytest.approx(-1.0)
    near = orbit_keys([0.0] * 4, [0, 10, 20, 30], distance=[5.0, 0.02, 0.02, 5.0])
    steep = orbit_keys([0.0] * 4, [0, 10, 20, 30], pitch=[0.0, 1.55, 1.55, 0.0])
    for tick in np.linspace(0, 30, 100):
        assert k.orbit_at(near, tick).distance >= orbits.CLOSEST
        assert k.orbit_at(steep, tick).pitch <= k.STEEPEST
