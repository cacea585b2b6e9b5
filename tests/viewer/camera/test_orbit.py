"""The orbit camera: what stays under the mouse, and what stays in the image."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking

ORBIT = orbits.Orbit(np.array([0.4, 0.5, 0.6]), 1.7, yaw=0.7, pitch=-0.4)
PARALLEL = replace(ORBIT, parallel=True)
each_kind = pytest.mark.parametrize("orbit", [ORBIT, PARALLEL], ids=["pinhole", "parallel"])
AXES = [tuple(float(x) for x in sign * np.eye(3)[i]) for i in range(3) for sign in (1, -1)]
SIZE = 320, 240


def pixel_of(orbit, point):
    pixels, _ = picking.project(orbits.camera_of(orbit, *SIZE), np.asarray(point)[None])
    return pixels[0]


def test_the_target_is_in_the_middle_at_its_distance():
    pixels, t = picking.project(orbits.camera_of(ORBIT, *SIZE), ORBIT.target[None])
    assert pixels[0] == pytest.approx([160, 120])
    assert t[0] == pytest.approx(1.7)


def test_yaw_zero_looks_along_y_and_up_is_up():
    pose = orbits.Orbit().pose
    assert -pose[:3, 2] == pytest.approx([0, 1, 0])
    assert pose[:3, 1] == pytest.approx([0, 0, 1])


def test_turning_keeps_the_target_and_the_distance():
    turned = orbits.turned(ORBIT, 31, -12, 240)
    assert pixel_of(turned, ORBIT.target) == pytest.approx([160, 120])
    eye = turned.pose[:3, 3]
    assert np.linalg.norm(eye - ORBIT.target) == pytest.approx(1.7)


def test_the_near_side_follows_the_mouse():
    front = ORBIT.target + 0.2 * ORBIT.pose[:3, 2]
    moved = pixel_of(orbits.turned(ORBIT, 20, 10, 240), front) - pixel_of(ORBIT, front)
    assert (moved > 0).all()


def test_the_camera_never_tips_over():
    for dy in (1e4, -1e4):
        turned = orbits.turned(ORBIT, 0, dy, 240)
        assert abs(turned.pitch) < np.pi / 2
        assert np.isfinite(turned.pose).all()


@each_kind
def test_panning_moves_what_is_at_the_targets_depth_with_the_mouse(orbit):
    panned = orbits.panned(orbit, 25, -14, 240)
    moved = pixel_of(panned, orbit.target) - pixel_of(orbit, orbit.target)
    assert moved == pytest.approx([25, -14])


@pytest.mark.parametrize("factor", [0.5, 0.88, 1.3])
def test_zooming_keeps_the_anchor_in_its_pixel(factor):
    anchor = ORBIT.target + np.array([0.1, -0.2, 0.15])
    zoomed = orbits.zoomed(ORBIT, factor, anchor)
    assert pixel_of(zoomed, anchor) == pytest.approx(pixel_of(ORBIT, anchor))
    before, after = (np.linalg.norm(o.pose[:3, 3] - anchor) for o in (ORBIT, zoomed))
    assert after == pytest.approx(factor * before)


def test_zooming_stops_before_the_target():
    orbit = ORBIT
    for _ in range(200):
        orbit = orbits.zoomed(orbit, 0.8)
    assert orbit.distance == pytest.approx(orbits.CLOSEST)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_framing_shows_the_whole_ball(aspect):
    framed = orbits.framed(ORBIT, [0, 0, 0], 0.7, aspect)
    width, height = int(200 * aspect), 200
    camera = orbits.camera_of(framed, width, height)
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3))
    points *= 0.7 / np.linalg.norm(points, axis=1, keepdims=True)
    pixels, _ = picking.project(camera, points)
    assert (pixels >= 0).all()
    assert (pixels <= [width, height]).all()
    assert np.ptp(pixels, axis=0).max() > 0.85 * min(width, height)


def test_parallel_rays_show_the_targets_plane_as_large_as_before():
    right, _, backward = ORBIT.pose[:3, :3].T
    at = pixel_of(ORBIT, ORBIT.target + 0.3 * right)
    for depth in (-0.5, 0.0, 0.5):  # and whatever is before or behind it
        point = ORBIT.target + 0.3 * right + depth * backward
        assert pixel_of(PARALLEL, point) == pytest.approx(at)


def test_parallel_rays_start_before_any_object_and_keep_an_anchor_in_zooms():
    close = orbits.zoomed(PARALLEL, 0.1, ORBIT.target + 0.1)
    near, far = orbits.clip_range(close)
    _, t = picking.project(
        orbits.camera_of(close, *SIZE), np.random.default_rng().uniform(size=(9, 3))
    )
    assert (near < t).all() and (t < far).all()
    before, after = (pixel_of(o, ORBIT.target + 0.1) for o in (PARALLEL, close))
    assert after == pytest.approx(before)


def test_another_field_of_view_keeps_the_targets_surroundings():
    right, up, _ = ORBIT.pose[:3, :3].T
    point = ORBIT.target + 0.2 * right + 0.1 * up
    wide = orbits.widened(ORBIT, np.radians(70.0))
    assert wide.field_of_view == np.radians(70.0) and wide.distance < ORBIT.distance
    assert pixel_of(wide, point) == pytest.approx(pixel_of(ORBIT, point))


@pytest.mark.parametrize("up", AXES)
def test_up_is_up_in_the_picture_and_yaw_turns_about_it(up):
    for yaw in (0.0, 2.0):
        axes = orbits.Orbit(yaw=yaw, pitch=0.3, up=up).pose[:3, :3]
        assert axes.T @ axes == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert axes[:, 0] @ up == pytest.approx(0.0, abs=1e-12)  # level
        assert axes[:, 2] @ up == pytest.approx(np.sin(0.3))  # from above


@pytest.mark.parametrize("up", AXES)
def test_another_up_keeps_the_eye_and_levels_the_view(up):
    turned = orbits.with_up(ORBIT, up)
    axes, before = turned.pose[:3, :3], ORBIT.pose[:3, :3]
    assert axes[:, 2] == pytest.approx(before[:, 2])
    assert axes[:, 0] @ up == pytest.approx(0.0, abs=1e-9)
    assert axes[:, 1] @ up > 0.0


def test_any_rotation_is_a_view():
    """Also straight up and down, where yaw and roll turn about one axis."""
    rng = np.random.default_rng()
    random = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(20)]
    random = [q * np.sign(np.linalg.det(q)) for q in random]
    down = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    for axes in (*random, down, down @ np.diag([1.0, -1.0, -1.0])):
        for up in AXES:
            faced = orbits.facing(replace(ORBIT, up=up), axes)
            assert faced.pose[:3, :3] == pytest.approx(axes, abs=1e-7)
            assert (faced.target == ORBIT.target).all()


def test_a_drag_levels_a_rolled_view():
    rolled = replace(ORBIT, roll=0.4)
    assert rolled.pose[:3, 2] == pytest.approx(ORBIT.pose[:3, 2])
    assert abs(rolled.pose[2, 0]) > 0.1
    assert orbits.turned(rolled, 3, 0, 240).pose[2, 0] == pytest.approx(0.0)
