"""View modes: pictures of a field that show other quantities than its color.

    mode          a pixel's color
    depth         (far - t) / (far - near) in gray: near is white, far is black
    accumulation  opacity in gray
    normals       ½ + ½n, n the unit normal in model space, towards the eye
    tets          a color for the tet in which transmittance passes ½
    levels        the finest level that is not finer than a pixel there (../field/levels.py),
                  dark blue for 0 to yellow for the last one
    samples       evaluated samples, from dark blue for 0 to yellow for SAMPLES_SHOWN
    error         ERROR_GAIN · |default mode - conformance mode| in each channel

Normals come from the depth image.  Neighboring pixels give points p = t·d, and n is the cross
product of the differences across and down.  Each difference uses the neighbor whose depth is
closer, so n is right up to a silhouette, where two surfaces meet.

The mode `error` compares with conformance mode, because the float64 reference takes minutes
per image; tests/core/render/test_render.py compares conformance mode with the reference.

Alpha is 1 where the mode shows something and 0 where only the background is seen.  Images
are [H, W], row 0 at the top; t is the distance along the unit ray d, inf if the ray meets nothing.
"""

from dataclasses import replace

import numpy as np
import warp as wp

from ..field import level_edges
from .rays.camera import Camera, DeviceCamera, camera_ray, device_camera
from .render import Image, Renderer
from .render_options import MODES, Mode, RenderOptions
from .rounds.compositing import to_bytes

# The numbers of the modes in a kernel.
DEPTH, ACCUMULATION, NORMALS, TETS, LEVELS, SAMPLES = map(wp.constant, range(1, 7))
SAMPLES_SHOWN = wp.constant(64)  # 1 % of the rays that meet the bundled model take more
ERROR_GAIN = wp.constant(64.0)  # 1/255, which is invisible, becomes a quarter of white
HEAT = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))  # viridis

PRIMES = 2654435761, 2246822519  # multipliers of the hash: Knuth's, and one of xxHash
_FIRST, _SECOND = (wp.constant(wp.uint32(prime)) for prime in PRIMES)

wp.set_module_options({"enable_backward": False})


def caption(mode: str, depth_range: tuple[float, float] = (0.0, 1.0)) -> str:
    """One line on what the colors of a mode mean; empty for the field's own color."""
    near, far = depth_range
    return {
        "color": "",
        "depth": f"white at {near:.2f}, black at {far:.2f} from the eye",
        "accumulation": "opacity: white is opaque",
        "normals": "x, y, z as red, green, blue, from the depths",
        "tets": "a color for each tet",
        "levels": "finest level a pixel can show: dark 0, yellow all",
        "samples": f"samples a pixel: 0 dark to {SAMPLES_SHOWN} yellow",
        "error": f"{ERROR_GAIN:.0f} times the error of the default mode",
    }[mode]


@wp.struct
class Rendered:
    """Inputs of the pictures; a mode fills the fields that it reads."""

    color: wp.array2d(dtype=wp.vec4ub)
    exact: wp.array2d(dtype=wp.vec4ub)  # color in conformance mode
    depth: wp.array2d(dtype=float)
    tet: wp.array2d(dtype=int)
    samples: wp.array2d(dtype=int)
    camera: DeviceCamera
    first_row: int  # the camera's row that row 0 of the arrays is
    near: float
    far: float
    edge_pixels: wp.array(dtype=float)  # [L] lengths of the levels' edges at distance 1
    heat: wp.array(dtype=wp.vec3)


@wp.func
def gray(x: float):
    return wp.vec3(x, x, x)


@wp.func
def surface_point(rendered: Rendered, i: int, j: int):
    """The point in a pixel, relative to the eye."""
    pose = rendered.camera.camera_to_world
    origin, direction = camera_ray(rendered.camera, j, rendered.first_row + i)
    return origin - wp.vec3(pose[0, 3], pose[1, 3], pose[2, 3]) + rendered.depth[i, j] * direction


@wp.func
def depth_jump(depth: wp.array2d(dtype=float), t: float, i: int, j: int):
    """|depth of pixel (i, j) - t|; inf outside the image and where nothing is."""
    jump = wp.inf
    if i >= 0 and i < depth.shape[0] and j >= 0 and j < depth.shape[1]:
        jump = wp.abs(depth[i, j] - t)
    return jump


@wp.func
def normal_color(rendered: Rendered, i: int, j: int):
    """The color of a pixel's unit normal, not finite where the pixel lacks neighbors."""
    depth = rendered.depth
    t = depth[i, j]
    # The neighbors that are closer in depth: on the left or right, above or below.
    across = wp.where(depth_jump(depth, t, i, j + 1) < depth_jump(depth, t, i, j - 1), 1, -1)
    down = wp.where(depth_jump(depth, t, i + 1, j) < depth_jump(depth, t, i - 1, j), 1, -1)
    gap = depth_jump(depth, t, i, j + across) + depth_jump(depth, t, i + down, j)
    c = gray(wp.nan)
    if wp.isfinite(t) and wp.isfinite(gap):
        p = surface_point(rendered, i, j)
        x = surface_point(rendered, i, j + across) - p
        y = surface_point(rendered, i + down, j) - p
        n = wp.normalize(wp.cross(x, y))
        _origin, direction = camera_ray(rendered.camera, j, rendered.first_row + i)
        if wp.dot(n, direction) > 0.0:
            n = -n
        c = 0.5 * (n + gray(1.0))
    return c


@wp.func
def tet_byte(h: wp.uint32):
    return float(wp.uint32(64) + (h & wp.uint32(255)) * wp.uint32(3) / wp.uint32(4)) / 255.0


@wp.func
def tet_color(tet: int):
    """Bytes from 64 to 255 of a hash of the tet's id; not finite for -1."""
    h = wp.uint32(tet + 1) * _FIRST
    h = h ^ (h >> wp.uint32(15))
    h = h * _SECOND
    h = h ^ (h >> wp.uint32(13))
    c = wp.vec3(tet_byte(h), tet_byte(h >> wp.uint32(8)), tet_byte(h >> wp.uint32(16)))
    return wp.where(tet < 0, gray(wp.nan), c)


@wp.func
def heated(heat: wp.array(dtype=wp.vec3), x: float):
    """The color of a value: dark for 0, yellow for 1 and above."""
    last = heat.shape[0] - 1
    place = wp.clamp(x, 0.0, 1.0) * float(last)
    k = wp.min(int(place), last - 1)
    return wp.lerp(heat[k], heat[k + 1], place - float(k))


@wp.func
def level_color(rendered: Rendered, t: float):
    """The color of the finest level that is not finer than a pixel at distance t, or of 0."""
    level_count = rendered.edge_pixels.shape[0]
    away = wp.where(rendered.camera.parallel != 0, 1.0, t)  # parallel rays see one size
    level = int(0)
    while level + 1 < level_count and rendered.edge_pixels[level + 1] >= away:
        level += 1
    c = heated(rendered.heat, float(level) / float(wp.max(level_count - 1, 1)))
    return wp.where(wp.isfinite(t), c, gray(wp.nan))


@wp.func
def error_color(a: wp.vec4ub, b: wp.vec4ub):
    difference = wp.vec3()
    for k in range(3):
        difference[k] = ERROR_GAIN * wp.abs(float(a[k]) - float(b[k])) / 255.0
    return difference


@wp.kernel
def picture_kernel(
    mode: int,
    rendered: Rendered,
    skipped: int,  # rows at the top of `rendered` that are only there as neighbors
    background: wp.vec3,
    picture: wp.array2d(dtype=wp.vec4ub),  # out
):
    row, j = wp.tid()
    i = row + skipped
    t = rendered.depth[i, j]
    c = wp.vec3()  # not finite where the background stays
    if mode == DEPTH:
        c = gray((rendered.far - t) / (rendered.far - rendered.near))
    elif mode == ACCUMULATION:
        c = gray(float(rendered.color[i, j][3]) / 255.0)
    elif mode == NORMALS:
        c = normal_color(rendered, i, j)
    elif mode == TETS:
        c = tet_color(rendered.tet[i, j])
    elif mode == LEVELS:
        c = level_color(rendered, t)
    elif mode == SAMPLES:
        c = heated(rendered.heat, float(rendered.samples[i, j]) / float(SAMPLES_SHOWN))
    else:
        c = error_color(rendered.color[i, j], rendered.exact[i, j])
    alpha = float(1.0)
    if not wp.isfinite(c[0]):
        c = background
        alpha = 0.0
    picture[row, j] = to_bytes(c, alpha)


def render_mode(
    renderer: Renderer,
    camera: Camera,
    mode: Mode = "color",
    options: RenderOptions | None = None,
    rows: tuple[int, int] | None = None,
    depth_range: tuple[float, float] = (0.0, 1.0),
) -> Image:
    """Renderer.render in a view mode: color is the mode's picture, depth the field's in any mode.

    Args:
        depth_range: Distances from the eye that mode "depth" shows white and black.
    """
    options = options or RenderOptions()
    if mode == "color":
        return renderer.render(camera, options, rows)
    first, last = rows or (0, camera.height)
    above = below = 0
    if mode == "normals":  # rows beside the strip, so that strips make up the whole image
        above, below = int(first > 0), int(last < camera.height)
    options = replace(options, details=mode in ("tets", "samples"))
    image = renderer.render(camera, options, (first - above, last + below))
    rendered, device = Rendered(), renderer.device
    rendered.color, rendered.depth = image.color, image.depth
    rendered.tet, rendered.samples = image.tet, image.samples
    rendered.camera, rendered.first_row = device_camera(camera), first - above
    rendered.near, rendered.far = map(float, depth_range)
    if mode in ("levels", "samples"):
        heat = np.array(HEAT, np.float32) / 255.0
        rendered.heat = wp.array(heat, dtype=wp.vec3, device=device)
    if mode == "levels":
        edges = level_edges(renderer.field.mesh, renderer.field.layout.level_count)
        edge_pixels = edges * camera.lens.focal[0]
        rendered.edge_pixels = wp.array(edge_pixels, dtype=float, device=device)
    if mode == "error":
        exact = RenderOptions(background=options.background, conformance=True)
        rendered.exact = renderer.render(camera, exact, rows).color
    picture = wp.empty((last - first, camera.width), dtype=wp.vec4ub, device=device)
    inputs = [MODES.index(mode), rendered, above, wp.vec3(*options.background)]
    wp.launch(picture_kernel, picture.shape, inputs=inputs, outputs=[picture], device=device)
    return Image(picture, image.depth[above : above + last - first], image.sample_count)
