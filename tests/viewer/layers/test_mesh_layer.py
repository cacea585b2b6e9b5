"""The surface of the coarse mesh: right colors at the right places, over the picture."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deformrf.core.deform import rest_tets
from deformrf.core.render import Renderer
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.document import Scene
from deformrf.viewer.layers import Canvas, HandleLayer, MeshLayer, RadianceLayer
from deformrf.viewer.layers.legend import COLORS, colored
from deformrf.viewer.layers.mesh_layer import LIGHT_SHADING, scale_of, values_of
from deformrf.viewer.settings import SURFACES, Settings
from deformrf.viewer.times import FrameTimes

SIZE = 400, 300


class Stage:
    """A scene with its layers; `picture` draws it."""

    def __init__(self, field, context):
        self.scene = Scene(field, "ball", "cpu")
        self.scene.settings.show_handles = False
        times = FrameTimes()
        self.radiance = RadianceLayer(context, self.scene, Renderer(field), "copy", times)
        self.mesh = MeshLayer(context, self.scene, self.radiance.draw_depth)
        self.handles = HandleLayer(context, self.scene)
        self.canvas = Canvas(context)

    @property
    def camera(self):
        return orbits.camera_of(self.scene.orbit, *SIZE)

    def picture(self, covered=0):
        self.radiance.update(self.camera, whole=True)
        self.canvas.use(SIZE)
        clip_range = orbits.clip_range(self.scene.orbit)
        self.radiance.draw(self.camera, clip_range)
        self.mesh.draw(self.camera, clip_range, covered)
        self.handles.draw(self.camera, clip_range)
        return self.canvas.read().astype(float)

    def depth(self):
        raw = self.canvas._framebuffer.read(attachment=-1, components=1, dtype="f4", alignment=1)
        return np.frombuffer(raw, "f4")

    def deform(self, matrix):
        rest = self.scene.solver.rest_vertices
        moved = (rest - self.scene.center) @ np.transpose(matrix) + self.scene.center
        self.scene.solver.set_state(moved)
        self.scene.revision += 1


@pytest.fixture
def stage(ball, window):
    return Stage(ball, window[1])


def hue(color):
    return color / np.linalg.norm(color, axis=-1, keepdims=True)


@pytest.mark.gl
@pytest.mark.parametrize("surface, stretch", [("strain", 1.1), ("volume ratio", 1.05)])
def test_a_uniform_stretch_has_one_color_and_the_legend_says_which(stage, surface, stretch):
    settings = stage.scene.settings
    settings.mesh_surface, settings.mesh_opacity = surface, 1.0
    stage.deform(np.diag([1.0, 1.0, stretch]))
    image = stage.picture()
    middle = image[100:200, 150:250].reshape(-1, 3)
    share = (stretch - 1.0) / 0.2 if surface == "strain" else 0.5 + (stretch - 1.0) / 0.4
    color = 255.0 * colored("viridis" if surface == "strain" else "coolwarm", share)
    assert hue(middle) @ hue(color) == pytest.approx(1.0, abs=2e-3)  # shaded, but not tinted
    brightness = np.linalg.norm(middle, axis=1) / np.linalg.norm(color)
    assert LIGHT_SHADING[0] - 0.02 < brightness.min() < brightness.max() < LIGHT_SHADING[1] + 0.02
    legend = image[:, 320:].reshape(-1, 3)
    last = 255.0 * COLORS[scale_of(settings).colors][-1]
    assert (abs(legend - last).max(axis=1) < 12).sum() > 5


@pytest.mark.gl
def test_opacity_blends_the_surface_over_the_picture(stage):
    settings = stage.scene.settings
    bare = stage.picture()
    pictures = {}
    settings.mesh_surface = "plain"
    for opacity in (0.0, 0.5, 1.0):
        settings.mesh_opacity = opacity
        pictures[opacity] = stage.picture()
    np.testing.assert_array_equal(pictures[0.0], bare)
    off = abs(pictures[0.5] - 0.5 * (bare + pictures[1.0])).max(axis=-1) > 2
    assert off.sum() <= 3  # where two faces are equally near, both are blended
    covered = (pictures[1.0] != bare).any(axis=-1)
    opaque = np.isfinite(stage.radiance.depth_image())
    assert covered[opaque].all()  # the field is inside


@pytest.mark.gl
def test_spheres_and_picking_know_the_pictures_depth_alone(stage):
    stage.picture()
    depth = stage.depth()
    settings = stage.scene.settings
    settings.show_handles = True
    bare = stage.picture()
    settings.mesh_surface, settings.mesh_opacity, settings.show_wireframe = "plain", 1.0, True
    image = stage.picture()
    points = stage.scene.handles.at(stage.scene.handles.control_ids)
    depth_image, bias = stage.radiance.depth_image(), stage.scene.handle_bias
    shown = picking.visible(stage.camera, points, depth_image, bias)
    pixels, _ = picking.project(stage.camera, points[shown])
    columns, rows = pixels.astype(int).T
    np.testing.assert_allclose(image[rows, columns], bare[rows, columns], atol=3)
    settings.show_handles = False
    stage.picture()
    np.testing.assert_array_equal(stage.depth(), depth)


@pytest.mark.gl
def test_edges_are_seen_on_any_background_and_hide_each_other(stage):
    settings = stage.scene.settings
    for background in ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)):
        settings.background, settings.show_wireframe = background, False
        plain = stage.picture()
        settings.show_wireframe = True
        wired = stage.picture()
        difference = abs(plain - wired).max(axis=-1)
        outside = ~np.isfinite(stage.radiance.depth_image())
        assert 0.03 < (difference > 60).mean() < 0.3
        assert (difference[outside] > 60).sum() > 20  # beside the object, too
    # With opaque faces behind them, no line shows that the faces would hide.
    settings.background = (1.0, 1.0, 1.0)
    lines = stage.picture().min(axis=-1) < 60
    settings.mesh_surface, settings.mesh_opacity = "plain", 1.0
    covered = stage.picture().min(axis=-1) < 60
    beside = ~np.isfinite(stage.radiance.depth_image())
    assert (lines & ~covered & beside).sum() < 0.05 * (lines & beside).sum()


@pytest.mark.gl
def test_a_new_rest_shape_is_without_strain(stage):
    settings = stage.scene.settings
    settings.mesh_surface, settings.mesh_opacity = "strain", 1.0
    stage.deform(1.1 * np.eye(3))
    strained = stage.picture()[100:200, 150:250].mean(axis=(0, 1))
    assert stage.scene.body.rest_here()
    relaxed = stage.picture()[100:200, 150:250].mean(axis=(0, 1))
    assert hue(relaxed) @ hue(COLORS["viridis"][0]) > 0.99 > hue(strained) @ hue(relaxed)


def test_values_are_where_the_object_is_strained(ball):
    rest = rest_tets(ball.mesh.rest_vertices, ball.mesh.tets)
    positions = ball.mesh.rest_vertices.copy()
    upper = positions[:, 2] > 0.5
    positions[upper, 2] = 0.5 + 1.2 * (positions[upper, 2] - 0.5)
    strain = values_of("strain", positions, rest)
    assert strain[positions[:, 2] < 0.4] == pytest.approx(0.0, abs=1e-6)
    assert strain[positions[:, 2] > 0.6] == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize("surface", SURFACES)
def test_a_scale_says_what_its_ends_are(surface):
    scale = scale_of(Settings(mesh_surface=surface, mesh_range=0.2))
    if surface in ("hidden", "plain"):
        assert scale is None
        return
    assert scale.word == surface
    texts = scale.tick_texts()
    assert texts[-1].startswith("> ") and float(texts[-1][2:]) == pytest.approx(scale.high)
    assert scale.share(scale.low) == 0.0 and scale.share(9.0) == 1.0
    normal = 0.0 if surface == "strain" else 0.5
    assert scale.share(0.0 if surface == "strain" else 1.0) == pytest.approx(normal)


def test_each_key_of_a_view_mode_shows_it():
    from deformrf.core.render import MODES
    from deformrf.viewer.actions import ACTIONS, action_of
    from deformrf.viewer.tools import CTRL

    app = SimpleNamespace(scene=SimpleNamespace(settings=Settings()))
    for number, mode in enumerate(MODES, start=1):
        ACTIONS[action_of(f"_{number}", CTRL)](app)
        assert app.scene.settings.mode == mode
    for key, surface in (("_9", "strain"), ("_0", "volume ratio"), ("W", "plain")):
        for wanted in (surface, "hidden"):  # again, and it is hidden
            ACTIONS[action_of(key, CTRL)](app)
            assert app.scene.settings.mesh_surface == wanted


@pytest.mark.gl
@pytest.mark.parametrize("parallel", [False, True])
def test_faces_that_look_at_the_eye_are_lit(stage, parallel):
    """In perspective and by parallel rays, the surface covers the object and is bright."""
    settings = stage.scene.settings
    stage.scene.orbit = replace(stage.scene.orbit, parallel=parallel)
    settings.mesh_surface, settings.mesh_opacity = "plain", 1.0
    image = stage.picture()
    opaque = np.isfinite(stage.radiance.depth_image())
    assert 0.1 < opaque.mean() < 0.6
    lit = image[opaque].mean(axis=1)
    assert 120 < np.median(lit) < 240 and lit.max() < 250


def test_the_legend_is_left_of_what_panels_cover(stage):
    stage.scene.settings.mesh_surface = "strain"
    words = [
        np.flatnonzero((stage.picture(covered) < 60).all(axis=2)[:, 310:].any(axis=0))
        for covered in (0, 100)
    ]
    assert len(words[0]) and not len(words[1])
