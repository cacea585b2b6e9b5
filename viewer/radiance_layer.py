"""The field's image in the window: rendered when something has changed, refined at rest.

While camera or vertices change, the image is rendered with as many pixels as the target
frame time allows (resolution.py).  Afterwards finer ones follow, up to the full resolution,
in strips of rows, a strip per frame, so that the window answers all the while.  Depth goes along:
other things in the scene hide behind the object.
"""

import time

import moderngl
import numpy as np

from ..core.render.render import RenderOptions
from . import gl
from .resolution import MovingResolution, Strips, finer, size_at
from .upload import ImageTexture

MOVING_SECONDS = 0.06  # rendering a frame while things move
CPU_MOVING_SECONDS = 0.12  # a picture that can be recognized, before a smooth one
STRIP_SECONDS = 0.045  # rendering a strip at rest
REST_SECONDS = 0.15  # without a change, before refining begins


class RadianceLayer:
    """Draws what a Renderer of core/render renders.

    Attributes:
        path: How frames reach OpenGL, "buffer" or "copy".
        factor: Resolution of the coarse image, relative to the window's.
        render_count: Images rendered so far, strips not counted.
    """

    def __init__(self, ctx: moderngl.Context, renderer, device: str, path: str, clock=None):
        self.path = path
        self.factor = 1.0
        self.render_count = 0
        self._ctx, self._renderer, self._device = ctx, renderer, device
        self._clock = clock or time.perf_counter
        self._triangle = gl.full_screen(ctx, "image")
        on_cpu = device == "cpu"
        self._moving = MovingResolution(CPU_MOVING_SECONDS if on_cpu else MOVING_SECONDS)
        self._coarse = self._fine = None  # ImageTexture
        self._strips = None  # of the fine image, while there is one
        self._fine_factor = 1.0
        self._images = []  # what the coarse image is made of, from top to bottom
        self._strip_images = []  # the same of the fine one, as far as it is
        self._host_depth = None
        self._seen = self._pose = None  # what was rendered last
        self._changed_at = 0.0

    @property
    def refined(self) -> float:
        """The part of the rows that shows the full resolution."""
        if self.factor == 1.0:
            return 1.0
        return self._progress if self._fine_factor == 1.0 else 0.0

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

    def update(self, scene, camera, times, whole=False) -> None:
        """Render what has changed since the last call.

        Args:
            camera: Of the full resolution.
            times: StageTimes.
            whole: Render all pixels at once, whatever it takes.
        """
        settings = scene.settings
        if not settings.automatic_resolution:
            coarse_factor = settings.fixed_resolution
        else:
            coarse_factor = self._moving.factor
        options = RenderOptions(background=tuple(settings.background))
        seen = (
            camera.camera_to_world.tobytes(),
            (camera.focal, camera.width, camera.height, options),
            scene.revision,
            None if settings.automatic_resolution else coarse_factor,
        )
        now = self._clock()
        if seen != self._seen:
            self._seen, self._changed_at = seen, now
            self._set_pose(scene, times)
            start = time.perf_counter()
            self._render_coarse(camera, options, 1.0 if whole else coarse_factor, times)
            if settings.automatic_resolution and not whole:
                self._moving.measured(time.perf_counter() - start)
        elif whole and self.refined < 1.0:
            self._render_coarse(camera, options, 1.0, times)
        elif self.refined < 1.0 and now - self._changed_at >= REST_SECONDS:
            self._refine(camera, options, times)

    def _set_pose(self, scene, times):
        if scene.revision != self._pose:
            with times.stage("render"):
                self._renderer.set_vertices(scene.solver.vertices)
            self._pose = scene.revision

    def _render_coarse(self, camera, options, factor, times):
        size = size_at(factor, camera.width, camera.height)
        with times.stage("render"):
            image = self._renderer.render(camera.resized(*size), options)
        self._coarse = self._texture(self._coarse, size)
        with times.stage("upload"):
            self._coarse.write(image)
        self._images, self._host_depth = [image], None
        self.factor, self._strips, self._strip_images = factor, None, []
        self.render_count += 1

    def _refine(self, camera, options, times):
        """Render the next strip; an image that is complete takes the coarse one's place."""
        if self._strips is None:
            self._fine_factor = finer(self.factor)
            size = size_at(self._fine_factor, camera.width, camera.height)
            self._fine = self._texture(self._fine, size)
            self._strips, self._strip_images = Strips(size[1], STRIP_SECONDS), []
        rows = self._strips.following()
        start = time.perf_counter()
        with times.stage("render"):
            image = self._renderer.render(camera.resized(*self._fine.size), options, rows=rows)
        self._strips.rendered(rows, time.perf_counter() - start)
        self._strip_images.append(image)
        with times.stage("upload"):
            self._fine.write(image, first_row=rows[0])
        if self._strips.done:
            self._coarse, self._fine = self._fine, self._coarse
            self._images, self._strip_images = self._strip_images, []
            self.factor, self._strips, self._host_depth = self._fine_factor, None, None

    def _texture(self, old, size):
        """A texture pair of that size; the old one if it fits."""
        if old is not None and old.size == size:
            return old
        if old is not None:
            old.release()
        return ImageTexture(self._ctx, size, self._device, self.path)

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
