"""The field's image in the window: rendered when something has changed, refined at rest.

resolution.py says how many pixels are rendered when.  A picture is shown when it is whole: a seam
that moves would look like something in the picture.  The depth is that of the unshifted image:
other things in the scene hide behind the object.
"""

import time
from dataclasses import replace

import moderngl
import numpy as np
import warp as wp

from ...core.deform import TIME_STEP
from ...core.field import level_edges
from ...core.render import (
    Image,
    PastView,
    Renderer,
    RenderOptions,
    RunningMean,
    Upsampling,
    render_mode,
    shifted,
)
from ..camera import pixels_per_unit
from ..files import with_colors
from . import gl
from .drawn import DrawnObject
from .ground_plane import GroundPlane
from .resolution import (
    CPU_LADDER,
    LADDER,
    SAMPLE_COUNT,
    SMALL,
    MovingResolution,
    Picture,
    Sampling,
    finer,
)
from .upload import ImageTexture, SharedImage, image_target

REST_SECONDS = 0.15  # without a change, before refining begins
OTHER_TASKS = ("simulate", "draw", "panel")  # of a frame, beside rendering
CHECKER_SIZE = 12  # pixels
AVERAGED_MODES = ("color", "accumulation")
SMOOTH_MODES = ("color", "depth", "accumulation", "normals")  # whose colors may be blended


class RadianceLayer:
    """Draws what a Renderer of core/render renders of an object.

    Attributes:
        shown: The last whole picture.
        factor: Its resolution, relative to the window's.
        refined: The share of the rows at full resolution.
        sample_count: The number of full-resolution images in the shown mean,
        most_samples: and in the end, at rest.
        settled: Whether nothing is left to render until something changes.
        render_count: The number of images that were rendered at once, not in strips.
    """

    def __init__(
        self, ctx, drawn: DrawnObject, renderer, path: str, times, clock=time.perf_counter
    ):
        """Take an object, a renderer of its field, how frames reach OpenGL, and FrameTimes."""
        self.render_count, self.most_samples = 0, SAMPLE_COUNT
        self.path, self.device = path, renderer.device
        self.transparent = False  # draw no background, and the opacity into the fourth channel
        self._ctx, self._drawn = ctx, drawn
        self._times, self._clock = times, clock
        self._triangles = {}  # by what the shader finds defined
        self._triangle = None  # that was drawn last
        self._ground = GroundPlane(ctx, drawn)
        self._moving = MovingResolution(0.1, CPU_LADDER if self.device.is_cpu else LADDER)
        field = renderer.field
        self._level_edges = level_edges(field.mesh, field.layout.level_count)
        self.shown = Picture(0)
        self._coming: Picture | None = None  # a finer one, as far as it is
        self._spare: ImageTexture | SharedImage | None = None  # for the next finer one
        self._sampling: Sampling | None = None  # once shifted images are rendered
        self._upsampling, self._upsampled_at = Upsampling(), None  # and the last Rung
        self._camera = self._kind = None  # of the shown picture: its camera, and what else decides
        self.set_renderer(renderer)
        self._changed_at = 0.0
        self._note_progress()

    # -- how far it is -------------------------------------------------------------------

    def _note_progress(self):
        coming, self.factor = self._coming, self.shown.factor
        self.refined = float(self.factor == 1.0)
        if self.refined < 1.0 and coming is not None and coming.factor == 1.0:
            self.refined = coming.next_row / coming.height
        self.sample_count = self._sampling.count if self._sampling else int(self.factor == 1.0)
        self.settled = self.refined == 1.0 and self.sample_count >= self.most_samples

    def colored(self, surface):
        """An export.SurfaceMesh of the pose as it is now, with the colors that it has there."""
        self._follow_cuts()
        self._renderer.set_vertices(self._drawn.solver.vertices)
        self._pose = None  # to be taken anew
        return with_colors(surface, self._renderer, self._drawn.size)

    def depth_image(self):
        """The depths [h, w] of the last whole picture, at its own resolution; None before it."""
        return self.shown.depth if self.shown.images else None

    def color_image(self):
        """The colors of the last whole picture, opacity as alpha.  [h, w, 4] uint8"""
        if self._sampling and self._sampling.color is not None:
            return self._sampling.color.numpy()
        return np.concatenate([image.color_array() for image in self.shown.images])

    # -- rendering -----------------------------------------------------------------------

    def set_renderer(self, renderer) -> None:
        """Take another renderer, of a whole field with the same mesh and levels."""
        self._renderer, cuts = renderer, self._drawn.cuts
        self._seen = self._pose = None  # what was rendered last
        self._cuts, self._kept = 0, None if cuts.some else cuts.kept

    def _follow_cuts(self):
        """Let the renderer have what is left of the object.

        Masks take no time to speak of.  Where tets have gone, a new renderer has fewer of them:
        the solver no longer moves those that went, and they would overlap others.
        """
        cuts = self._drawn.cuts
        if self._cuts == cuts.revision:
            return
        if cuts.kept is self._kept:
            self._renderer.set_occupancy(cuts.left)
        else:
            self._renderer = Renderer(cuts.field, self.device)
        self._cuts, self._kept = cuts.revision, cuts.kept
        self._seen = self._pose = None

    def update(self, camera, whole=False) -> None:
        """Render what has changed since the last call, for a camera at full resolution.

        If `whole`, all pixels are rendered at once, however long it takes, but each only once.
        """
        drawn, settings = self._drawn, self._drawn.settings
        self._follow_cuts()
        # The mean of hashed colors or of a heat map is the color of something else.
        averages = settings.accumulate and settings.mode in AVERAGED_MODES
        self.most_samples = SAMPLE_COUNT if averages else 1
        seen = (
            camera.camera_to_world.tobytes(),
            (camera.lens, camera.parallel),
            (drawn.revision, settings.mode, settings.background),
            (settings.fixed_resolution, self.most_samples),
        )
        self._renderer.stage.seconds = {} if settings.time_rendering else None
        now = self._clock()
        if seen != self._seen:
            # Where the camera rests, only time steps bring new pictures.
            steps_alone = self._seen is not None and seen[:2] == self._seen[:2]
            self._seen, self._changed_at = seen, now
            before = self._past_view(camera)
            self._upsampling.changed()
            if drawn.revision != self._pose:
                with self._times.task("render"):
                    self._renderer.set_vertices(drawn.solver.vertices)
                self._pose = drawn.revision
            if whole or settings.fixed_resolution is not None:
                self._render_at(1.0 if whole else settings.fixed_resolution, camera)
            else:
                self._render_moving(camera, steps_alone, before)
            self._camera = camera
        elif whole and self.refined < 1.0:
            self._render_at(1.0, camera)
        elif whole or now - self._changed_at < REST_SECONDS:
            missing = self.shown.part is not None and not self._upsampling.whole
            if missing and not whole:  # it may go on moving
                self._upsample(self._upsampled_at, camera, self._past_view(camera))
        elif self.refined < 1.0:
            self._refine(camera)
        elif not self.settled:
            self._sample(camera)
        self._note_progress()
        if self._renderer.stage.seconds:
            self._times.rendering = self._renderer.stage.seconds

    def render_mean(self, moments) -> None:
        """Render a film's frame on the device, the mean of whole images; `upload` shows it.

        Args:
            moments: Of each image the Camera, and the vertices [V, 3] or None: as they are.
                The last one isn't shifted, and the depth is its.
        """
        drawn, settings = self._drawn, self._drawn.settings
        self._follow_cuts()
        moments = moments if settings.mode in AVERAGED_MODES else moments[-1:]
        seen = [settings.mode, settings.background, drawn.revision]
        for camera, vertices in moments:
            pose = None if vertices is None else vertices.tobytes()
            seen.append((camera.camera_to_world.tobytes(), camera.lens, pose))
        if seen == self._seen:
            return  # a frame in which nothing moves
        self._seen = seen
        mean, count = None, len(moments)
        for index, (camera, vertices) in enumerate(moments):
            if vertices is not None or drawn.revision != self._pose:
                now = drawn.solver.vertices if vertices is None else vertices
                self._renderer.set_vertices(now)
                self._pose = drawn.revision if vertices is None else None
            camera = shifted(camera, count - 1 - index)
            image = self._image(camera, (0, camera.height))
            if count > 1:
                mean = mean or RunningMean(camera.width, camera.height, self.device)
                mean.add(image)
        if mean is not None:
            image = replace(image, color=mean.color(count))
        wp.synchronize_device(self.device)  # or CUDA's time would be measured elsewhere
        self._coming = self._picture(1.0, camera, self.shown.texture)
        self._coming.add(image, 0.0)
        self._sampling = self._camera = None

    def upload(self) -> None:
        """Show what `render_mean` has rendered, if anything was new."""
        if self._coming is None:
            return
        self.shown, self._coming = self._coming, None
        self.shown.texture.write(self.shown.images[0])
        self._note_progress()

    def _render_moving(self, camera, steps_alone, before):
        """Render at once, as well as the target frame rate allows.

        Above one frame a time step, if `steps_alone`, a picture is shown for several frames, and
        has the time of them all.
        """
        moving, rung = self._moving, self._moving.rung
        # On CUDA, flip is the wait for the screen, and costs rendering nothing.
        others = (*OTHER_TASKS, "flip") if self.device.is_cpu else OTHER_TASKS
        target, seconds = self._drawn.settings.target_fps, self._times.recent(others)
        frames = target * TIME_STEP if steps_alone else 1.0
        if frames > 1.0:
            means = self._times.means()
            target, seconds = target / frames, frames * sum(means[task] for task in others)
        moving.aim(target, seconds)
        start, others = time.perf_counter(), self._times.spent("draw")
        if rung.stride and self._may_upsample(camera):
            self._upsample(rung, camera, before)
        else:
            self._render_at(rung.factor, camera, self._savings(rung, rung.factor, camera))
        others = self._times.spent("draw") - others
        moving.measured(time.perf_counter() - start - others)

    def _savings(self, rung, factor, camera):
        """What a picture with that share of the image's lines saves on besides pixels."""
        pixel = 1.0 / (factor * pixels_per_unit(camera, self._drawn.viewpoint.orbit.distance))
        return rung.savings(self._level_edges, pixel)

    def _past_view(self, camera):
        """What the shown picture was rendered of, if an upsampled one can follow it."""
        settings, shown = self._drawn.settings, self.shown.texture
        kind = settings.mode, settings.background, self._cuts, self._renderer, camera.parallel
        same, self._kind = kind == self._kind, kind
        sizes = _size_of(camera, 1.0), _size_of(camera, SMALL)
        fits = shown is not None and shown.size in sizes
        if not same or not fits or self._camera is None or not self._may_upsample(self._camera):
            return None
        vertices = wp.clone(self._renderer.pose.vertices)
        return PastView(self._camera.resized(*shown.size), vertices)

    def _may_upsample(self, camera):
        """Whether pixels can be taken from one image to the next."""
        plain = not camera.lens.is_distorted and min(camera.width, camera.height) >= 8
        return plain and self._drawn.settings.mode == "color" and self.device.is_cpu

    def _upsample(self, rung, camera, view):
        """Render a coarse picture, and show the image that it becomes with the one before.

        Args:
            view: The PastView of the shown picture, or None if nothing can be taken from it.
        """
        background = self._drawn.settings.background
        savings = self._savings(rung, rung.scale, camera)
        options = RenderOptions(tuple(background), details=True, **savings)
        before = None if view is None else self._shown_image()
        upsampling, self._upsampled_at = self._upsampling, rung
        picture, last = self._picture(rung.scale, camera, self.shown.texture, savings), self.shown
        camera = camera.resized(*picture.texture.size)
        with self._times.task("render"):
            coarse = upsampling.render(self._renderer, camera, rung.stride, options, view)
        with self._times.task("draw"):
            given = coarse, self._renderer, camera, options.background, view, before
            image, part = upsampling.upsampled(*given)
        rows = 0, camera.height
        # The rest is background already.
        if view is not None and last.part is not None and picture.texture is last.texture:
            old, new = last.part[0], part[0]
            rows = min(old.start, new.start), max(old.stop, new.stop)
        with self._times.task("upload"):
            strip = slice(*rows)
            picture.texture.write(Image(image.color[strip], image.depth[strip], 0), rows[0])
        picture.add(image, 0.0)
        picture.factor, picture.part = rung.factor, part
        self.shown, self._coming, self._sampling = picture, None, None
        self.render_count += 1

    def _shown_image(self):
        """The shown picture as one Image."""
        sampled = self._sampling and self._sampling.color is not None
        if len(self.shown.images) == 1 and not sampled:
            return self.shown.images[0]
        color = wp.array(self.color_image(), dtype=wp.vec4ub, device="cpu")
        return Image(color, wp.array(self.shown.depth, dtype=float, device="cpu"), 0)

    def _render_at(self, factor, camera, cheaper=None):
        picture = self._picture(factor, camera, self.shown.texture, cheaper)
        self._add_rows(picture, camera, (0, picture.height))
        self.shown, self._coming, self._sampling = picture, None, None
        self.render_count += 1

    def _refine(self, camera):
        """Render the next strip of a finer picture; a whole one takes the shown one's place."""
        if self._coming is None:
            factor = finer(self.factor) if self.shown.part is None else 1.0
            self._coming = self._picture(factor, camera, self._spare)
            self._spare = self._coming.texture
        self._add_rows(self._coming, camera)
        if self._coming.done:
            self._spare = self.shown.texture
            self.shown, self._coming = self._coming, None

    def _sample(self, camera):
        """Render the next strip of a shifted image; a whole one joins the mean."""
        if self._sampling is None:
            self._sampling = Sampling(self.shown, self.device)
        camera = camera.resized(*self.shown.texture.size)  # at least 8 × 8, unlike the window
        if self._sampling.step(camera, self._add_rows):
            with self._times.task("upload"):
                self.shown.texture.write_color(self._sampling.color)

    def _picture(self, factor, camera, texture, cheaper=None):
        """A picture without rows yet, in this texture if it fits."""
        size = _size_of(camera, factor)
        if texture is not None and texture.size != size:
            texture.release()
            texture = None
        texture = texture or image_target(self._ctx, size, self.device, self.path)
        return Picture(size[1], factor, texture, cheaper or {})

    def _add_rows(self, picture, camera, rows=None):
        """Render rows of a picture, or its next strip; put them into its texture, if it has one."""
        start, rows = time.perf_counter(), rows or picture.strip()
        if picture.texture is not None:
            camera = camera.resized(*picture.texture.size)
            with self._times.task("upload"):
                picture.texture.prepare()
        with self._times.task("render"):
            image = self._image(camera, rows, **picture.cheaper)
            wp.synchronize_device(self.device)  # or CUDA's time would be measured elsewhere
        picture.add(image, time.perf_counter() - start)
        if picture.texture is not None:
            with self._times.task("upload"):
                picture.texture.write(image, rows[0])

    def _image(self, camera, rows, **cheaper):
        """Render rows in the view mode that is shown."""
        settings, depth_range = self._drawn.settings, self._drawn.viewpoint.depth_range
        options = RenderOptions(background=tuple(settings.background), **cheaper)
        return render_mode(self._renderer, camera, settings.mode, options, rows, depth_range)

    # -- OpenGL --------------------------------------------------------------------------

    def draw(self, camera, clip_range) -> None:
        """Draw color and depth into the framebuffer in use."""
        settings = self._drawn.settings
        scaled = self.shown.texture.size != (camera.width, camera.height)
        smooth = scaled and settings.mode in SMOOTH_MODES
        ground = self._ground.uniforms(unit=2)
        # On a CPU, what a shader needn't do would take as long as the rest.
        defines = ("SMOOTH",) * smooth + ("GROUND",) * bool(ground)
        defines += ("BUFFER",) * self.shown.texture.is_buffer
        if defines not in self._triangles:
            self._triangles[defines] = gl.full_screen(self._ctx, "image", defines)
        self._triangle = self._triangles[defines]
        (width, height), (x, y) = (camera.width, camera.height), camera.lens.center
        gl.set_uniforms(
            self._triangle.program,
            field_color=0,
            field_depth=1,
            field_size=self.shown.texture.size,
            texel=height / self.shown.height / camera.focal,
            background=settings.background,
            squares=(width / CHECKER_SIZE, height / CHECKER_SIZE),
            checkerboard=settings.checkerboard,
            transparent=self.transparent,
            extent=(width / camera.lens.focal[0], height / camera.lens.focal[1]),
            axis=(x / width, y / height),
            parallel=camera.parallel,
            camera_to_world=camera.camera_to_world,
            **ground,
            depth_terms=gl.depth_terms(*clip_range, camera.parallel),
        )
        partly = smooth or self.shown.part is not None
        several = ground or settings.checkerboard or self.transparent  # colors behind it
        plain = self.device.is_cpu and not several  # OpenGL is perhaps as slow as the renderer
        box = self._object_part(camera) if partly and plain else None
        if box is not None:
            background = np.round(255.0 * np.array(settings.background)) / 255.0
            self._ctx.clear(*background, 1.0, depth=1.0)
            self._ctx.scissor = box
        self._draw_triangle()
        self._ctx.scissor = None

    def _object_part(self, camera):
        """Where the shown picture is more than background: x, y, width, height, y up [pixels]."""
        if self.shown.part is not None:
            (top, bottom), (left, right) = ((one.start, one.stop) for one in self.shown.part)
        else:
            opaque = self.color_image()[..., 3] > 0
            rows, columns = (np.flatnonzero(opaque.any(axis=axis)) for axis in (1, 0))
            if not len(rows):
                return 0, 0, 1, 1
            (top, bottom), (left, right) = ((one[0], one[-1] + 1) for one in (rows, columns))
        size = self.shown.texture.size
        wide, high = camera.width / size[0], camera.height / size[1]
        around = size != (camera.width, camera.height)  # pixels that are blended
        left, right = (left - around) * wide, (right + around) * wide
        top, bottom = (top - around) * high, (bottom + around) * high
        x, y = max(int(left), 0), max(int(camera.height - bottom), 0)
        width, height = int(np.ceil(right)) - x, int(np.ceil(camera.height - top)) - y
        return x, y, max(width, 1), max(height, 1)

    def _draw_triangle(self):
        self.shown.texture.use()
        self._ctx.enable_only(moderngl.DEPTH_TEST)  # without the test nothing is written
        self._ctx.depth_func = "1"  # always
        self._triangle.render(moderngl.TRIANGLES)
        self._ctx.depth_func = "<="

    def draw_depth(self) -> None:
        """Fill the framebuffer's depth again as `draw` did, without its colors."""
        with gl.depth_only(self._ctx):
            self._draw_triangle()

    def release(self) -> None:
        self._ground.release()
        for triangle in self._triangles.values():
            triangle.program.release()
            triangle.release()
        for texture in (self.shown.texture, self._spare):
            if texture is not None:
                texture.release()


def _size_of(camera, factor):
    """Width and height of a picture with that share of a camera's, at least 8 × 8."""
    return max(8, round(factor * camera.width)), max(8, round(factor * camera.height))
