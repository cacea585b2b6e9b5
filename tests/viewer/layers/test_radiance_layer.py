"""The field's image in OpenGL: right pixels, right depth, no work without a change."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from deformrf.core.deform import TIME_STEP
from deformrf.core.render import (
    MODES,
    Renderer,
    RenderOptions,
    render_mode,
    shifted,
    view_projection,
)
from deformrf.viewer.camera import orbit as orbits
from deformrf.viewer.camera import picking
from deformrf.viewer.document import Scene
from deformrf.viewer.layers import SAMPLE_COUNT, Canvas, RadianceLayer, resolution
from deformrf.viewer.layers.gl import depth_terms
from deformrf.viewer.layers.radiance_layer import CHECKER_SIZE, REST_SECONDS
from deformrf.viewer.layers.resolution import CPU_LADDER, SMALL
from deformrf.viewer.times import FrameTimes

pytestmark = pytest.mark.gl
SIZE = 160, 120


class Stage:
    """A scene, its layer, and a clock that passes when told to."""

    def __init__(self, field, context):
        self.scene = Scene(field, "ball", "cpu")
        self.renderer = Renderer(field)
        self.now = 0.0
        self.times = FrameTimes()
        parts = self.scene, self.renderer, "copy", self.times
        self.layer = RadianceLayer(context, *parts, lambda: self.now)
        self.canvas = Canvas(context)

    @property
    def camera(self):
        return orbits.camera_of(self.scene.orbit, *SIZE)

    def frame(self, whole=False, passing=0.01):
        self.now += passing
        self.layer.update(self.camera, whole)
        self.canvas.use(SIZE)
        self.layer.draw(self.camera, orbits.clip_range(self.scene.orbit))
        return self.canvas.read()

    def reference(self):
        self.renderer.set_vertices(self.scene.solver.vertices)
        return self.renderer.render(self.camera, RenderOptions())


@pytest.fixture
def stage(ball, window):
    return Stage(ball, window[1])


def test_at_full_resolution_the_pixels_are_the_renderers(stage):
    shown = stage.frame(whole=True)
    wanted = stage.reference().color_array()[:, :, :3]
    assert abs(shown.astype(int) - wanted).max() <= 1
    assert wanted.std() > 20


@pytest.mark.parametrize("parallel", [False, True])
def test_the_depth_written_is_the_depth_of_the_surface(stage, window, parallel):
    stage.scene.orbit = replace(stage.scene.orbit, parallel=parallel)
    stage.frame(whole=True)
    framebuffer = stage.canvas._framebuffer
    raw = framebuffer.read(attachment=-1, components=1, dtype="f4", alignment=1)
    written = np.frombuffer(raw, "f4").reshape(SIZE[::-1])[::-1]
    t = stage.reference().depth_array()
    camera, (near, far) = stage.camera, orbits.clip_range(stage.scene.orbit)
    x = (np.arange(160) + 0.5 - 80) / camera.focal
    y = (np.arange(120) + 0.5 - 60) / camera.focal
    z = t if parallel else t / np.sqrt(1 + x[None] ** 2 + y[:, None] ** 2)
    a, b = depth_terms(near, far, parallel)
    assert a + (b * near if parallel else b / near) == pytest.approx(0)
    assert a + (b * far if parallel else b / far) == pytest.approx(1)
    hit = np.isfinite(t)
    assert 0.1 < hit.mean() < 0.9
    wanted = a + (b * z if parallel else b / z)
    assert written[hit] == pytest.approx(wanted[hit], abs=1e-5)
    corner = np.array([0.4, 0.5, 0.6, 1.0])  # what else is drawn has the same depth there
    clip = view_projection(camera, near, far) @ corner
    _, (t,) = picking.project(camera, corner[None, :3])
    away = (corner[:3] - camera.position) @ camera.forward
    assert 0.5 + 0.5 * clip[2] / clip[3] == pytest.approx(a + (b * t if parallel else b / away))
    assert (written[~hit] == 1).all()


def test_the_image_is_coarse_while_things_move_and_full_at_rest(stage):
    stage.scene.settings.accumulate = False
    stage.layer._moving.step = len(CPU_LADDER) - 1  # so that there is a resolution in between
    stage.frame()
    assert stage.layer.factor < 0.2
    assert stage.layer.refined == 0
    stage.frame(passing=0.5 * REST_SECONDS)
    assert stage.layer.refined == 0  # it may go on moving
    for _ in range(200):
        shown = stage.frame(passing=REST_SECONDS)
        assert (shown[:, 0] == 255).all()  # the background shows no seam on the way
    assert stage.layer.refined == 1
    wanted = stage.reference().color_array()[:, :, :3]
    assert abs(shown.astype(int) - wanted).max() <= 1


def test_what_moves_on_a_cpu_is_upsampled_and_sharper(stage):
    """The same number of rays, scaled up alone, shows less."""
    scene, rest_pose = stage.scene, stage.scene.positions
    stage.layer._moving.step = 2
    stage.frame(whole=True)
    for k in range(6):
        scene.solver.set_state(rest_pose + np.float32(0.0005 * k))
        scene.revision += 1
        shown = stage.frame()
        stage.layer._moving.step = 2
    assert stage.layer.factor == 0.5 and stage.layer.depth_image().shape == (120, 160)
    full = stage.reference().color_array()[..., :3]
    scene.settings.fixed_resolution = 0.5
    coarse = stage.frame()
    assert decibels(shown, full) > decibels(coarse, full) + 2.0


def test_a_hand_that_holds_still_for_a_moment_gets_all_pixels(stage):
    stage.layer._moving.step = 2
    for _ in range(4):
        shown = stage.frame(passing=0.2 * REST_SECONDS)
    full = stage.reference().color_array()[..., :3]
    assert abs(shown.astype(int) - full).max() <= 1
    count = stage.layer.render_count
    stage.frame(passing=0.1 * REST_SECONDS)
    assert stage.layer.render_count == count == 4


def test_an_object_may_leave_the_picture_while_it_moves_and_come_back(stage):
    stage.layer._moving.step, orbit = 2, stage.scene.orbit
    assert (stage.frame()[..., :3] != 255).any()
    for k in range(3):
        stage.scene.orbit = replace(orbit, target=orbit.target + np.array([0.0, 50.0 + k, 0.0]))
        assert (stage.frame()[..., :3] == 255).all()
    stage.scene.orbit = orbit
    assert (stage.frame()[..., :3] != 255).any()


@pytest.mark.parametrize("change", ["background", "mode", "size"])
def test_nothing_of_another_picture_comes_through(stage, window, change):
    stage.layer._moving.step = 2
    stage.frame()
    scene, size = stage.scene, SIZE
    if change == "background":
        scene.settings.background = (0.0, 0.3, 0.0)
    elif change == "mode":
        scene.settings.mode = "tets"
        stage.frame()
        scene.settings.mode = "color"
    else:
        size = 151, 97
    stage.layer._moving.step = 2
    camera = orbits.camera_of(scene.orbit, *size)
    stage.layer.update(camera)
    again = Stage(scene.field, window[1])
    again.scene.settings.background = scene.settings.background
    again.layer._moving.step = 2
    again.layer.update(camera)
    shown, wanted = (one.layer.shown.texture.color.read() for one in (stage, again))
    assert shown == wanted


def test_pictures_of_half_the_size_and_whole_ones_follow_each_other(stage):
    """The texture has what was rendered, and nothing of where the object was before."""
    last, scene = len(CPU_LADDER) - 1, stage.scene
    for step in (2, last, 2, last, last, 2, 2):
        stage.layer._moving.step = step
        scene.orbit = replace(scene.orbit, yaw=scene.orbit.yaw + 0.2)
        stage.frame()
        small = CPU_LADDER[step].scale == SMALL
        assert stage.layer.depth_image().shape == ((60, 80) if small else (120, 160))
        shown = stage.layer.shown
        assert shown.texture.color.read() == shown.images[0].color_array().tobytes()


def test_at_rest_picking_uses_the_depth_of_the_full_image(stage):
    stage.layer._moving.step = len(CPU_LADDER) - 1
    stage.frame()
    shapes = [stage.layer.depth_image().shape]
    while stage.layer.refined < 1:
        stage.frame(passing=REST_SECONDS)
        depth = stage.layer.depth_image()
        if depth.shape != shapes[-1]:
            shapes.append(depth.shape)
    assert shapes == [(60, 80), (120, 160)]  # whole images, never parts
    assert np.array_equal(depth, stage.reference().depth_array())


def test_while_it_is_refined_whole_pictures_alone_are_shown(stage, monkeypatch):
    """No seam sweeps over the picture: what is drawn changes with a whole finer one."""
    monkeypatch.setattr(resolution, "STRIP_SECONDS", 0.0)  # many strips a picture
    stage.scene.settings.accumulate = False
    stage.layer._moving.step = len(CPU_LADDER) - 1
    images, parts = [stage.frame()], 0
    while stage.layer.refined < 1:
        factor = stage.layer.factor
        image = stage.frame(passing=REST_SECONDS)
        if stage.layer.factor == factor:
            np.testing.assert_array_equal(image, images[-1])
            parts += 1
        else:
            images.append(image)
    assert len(images) == 2 and parts > 20


def test_without_a_change_nothing_is_rendered(stage):
    for _ in range(5):
        stage.frame(whole=True)
    assert stage.layer.render_count == 1


@pytest.mark.parametrize("change", ["camera", "vertices", "background"])
def test_each_change_is_rendered_once(stage, change):
    stage.frame(whole=True)
    if change == "camera":
        stage.scene.orbit = orbits.turned(stage.scene.orbit, 9, 3, 120)
    elif change == "vertices":
        stage.scene.solver.set_state(stage.scene.positions + np.float32(0.05))
        stage.scene.revision += 1
    else:
        stage.scene.settings.background = (0.1, 0.2, 0.3)
    before = stage.reference().color_array()
    for _ in range(3):
        shown = stage.frame(whole=True)
    assert stage.layer.render_count == 2
    if change == "background":
        assert shown[0, 0].tolist() == pytest.approx([26, 51, 76], abs=1)
    else:
        assert abs(shown.astype(int) - before[:, :, :3]).max() <= 1


def test_a_fixed_resolution_is_kept(stage):
    stage.scene.settings.fixed_resolution = 0.25
    stage.frame()
    assert stage.layer.depth_image().shape == (30, 40)


def test_another_size_of_the_window_is_another_image(stage):
    stage.frame(whole=True)
    camera = orbits.camera_of(stage.scene.orbit, 90, 70)
    stage.layer.update(camera, whole=True)
    assert stage.layer.depth_image().shape == (70, 90)


def rest(stage):
    """Frames until nothing is left to do; how many it took."""
    for count in range(400):
        if stage.layer.settled:
            return count
        stage.frame(passing=REST_SECONDS)
    pytest.fail("it does not come to rest")


def test_at_rest_sixteen_shifted_images_are_averaged_and_then_nothing_happens(stage):
    stage.frame()
    rest(stage)
    assert stage.layer.sample_count == SAMPLE_COUNT == 16
    shown = stage.frame().astype(int)
    camera, renderer = stage.camera, stage.renderer
    wanted = np.mean(
        [renderer.render(shifted(camera, k)).color_array()[..., :3] for k in range(16)], axis=0
    )
    plain = stage.reference().color_array()[:, :, :3]
    assert abs(shown - wanted).max() <= 1
    assert abs(plain - wanted).max() > 10
    assert np.array_equal(stage.layer.depth_image(), stage.reference().depth_array())
    assert stage.layer.color_image()[..., :3] == pytest.approx(shown, abs=1)
    stage.renderer.render = None  # would fail if called
    for _ in range(5):
        assert np.array_equal(stage.frame(passing=1.0), shown)


def test_a_change_restarts_the_mean(stage):
    stage.frame(whole=True)
    while stage.layer.sample_count < 5:
        stage.frame(passing=REST_SECONDS)
    stage.scene.orbit = orbits.turned(stage.scene.orbit, 9, 3, 120)
    stage.frame(whole=True)
    assert stage.layer.sample_count == 1
    rest(stage)
    shown = stage.layer.color_image().astype(int)
    again = Stage(stage.scene.field, stage.layer._ctx)
    again.scene.orbit = stage.scene.orbit
    again.frame(whole=True)
    rest(again)
    assert np.array_equal(again.layer.color_image(), shown)


def test_a_window_of_one_pixel_has_room_for_its_image(stage):
    """Images are 8 x 8 at least."""
    camera = orbits.camera_of(stage.scene.orbit, 1, 1)
    for _ in range(40):
        stage.now += 0.3
        stage.layer.update(camera)
    assert stage.layer.sample_count > 1


@pytest.mark.parametrize("mode", ["tets", "samples", "error", "normals"])
def test_modes_without_a_meaningful_mean_are_not_averaged(stage, mode):
    stage.scene.settings.mode = mode
    stage.frame(whole=True)
    for _ in range(5):
        stage.frame(passing=0.3)
    assert stage.layer.sample_count == stage.layer.most_samples == 1


def test_without_accumulation_rendering_ends_with_the_full_image(stage):
    stage.scene.settings.accumulate = False
    stage.frame()
    rest(stage)
    assert stage.layer.sample_count == 1
    assert np.array_equal(stage.layer.color_image(), stage.reference().color_array())


@pytest.mark.parametrize("mode", MODES)
def test_each_mode_is_shown_as_it_is_rendered(stage, mode):
    stage.scene.settings.mode = mode
    shown = stage.frame(whole=True).astype(int)
    image = render_mode(
        stage.renderer, stage.camera, mode, RenderOptions(), None, stage.scene.viewpoint.depth_range
    )
    assert abs(shown - image.color_array()[..., :3]).max() <= 1
    assert np.array_equal(stage.layer.depth_image(), stage.reference().depth_array())


def test_another_mode_is_a_change(stage):
    stage.frame(whole=True)
    stage.scene.settings.mode = "tets"
    stage.frame(whole=True)
    assert stage.layer.render_count == 2


@pytest.mark.parametrize("background", [(1.0, 1.0, 1.0), (0.1, 0.4, 0.2)])
def test_the_checkerboard_is_behind_the_object(stage, background):
    settings = stage.scene.settings
    settings.background, settings.checkerboard = background, True
    shown = stage.frame(whole=True).astype(float)
    image = stage.renderer.render(stage.camera, RenderOptions(background)).color_array()
    color, opacity = image[..., :3].astype(float), image[..., 3:] / 255.0
    y, x = np.indices(SIZE[::-1]) // CHECKER_SIZE
    gray = np.where((x + y) % 2, 0.70, 0.86)[..., None]
    wanted = color + 255 * (1 - opacity) * (gray - np.array(background))
    assert abs(shown - wanted).max() <= 1.01
    assert shown[opacity[..., 0] == 0].std() > 15


def test_a_slow_cpu_renders_its_last_rungs_with_cheaper_settings(stage):
    asked = []
    render = stage.renderer.render

    def noted(camera, options=None, rows=None):
        asked.append(options)
        return render(camera, options, rows)

    stage.renderer.render = noted
    stage.layer._moving.step = len(CPU_LADDER) - 1
    stage.frame()
    assert asked[0].step_factor == 2.0
    rest(stage)
    assert all(options.step_factor == 1.0 and not options.level_count for options in asked[1:])


def test_the_target_frame_rate_is_the_settings_less_what_else_takes_time(stage):
    stage.scene.settings.target_fps = 4.0
    stage.frame()
    assert stage.layer._moving.target_seconds == pytest.approx(0.25, abs=0.01)


def test_where_time_steps_alone_bring_pictures_they_have_the_time_of_their_frames(stage):
    """At 240 frames a second four show the same picture, unless the camera moves, too."""
    scene, target = stage.scene, lambda: stage.layer._moving.target_seconds
    scene.settings.target_fps = 240.0
    stage.frame()
    assert target() == pytest.approx(1 / 240, abs=1e-4)
    scene.revision += 1
    stage.frame()
    assert target() == pytest.approx(TIME_STEP, abs=1e-4)
    scene.revision += 1
    scene.orbit = replace(scene.orbit, yaw=1.0)
    stage.frame()
    assert target() == pytest.approx(1 / 240, abs=1e-4)
    scene.settings.target_fps = 10.0
    scene.revision += 1
    stage.frame()
    assert target() == pytest.approx(0.1, abs=1e-4)


def test_stages_of_rendering_are_measured_only_if_asked_for(stage):
    times = stage.times
    stage.layer.update(stage.camera, True)
    assert times.rendering == {}
    stage.scene.settings.time_rendering = True
    stage.scene.settings.background = (0.0, 0.0, 0.0)
    stage.layer.update(stage.camera, True)
    assert len(times.rendering) >= 3
    assert all(seconds > 0 for seconds in times.rendering.values())


def decibels(image, wanted):
    return 10.0 * np.log10(255.0**2 / ((image.astype(float) - wanted) ** 2).mean())


@pytest.mark.parametrize("factor", [0.25, 0.5])
def test_a_scaled_up_picture_is_closer_to_the_full_one_than_bilinear_means(stage, factor):
    """Its texels are blended within a layer of depth; edges of layers stay sharper."""
    full = stage.frame(whole=True)
    stage.scene.settings.fixed_resolution = factor
    shown = stage.frame()
    small = Image.fromarray(stage.layer.color_image()[..., :3])
    plain, blocks = (
        np.asarray(small.resize(SIZE, way))
        for way in (Image.Resampling.BILINEAR, Image.Resampling.NEAREST)
    )
    assert decibels(shown, full) > decibels(plain, full)
    assert decibels(shown, full) > decibels(blocks, full) + 1.0


def test_depth_is_not_blended_across_an_edge(stage):
    """What is drawn has the depth of the object or of the background, nothing in between."""
    stage.scene.settings.fixed_resolution = 0.25
    stage.frame()
    raw = stage.canvas._framebuffer.read(attachment=-1, components=1, dtype="f4", alignment=1)
    written = np.frombuffer(raw, "f4")
    t = stage.layer.depth_image()
    a, b = depth_terms(*orbits.clip_range(stage.scene.orbit))
    farthest = a + b / t[np.isfinite(t)].max()
    assert ((written <= farthest + 1e-6) | (written == 1.0)).all()
    assert 0.1 < (written < 1.0).mean() < 0.9


@pytest.mark.parametrize("mode", ["tets", "levels"])
def test_data_stay_blocks(stage, mode):
    settings = stage.scene.settings
    settings.mode, settings.fixed_resolution = mode, 0.25
    shown = stage.frame()
    blocks = np.repeat(np.repeat(stage.layer.color_image()[..., :3], 4, axis=0), 4, axis=1)
    np.testing.assert_array_equal(shown, blocks)


@pytest.mark.parametrize("background", [(1.0, 1.0, 1.0), (0.3, 0.1, 0.71)])
def test_a_picture_that_is_drawn_around_the_object_alone_is_the_whole_one(stage, background):
    settings = stage.scene.settings
    settings.background, settings.fixed_resolution = background, 0.25
    stage.scene.orbit = orbits.turned(stage.scene.orbit, 50, 0, 120)
    part = stage.frame()
    _, _, width, height = stage.layer._object_part(stage.camera)
    assert 0.1 < width * height / (SIZE[0] * SIZE[1]) < 0.8
    depth = drawn_depth(stage)
    stage.layer._object_part = lambda camera: None
    whole = stage.frame()
    assert abs(part.astype(int) - whole).max() <= 1  # an opacity of 1/600 may show
    np.testing.assert_array_equal(drawn_depth(stage), depth)


def drawn_depth(stage):
    raw = stage.canvas._framebuffer.read(attachment=-1, components=1, dtype="f4", alignment=1)
    return np.frombuffer(raw, "f4")
