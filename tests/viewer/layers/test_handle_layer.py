"""Spheres where the vertices are, hidden where the object is in front."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.render import Renderer
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.document import ControlPoints, Scene
from deformrf.viewer.layers import Canvas, HandleLayer, RadianceLayer
from deformrf.viewer.layers.handle_layer import PIN_SCALE, YELLOW, sphere_instances
from deformrf.viewer.times import FrameTimes

SIZE = 400, 300


@pytest.fixture
def scene(ball):
    made = Scene(ball, "ball", "cpu")
    made.settings.background = (0.0, 0.0, 0.0)
    return made


def is_red(image):
    r, g, b = np.moveaxis(image.astype(int), -1, 0)
    return (r > 80) & (g < 0.45 * r) & (b < 0.45 * r)


def draw(scene, context, objects=True):
    """The picture with or without the field behind the spheres; and the depth image."""
    camera = orbits.camera_of(scene.orbit, *SIZE)
    clip_range = orbits.clip_range(scene.orbit)
    layer = RadianceLayer(context, scene, Renderer(scene.field), "copy", FrameTimes())
    layer.update(camera, whole=True)
    canvas = Canvas(context)
    canvas.use(SIZE)
    context.clear(0, 0, 0, 1, depth=1.0)
    if objects:
        layer.draw(camera, clip_range)
    HandleLayer(context, scene).draw(camera, clip_range)
    return canvas.read(), layer.depth_image(), camera


@pytest.mark.gl
@pytest.mark.parametrize("parallel", [False, True])
def test_a_sphere_is_where_picking_says_and_as_large(scene, window, parallel):
    scene.orbit = replace(scene.orbit, parallel=parallel)
    image, _, camera = draw(scene, window[1], objects=False)
    pixels, t = picking.project(camera, scene.handles.at(scene.handles.control_ids))
    for (x, y), distance in zip(pixels, t, strict=True):
        assert is_red(image)[int(y), int(x)] or image[int(y), int(x)].max() > 80
        assert distance > 0
    lone = pixels[:, 0].argmin()  # the leftmost one has nothing to its left
    x, y = pixels[lone]
    row = is_red(image)[int(y), : int(x) + 1]
    radius = scene.handle_radius * picking.pixels_per_unit(camera, t[lone])
    assert row.sum() == pytest.approx(radius, abs=1.5)


@pytest.mark.gl
@pytest.mark.parametrize("parallel", [False, True])
def test_a_sphere_shows_exactly_where_it_can_be_picked(scene, window, parallel):
    scene.orbit = replace(scene.orbit, parallel=parallel)
    image, depth, camera = draw(scene, window[1])
    points = scene.handles.at(scene.handles.control_ids)
    shown = picking.visible(camera, points, depth, scene.handle_bias)
    pixels, _ = picking.project(camera, points)
    red = is_red(image)
    at_center = np.array([red[int(y), int(x)] for x, y in pixels])
    assert 5 < shown.sum() < len(shown) - 5
    # A sphere's front is a radius nearer than its centre, so that a few show more than picked.
    assert (at_center[shown]).mean() > 0.95
    assert (at_center[~shown]).mean() < 0.35


@pytest.mark.gl
def test_a_held_sphere_inside_the_object_is_a_ghost(scene, window):
    """A vertex at the back, and one in the middle: hidden, but a hand that holds it sees it."""
    away = np.linalg.norm(scene.positions - scene.center, axis=1)
    vertex = int(away.argmin())
    scene.handles.points = scene.handles.points.joined(
        ControlPoints(np.full((1, 4), vertex), np.array([[1.0, 0.0, 0.0, 0.0]]))
    )
    before, _, camera = draw(scene, window[1])
    scene.handles.grab(vertex)
    image, _, _ = draw(scene, window[1])
    (pixel,), _ = picking.project(camera, scene.handles.at([vertex]))
    x, y = pixel.astype(int)
    change = image[y, x].astype(int) - before[y, x]
    assert change[0] > 15 and change[0] > change[2]  # a tint of yellow, not a sphere
    assert abs(image[y, x].astype(int) - np.multiply(255, YELLOW)).max() > 60
    scene.handles.release()
    after, _, _ = draw(scene, window[1])
    np.testing.assert_array_equal(after, before)


def instances(scene):
    return sphere_instances(scene, scene.orbit.pose[:3, 3])


def test_hovered_is_larger_and_grabbed_has_another_color(scene):
    vertex = int(scene.handles.control_ids[0])
    at = scene.handles.at([vertex])[0]

    def instance():
        return next(row for row in instances(scene) if np.allclose(row[:3], at, atol=1e-6))

    plain = instance()
    scene.handles.hover = vertex
    hovered = instance()
    scene.handles.grab(vertex)
    grabbed = instance()
    assert hovered[3] > plain[3]
    colors = {tuple(row[4:]) for row in (plain, hovered, grabbed)}
    assert len(colors) == 3


def test_pins_are_smaller_and_not_red(scene):
    rows = instances(scene)
    pins = rows[rows[:, 3] < scene.handle_radius * 0.99]
    assert len(pins) == scene.pins.sum()
    assert pins[:, 3] == pytest.approx(PIN_SCALE * scene.handle_radius)
    assert (pins[:, 6] > pins[:, 4]).all()
    scene.hold(False)
    assert len(instances(scene)) == len(scene.handles.control_ids)
