"""The field's image in the window: rendered when something has changed, refined at rest.

While camera or vertices change, the image is rendered with as many pixels as the target
frame rate allows (resolution.py).  Afterwards finer ones follow, up to the full resolution,
and then images shifted by parts of a pixel, whose mean is shown: all in strips of rows, a
strip per frame, so that the window answers all the while.  Depth goes along, that of the
unshifted image: other things in the scene hide behind the object.
"""

import time
from dataclasses import replace
from functools import partial

import moderngl
import numpy as np
import warp as wp

from ..core.field import level_edges
from ..core.render import RenderOptions, render_mode
from . import gl
from .resolution import (
    CPU_LADDER,
    LADDER,
    STRIP_SECONDS,
    MovingResolution,
    Strips,
    finer,
    render_budget,
    savings,
    size_at,
)
from .sampling import SAMPLE_COUNT, Sampling
from .upload import ImageTexture

REST_SECONDS = 0.15  # without a change, before refining begins
OTHER_STAGES = ("simulate", "draw", "panel")
CHECKER_SIZE = 12  # pixels
AVERAGED_MODES = ("color", "accumulation")


class RadianceLayer:
    """Draws what a Renderer of core/render renders.

    Attributes:
        path: How frames reach OpenGL, "buffer" or "copy".
        factor: Resolution of the coarse image, relative to the window's.
        cheaper: What the coarse image saves on, as arguments of RenderOptions.
        render_count: Images rendered so far; strips, and so sub-pixel samples, not counted.
    """

    def __init__(self, ctx: moderngl.Context, renderer, device: str, path: str, clock=None):
        self.path = path
        self.factor = 1.0
        self.cheaper = {}
        self.render_count = 0
        self._ctx, self._renderer, self._device = ctx, renderer, device
        self._clock = clock or time.perf_counter
        self._triangle = gl.full_screen(ctx, "image")
        self._moving = MovingResolution(0.1, CPU_LADDER if device == "cpu" else LADDER)
        field = renderer.field
        self._level_edges = level_edges(field.mesh, field.layout.level_count)
        self._coarse = self._fine = None  # ImageTexture
        self._strips = None  # of the fine image, while there is one
        self._fine_factor = 1.0
        self._images = []  # what the coarse image is made of, from top to bottom
        self._strip_images = []  # the same of the fine one, as far as it is
        self._sampling = None  # once the full image is there, and more is wanted
        self._row_seconds = None  # at the full resolution
        self._host_depth = None
        self._seen = self._pose = None  # what was rendered last
        self._options, self._mode, self._depth_range = RenderOptions(), "color", (0.0, 1.0)
        self._checkerboard = self._accumulate = False
        self._changed_at = 0.0

    # -- how far it is -------------------------------------------------------------------

    @property
    def refined(self) -> float:
        """The part of the rows that shows the full resolution."""
        if self.factor == 1.0:
            return 1.0
        return self._progress if self._fine_factor == 1.0 else 0.0

    @property
    def sample_count(self) -> int:
        """How many images at full resolution the shown one is the mean of."""
        if self._sampling is not None:
            return self._sampling.count
        return int(self.factor == 1.0)

    @property
    def most_samples(self) -> int:
        """What `sample_count` will be at rest."""
        return SAMPLE_COUNT if self._accumulate else 1

    @property
    def settled(self) -> bool:
        """Whether nothing is left to render until something changes."""
        return self.refined == 1.0 and self.sample_count >= self.most_samples

    @property
    def _progress(self):
        """The part of the fine image that there is."""
        return self._strips.next_row / self._strips.height if self._strips else 0.0

    def depth_image(self):
        """The depths [h, w] of the last whole image, perhaps at fewer pixels than the window's.

        None before the first.
        """
        if self._host_depth is None and self._images:
            self._host_depth = np.concatenate([image.depth_array() for image in self._images])
        return self._host_depth

    def color_image(self):
        """The colors of the last whole image, opacity as alpha.  [h, w, 4] uint8"""
        if self._sampling is not None and self._sampling.color is not None:
            return self._sampling.color.numpy()
        return np.concatenate([image.color_array() for image in self._images])

    # -- rendering -----------------------------------------------------------------------

    def update(self, scene, camera, times, whole=False) -> None:
        """Render what has changed since the last call.

        Args:
            camera: Of the full resolution.
            times: StageTimes.
            whole: Render all pixels at once, whatever it takes, but each only once.
        """
        settings = scene.settings
        self._mode, self._depth_range = settings.mode, scene.depth_range
        self._options = RenderOptions(background=tuple(settings.background))
        self._checkerboard = settings.checkerboard
        # The mean of hashed colors or of a heat map is the color of something else.
        self._accumulate = settings.accumulate and settings.mode in AVERAGED_MODES
        fixed = None if settings.automatic_resolution else settings.fixed_resolution
        seen = (
            camera.camera_to_world.tobytes(),
            (camera.focal, camera.width, camera.height, self._options, self._mode),
            (scene.revision, fixed, self._accumulate),
        )
        self._renderer.stage_seconds = {} if settings.time_rendering else None
        now = self._clock()
        if seen != self._seen:
            self._seen, self._changed_at = seen, now
            self._set_pose(scene, times)
            if whole or fixed is not None:
                self._render_coarse(camera, 1.0 if whole else fixed, times)
            else:
                self._render_moving(camera, scene, times)
        elif whole and self.refined < 1.0:
            self._render_coarse(camera, 1.0, times)
        elif whole or now - self._changed_at < REST_SECONDS:
            pass  # it may go on moving
        elif self.refined < 1.0:
            self._refine(camera, times)
        elif not self.settled:
            self._sample(camera, times)
        if self._renderer.stage_seconds:
            times.rendering = self._renderer.stage_seconds

    def _set_pose(self, scene, times):
        if scene.revision != self._pose:
            with times.stage("render"):
                self._renderer.set_vertices(scene.solver.vertices)
            self._pose = scene.revision

    def _render_moving(self, camera, scene, times):
        """A coarse image, as good as the target frame rate allows."""
        moving, rung = self._moving, self._moving.rung
        # Beside a renderer on the CPU it may be OpenGL that makes flip slow; otherwise it is
        # the wait for the screen, which takes nothing from anybody.
        flip = ("flip",) if self._device == "cpu" else ()
        others = times.recent((*OTHER_STAGES, *flip))
        moving.target_seconds = render_budget(scene.settings.target_fps, others)
        pixel = scene.orbit.distance / (camera.focal * rung.factor)
        cheaper = savings(rung, self._level_edges, pixel)
        start = time.perf_counter()
        self._render_coarse(camera, rung.factor, times, **cheaper)
        moving.measured(time.perf_counter() - start)

    def _render_coarse(self, camera, factor, times, **cheaper):
        size = size_at(factor, camera.width, camera.height)
        start = time.perf_counter()
        image = self._render(camera.resized(*size), times, **cheaper)
        self._row_seconds = (time.perf_counter() - start) / size[1] / factor
        self._coarse = self._texture(self._coarse, size)
        with times.stage("upload"):
            self._coarse.write(image)
        self._images, self._host_depth = [image], None
        self.factor, self._strips, self._strip_images = factor, None, []
        self.cheaper = cheaper
        self._sampling = None
        self.render_count += 1

    def _refine(self, camera, times):
        """Render the next strip; an image that is complete takes the coarse one's place."""
        if self._strips is None:
            self._fine_factor = finer(self.factor)
            size = size_at(self._fine_factor, camera.width, camera.height)
            self._fine = self._texture(self._fine, size)
            self._strips, self._strip_images = Strips(size[1], STRIP_SECONDS), []
        first_row, image = self._next_strip(self._strips, camera.resized(*self._fine.size), times)
        self._strip_images.append(image)
        with times.stage("upload"):
            self._fine.write(image, first_row)
        if self._strips.done:
            self._row_seconds = self._strips.seconds_per_row
            self._coarse, self._fine = self._fine, self._coarse
            self._images, self._strip_images = self._strip_images, []
            self.factor, self._strips, self._host_depth = self._fine_factor, None, None
            self.cheaper = {}

    def _sample(self, camera, times):
        """Render the next strip of a shifted image; one that is complete joins the mean."""
        camera = camera.resized(*self._coarse.size)  # a tiny window has an image larger than it
        if self._sampling is None:
            self._sampling = Sampling(self._images, camera, self._device, self._row_seconds)
        if self._sampling.step(camera, partial(self._next_strip, times=times)):
            with times.stage("upload"):
                self._coarse.write_color(self._sampling.color)

    def _next_strip(self, strips, camera, times):
        """The first row of the next strip, and its image."""
        rows = strips.following()
        start = time.perf_counter()
        image = self._render(camera, times, rows)
        strips.rendered(rows, time.perf_counter() - start)
        return rows[0], image

    def _render(self, camera, times, rows=None, **cheaper):
        options = replace(self._options, **cheaper)
        with times.stage("render"):
            image = render_mode(
                self._renderer, camera, self._mode, options, rows, self._depth_range
            )
            wp.synchronize_device(self._device)  # or CUDA's time would be measured elsewhere
        return image

    def _texture(self, old, size):
        """A texture pair of that size; the old one if it fits."""
        if old is not None and old.size == size:
            return old
        if old is not None:
            old.release()
        return ImageTexture(self._ctx, size, self._device, self.path)

    # -- OpenGL --------------------------------------------------------------------------

    def draw(self, camera, clip_range) -> None:
        """Draw color and depth into the framebuffer in use."""
        fine = self._fine if self._strips else self._coarse
        self._coarse.color.use(0)
        self._coarse.depth.use(1)
        fine.color.use(2)
        fine.depth.use(3)
        half_height = 0.5 * camera.height / camera.focal
        gl.set_uniforms(
            self._triangle.program,
            coarse_color=0,
            coarse_depth=1,
            fine_color=2,
            fine_depth=3,
            refined=self._progress,
            background=self._options.background,
            squares=np.array([camera.width, camera.height]) / CHECKER_SIZE,
            checkerboard=self._checkerboard,
            half_extent=(half_height * camera.width / camera.height, half_height),
            depth_terms=gl.depth_terms(*clip_range),
        )
        self._ctx.enable_only(moderngl.DEPTH_TEST)  # without the test nothing is written
        self._ctx.depth_func = "1"  # always
        self._triangle.render(moderngl.TRIANGLES)
        self._ctx.depth_func = "<="

    def release(self) -> None:
        for texture in (self._coarse, self._fine):
            if texture is not None:
                texture.release()
