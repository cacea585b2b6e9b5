"""The ground that is seen: where its lines and the object's shadow are, what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest

from deformrf.core.render import Renderer
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.document import Scene
from deformrf.viewer.layers import Canvas, RadianceLayer, line_spacing
from deformrf.viewer.layers.ground_plane import CELLS, MOST_POINTS, occupied_middles, shadow
from deformrf.viewer.times import FrameTimes

SIZE = 400, 300


def cube(low, side=0.2):
    axis = np.linspace(0.0, side, 12)
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    return points + np.array([0.3, 0.4, low])


def test_a_shadow_is_below_the_object_and_fades_with_its_height():
    darkness = []
    for low in (0.0, 0.05, 0.2, 0.6, 5.0):
        made = shadow(cube(low), 0.0, 1.0)
        assert made.center == pytest.approx((0.4, 0.5))
        assert made.side == pytest.approx(0.2 + 0.7)
        assert (made.shade >= 0.0).all() and (made.shade <= 1.0).all()
        middle = CELLS // 2
        darkness.append(made.shade[middle, middle])
        assert made.shade.max() == pytest.approx(darkness[-1], rel=0.1)  # it is darkest there
        assert abs(made.shade - made.shade.T).max() < 0.02 + 0.1 * darkness[-1]
        assert made.shade[0].max() < 0.01  # it ends before its picture does
    assert darkness == sorted(darkness, reverse=True)
    assert darkness[0] > 0.6 and darkness[2] > 0.1 and darkness[-1] < 1e-3


def test_without_points_or_with_lost_ones_there_is_no_shadow():
    assert not shadow(np.empty((0, 3)), 0.0, 1.0).shade.any()
    assert not shadow(np.full((5, 3), np.nan), 0.0, 1.0).shade.any()


def test_points_of_the_object_go_where_it_goes(ball):
    middles = occupied_middles(ball)
    assert 1000 < len(middles.corners) <= MOST_POINTS
    rest = ball.mesh.rest_vertices
    matrix = np.array([[1.0, 0.3, 0.0], [0.0, 0.8, 0.1], [0.0, 0.0, 1.2]])
    moved = middles.points(rest @ matrix.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(moved, middles.points(rest) @ matrix.T + [1.0, 2.0, 3.0], atol=1e-6)


@pytest.mark.parametrize("meters, spacing", [(0.7, 0.1), (1.0, 0.2), (2.6, 0.5), (0.02, 0.002)])
def test_lines_are_round_lengths_apart(ball, meters, spacing):
    scene = Scene(ball, "ball", "cpu", meters=meters)
    assert line_spacing(scene.body.meters) == pytest.approx(spacing)


class Stage:
    """A scene with a ground; `picture` draws it, `plain` without the ground."""

    def __init__(self, field, context):
        self.scene = Scene(field, "ball", "cpu")
        self.scene.set_ground(True)
        self.layer = RadianceLayer(context, self.scene, Renderer(field), "copy", FrameTimes())
        self.canvas = Canvas(context)

    @property
    def camera(self):
        return orbits.camera_of(self.scene.orbit, *SIZE)

    def picture(self, channels=3):
        self.layer.update(self.camera, whole=True)
        self.canvas.use(SIZE)
        self.layer.draw(self.camera, orbits.clip_range(self.scene.orbit))
        return self.canvas.read(channels).astype(float)

    def plain(self):
        self.scene.settings.show_ground = False
        image = self.picture()
        self.scene.settings.show_ground = True
        return image


@pytest.fixture
def stage(ball, window):
    return Stage(ball, window[1])


def on_ground(stage, cells):
    """Pixels of points of the ground that are so many spacings from the origin [N, 2].  [N, 2]"""
    scene = stage.scene
    spacing = line_spacing(scene.body.meters) / scene.body.meters_per_unit
    height = np.full((len(cells), 1), scene.solver.options.ground)
    pixels, _ = picking.project(stage.camera, np.hstack([np.array(cells) * spacing, height]))
    seen = picking.depth_at(stage.layer.depth_image(), stage.camera, pixels)
    return pixels[np.isinf(seen) & picking._inside(stage.camera, pixels)]


@pytest.mark.gl
@pytest.mark.parametrize("parallel", [False, True])
def test_lines_are_where_the_ground_is(stage, parallel):
    stage.scene.orbit = replace(stage.scene.orbit, parallel=parallel, pitch=np.radians(40.0))
    image = stage.picture().mean(axis=-1)
    grid = np.stack(np.meshgrid(np.arange(-2, 9), np.arange(-2, 9)), axis=-1).reshape(-1, 2)
    on_lines, between = (on_ground(stage, grid + shift) for shift in (0.0, 0.5))
    assert len(on_lines) > 20 and len(between) > 20
    light = [image[tuple(pixels.astype(int).T[::-1])] for pixels in (on_lines, between)]
    assert np.median(light[0]) < np.median(light[1]) - 8


@pytest.mark.gl
def test_the_ground_is_behind_the_object_and_below_the_horizon(stage):
    stage.scene.orbit = replace(stage.scene.orbit, pitch=np.radians(10.0))
    image, plain = stage.picture(), stage.plain()
    changed = abs(image - plain).max(axis=-1) > 1
    opaque = stage.layer.color_image()[..., 3] == 255
    assert not changed[opaque].any()
    rows = np.flatnonzero(changed.any(axis=1))
    assert rows.min() > 60 and changed[-20:].mean() > 0.8
    assert image[changed].mean() < plain[changed].mean()


@pytest.mark.gl
def test_from_below_the_ground_hides_nothing(stage):
    stage.scene.orbit = replace(stage.scene.orbit, pitch=np.radians(-40.0))
    np.testing.assert_array_equal(stage.picture(), stage.plain())


@pytest.mark.gl
def test_without_a_ground_there_is_nothing_to_see(stage):
    plain = stage.plain()
    stage.scene.set_ground(False)
    np.testing.assert_array_equal(stage.picture(), plain)


@pytest.mark.gl
def test_the_shadow_follows_the_object(stage):
    stage.scene.orbit = replace(stage.scene.orbit, pitch=np.radians(60.0), distance=4.0)
    before = stage.picture()
    stage.scene.solver.set_state(stage.scene.solver.rest_vertices + np.array([0.5, 0.0, 0.4]))
    stage.scene.revision += 1
    (at,), _ = picking.project(stage.camera, [[*stage.scene.center[:2], stage.scene.floor]])
    x, y = at.astype(int)
    after = stage.picture()
    shadow_at = after[y - 15 : y + 15, x : x + 60]
    assert np.isinf(stage.layer.depth_image()[y, x])
    assert shadow_at.min() < 200 and before.shape == after.shape
    assert after[y, x].mean() > 200  # where the object was, there is ground now


@pytest.mark.gl
def test_of_a_transparent_picture_the_shadow_alone_is_opaque(stage):
    stage.layer.transparent = True
    image = stage.picture(channels=4)
    alpha, opacity = image[..., 3], stage.layer.color_image()[..., 3]
    shaded = (opacity == 0) & (alpha > 10)
    assert shaded.sum() > 100
    assert (image[shaded][:, :3] == 0.0).all()
    assert (alpha[opacity == 255] == 255).all()
    assert (alpha[:60, :60] == 0).all()
