"""The orbit camera: what stays under the mouse, and what stays in the image."""

import numpy as np
import pytest

from deformrf.viewer import orbit as orbits
from deformrf.viewer import picking

ORBIT = orbits.Orbit(np.array([0.4, 0.5, 0.6]), 1.7, yaw=0.7, pitch=-0.4)
SIZE = 320, 240


def pixel_of(orbit, point):
    pixels, _ = picking.project(orbits.camera(orbit, *SIZE), np.asarray(point)[None])
    return pixels[0]


def test_the_target_is_in_the_middle_at_its_distance():
    pixels, t = picking.project(orbits.camera(ORBIT, *SIZE), ORBIT.target[None])
    assert pixels[0] == pytest.approx([160, 120])
    assert t[0] == pytest.approx(1.7)


def test_yaw_zero_looks_along_y_and_up_is_up():
    pose = orbits.pose(orbits.Orbit())
    assert -pose[:3, 2] == pytest.approx([0, 1, 0])
    assert pose[:3, 1] == pytest.approx([0, 0, 1])


def test_turning_keeps_the_target_and_the_distance():
    turned = orbits.turned(ORBIT, 31, -12, 240)
    assert pixel_of(turned, ORBIT.target) == pytest.approx([160, 120])
    eye = orbits.pose(turned)[:3, 3]
    assert np.linalg.norm(eye - ORBIT.target) == pytest.approx(1.7)


def test_the_near_side_follows_the_mouse():
    front = ORBIT.target + 0.2 * orbits.pose(ORBIT)[:3, 2]
    moved = pixel_of(orbits.turned(ORBIT, 20, 10, 240), front) - pixel_of(ORBIT, front)
    assert (moved > 0).all()


def test_the_camera_never_tips_over():
    for dy in (1e4, -1e4):
        turned = orbits.turned(ORBIT, 0, dy, 240)
        assert abs(turned.pitch) < np.pi / 2
        assert np.isfinite(orbits.pose(turned)).all()


def test_panning_moves_what_is_at_the_targets_depth_with_the_mouse():
    panned = orbits.panned(ORBIT, 25, -14, 240)
    assert pixel_of(panned, ORBIT.target) - pixel_of(ORBIT, ORBIT.target) == pytest.approx(
        [25, -14]
    )


@pytest.mark.parametrize("factor", [0.5, 0.88, 1.3])
def test_zooming_keeps_the_anchor_in_its_pixel(factor):
    anchor = ORBIT.target + np.array([0.1, -0.2, 0.15])
    zoomed = orbits.zoomed(ORBIT, factor, anchor)
    assert pixel_of(zoomed, anchor) == pytest.approx(pixel_of(ORBIT, anchor))
    before, after = (np.linalg.norm(orbits.pose(o)[:3, 3] - anchor) for o in (ORBIT, zoomed))
    assert after == pytest.approx(factor * before)


def test_zooming_stops_before_the_target():
    orbit = ORBIT
    for _ in range(200):
        orbit = orbits.zoomed(orbit, 0.8)
    assert orbit.distance == pytest.approx(orbits.CLOSEST)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_framing_shows_the_whole_ball(aspect):
    framed = orbits.framing(ORBIT, [0, 0, 0], 0.7, aspect)
    width, height = int(200 * aspect), 200
    camera = orbits.camera(framed, width, height)
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3))
    points *= 0.7 / np.linalg.norm(points, axis=1, keepdims=True)
    pixels, _ = picking.project(camera, points)
    assert (pixels >= 0).all()
    assert (pixels <= [width, height]).all()
    assert np.ptp(pixels, axis=0).max() > 0.85 * min(width, height)
