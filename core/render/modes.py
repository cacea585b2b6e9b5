"""View modes: what else there is to see of a field than its color.

    mode          a pixel's color
    depth         (far - t) / (far - near) in gray: near is white, far is black
    accumulation  opacity in gray
    normals       ½ + ½n, n the unit normal in model space, towards the eye
    tets          a color that belongs to the tet in which transmittance passes ½
    levels        the finest level that is not finer than a pixel there (../field/levels.py),
                  dark blue for 0 to yellow for the last one
    samples       evaluated samples, from dark blue for 0 to yellow for SAMPLES_SHOWN
    error         ERROR_GAIN · |default mode - conformance mode|, each channel by itself

Normals come from the depth image: neighbouring pixels are points p = t·d, and n is the cross
product of their differences across and down.  Of the two neighbours on a side the one whose
depth differs less counts, so that n is right up to a silhouette, where there are two surfaces.

The error is that against conformance mode, as the float64 reference takes minutes an image;
tests/test_render.py has conformance mode equal to it.

Alpha is 1 where the mode has something to show and 0 where the background stays.  Images
are [H, W], row 0 at the top; t is the distance along the unit ray d, inf where nothing is.
"""

from dataclasses import replace

import numpy as np
import warp as wp

from ..field import below_pixel, level_edges
from .rays import DeviceCamera, camera_ray, device_camera
from .render import Image
from .render_options import Mode, RenderOptions
from .rounds import to_byte

SAMPLES_SHOWN = 64  # of the bundled model's rays that meet it, 1 % take more
ERROR_GAIN = 64.0  # 1/255, which nobody sees, becomes a quarter of white
HEAT = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))  # viridis

# Multipliers of the hash: Knuth's, and one of xxHash.
PRIMES = 2654435761, 2246822519
_FIRST, _SECOND = (wp.constant(wp.uint32(prime)) for prime in PRIMES)

wp.set_module_options({"enable_backward": False})


def caption(mode: str, depth_range=(0.0, 1.0)) -> str:
    """What the colors of a mode stand for, in a line; nothing for the field's own color."""
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


# -- reference ---------------------------------------------------------------------------------


def normals_reference(points):
    """Unit normals towards the eye, from points [H, W, 3] relative to it, NaN where none is.

    Returns:
        [H, W, 3], NaN where a pixel has no neighbour across, or none down.
    """
    points = np.asarray(points, float)
    t = np.linalg.norm(points, axis=-1)
    slopes = []
    for axis in (1, 0):
        step = np.diff(points, axis=axis)
        jump = np.abs(np.diff(t, axis=axis))
        missing = np.full_like(np.take(step, [0], axis), np.nan)
        before, after = (np.concatenate(pair, axis) for pair in ((missing, step), (step, missing)))
        missing = missing[..., 0]
        jump_before = np.concatenate([missing, jump], axis)
        jump_after = np.concatenate([jump, missing], axis)
        use_after = np.isnan(jump_before) | (jump_after < jump_before)
        slopes.append(np.where(use_after[..., None], after, before))
    n = np.cross(*slopes)
    length = np.linalg.norm(n, axis=-1, keepdims=True)
    n = np.divide(n, length, out=np.full_like(n, np.nan), where=length > 0)
    return np.where((n * points).sum(axis=-1, keepdims=True) > 0, -n, n)


def tet_colors_reference(tet):
    """The colors 64..255 of tet ids [...], from a hash of the id.  [..., 3] uint8"""
    h = (np.asarray(tet).astype(np.uint64) + 1) * PRIMES[0] & 0xFFFFFFFF
    h ^= h >> 15
    h = h * PRIMES[1] & 0xFFFFFFFF
    h ^= h >> 13
    return np.stack([64 + (h >> shift & 255) * 3 // 4 for shift in (0, 8, 16)], -1).astype(np.uint8)


def levels_reference(t, edges, focal):
    """The finest level that is not finer than a pixel at distance t, or 0.  [...] int

    Args:
        t: Distances, inf where nothing is.  [...]
        edges: `level_edges` of the model.  [L]
        focal: In pixels.
    """
    resolved = ~below_pixel(edges, np.asarray(t, float) / focal)
    return np.maximum(resolved.sum(axis=-1) - 1, 0)


def heat_reference(x):
    """The colors 0..1 of values [...], 0 dark and 1 (and above) yellow.  [..., 3]"""
    at = np.linspace(0.0, 1.0, len(HEAT))
    return np.stack([np.interp(x, at, column) for column in np.array(HEAT).T / 255.0], axis=-1)


# -- kernels -----------------------------------------------------------------------------------


@wp.func
def opaque(color: wp.vec3):
    return wp.vec4ub(to_byte(color[0]), to_byte(color[1]), to_byte(color[2]), wp.uint8(255))


@wp.func
def nothing(background: wp.vec3):
    b = background
    return wp.vec4ub(to_byte(b[0]), to_byte(b[1]), to_byte(b[2]), wp.uint8(0))


@wp.kernel
def depth_kernel(
    depth: wp.array2d(dtype=float),
    near: float,
    far: float,
    background: wp.vec3,
    color: wp.array2d(dtype=wp.vec4ub),  # out
):
    i, j = wp.tid()
    gray = (far - depth[i, j]) / (far - near)
    c = opaque(wp.vec3(gray, gray, gray))
    if wp.isinf(depth[i, j]):
        c = nothing(background)
    color[i, j] = c


@wp.kernel
def accumulation_kernel(
    rendered: wp.array2d(dtype=wp.vec4ub),
    color: wp.array2d(dtype=wp.vec4ub),  # out
):
    i, j = wp.tid()
    a = rendered[i, j][3]
    color[i, j] = wp.vec4ub(a, a, a, wp.uint8(255))


@wp.func
def surface_point(
    camera: DeviceCamera, depth: wp.array2d(dtype=float), i: int, j: int, first_row: int
):
    """Relative to the eye."""
    _origin, direction = camera_ray(camera, j, first_row + i)
    return depth[i, j] * direction


@wp.func
def depth_jump(depth: wp.array2d(dtype=float), t: float, i: int, j: int):
    """How far the depth of pixel (i, j) is from t; inf beyond the image and where nothing is."""
    jump = wp.inf
    if i >= 0 and i < depth.shape[0] and j >= 0 and j < depth.shape[1]:
        jump = wp.abs(depth[i, j] - t)
    return jump


@wp.kernel
def normals_kernel(
    camera: DeviceCamera,
    depth: wp.array2d(dtype=float),
    first_row: int,  # the image's row that row 0 of `depth` is
    skipped: int,  # rows at the top of `depth` that are there for their neighbours alone
    background: wp.vec3,
    color: wp.array2d(dtype=wp.vec4ub),  # out
):
    """`normals_reference`."""
    row, j = wp.tid()
    i = row + skipped
    t = depth[i, j]
    # Which neighbour is nearer in depth: on the left or right, above or below.
    across = wp.where(depth_jump(depth, t, i, j + 1) < depth_jump(depth, t, i, j - 1), 1, -1)
    down = wp.where(depth_jump(depth, t, i + 1, j) < depth_jump(depth, t, i - 1, j), 1, -1)
    gap = depth_jump(depth, t, i, j + across) + depth_jump(depth, t, i + down, j)
    c = nothing(background)
    if wp.isfinite(t) and wp.isfinite(gap):
        p = surface_point(camera, depth, i, j, first_row)
        x = surface_point(camera, depth, i, j + across, first_row) - p
        y = surface_point(camera, depth, i + down, j, first_row) - p
        n = wp.normalize(wp.cross(x, y))
        if wp.dot(n, p) > 0.0:
            n = -n
        c = opaque(0.5 * (n + wp.vec3(1.0, 1.0, 1.0)))
    color[row, j] = c


@wp.kernel
def tets_kernel(
    tet: wp.array2d(dtype=int),
    background: wp.vec3,
    color: wp.array2d(dtype=wp.vec4ub),  # out
):
    """`tet_colors_reference`."""
    i, j = wp.tid()
    h = wp.uint32(tet[i, j] + 1) * _FIRST
    h = h ^ (h >> wp.uint32(15))
    h = h * _SECOND
    h = h ^ (h >> wp.uint32(13))
    c = wp.vec4ub(tet_byte(h), tet_byte(h >> wp.uint32(8)), tet_byte(h >> wp.uint32(16)),
                  wp.uint8(255))  # fmt: skip
    if tet[i, j] < 0:
        c = nothing(background)
    color[i, j] = c


@wp.func
def tet_byte(h: wp.uint32):
    return wp.uint8(wp.uint32(64) + (h & wp.uint32(255)) * wp.uint32(3) / wp.uint32(4))


@wp.func
def heated(heat: wp.array(dtype=wp.vec3), x: float):
    """`heat_reference`."""
    last = heat.shape[0] - 1
    place = wp.clamp(x, 0.0, 1.0) * float(last)
    k = wp.min(int(place), last - 1)
    return opaque(wp.lerp(heat[k], heat[k + 1], place - float(k)))


@wp.kernel
def samples_kernel(
    samples: wp.array2d(dtype=int),
    heat: wp.array(dtype=wp.vec3),
    most: int,
    color: wp.array2d(dtype=wp.vec4ub),  # out
):
    i, j = wp.tid()
    color[i, j] = heated(heat, float(samples[i, j]) / float(most))


@wp.kernel
def levels_kernel(
    depth: wp.array2d(dtype=float),
    heat: wp.array(dtype=wp.vec3),
    edge_pixels: wp.array(dtype=float),  # [L] lengths of the levels' edges at distance 1
    background: wp.vec3,
    color: wp.array2d(dtype=wp.vec4ub),  # out
):
    """`levels_reference`."""
    i, j = wp.tid()
    c = nothing(background)
    if wp.isfinite(depth[i, j]):
        level_count = edge_pixels.shape[0]
        level = int(0)
        while level + 1 < level_count and edge_pixels[level + 1] >= depth[i, j]:
            level += 1
        c = heated(heat, float(level) / float(wp.max(level_count - 1, 1)))
    color[i, j] = c


@wp.kernel
def error_kernel(
    rendered: wp.array2d(dtype=wp.vec4ub),
    conformance: wp.array2d(dtype=wp.vec4ub),
    gain: float,
    color: wp.array2d(dtype=wp.vec4ub),  # out
):
    i, j = wp.tid()
    a = rendered[i, j]
    b = conformance[i, j]
    difference = wp.vec3()
    for k in range(3):
        difference[k] = gain * wp.abs(float(a[k]) - float(b[k])) / 255.0
    color[i, j] = opaque(difference)


# -- image -------------------------------------------------------------------------------------


def render_mode(
    renderer, camera, mode: Mode = "color", options=None, rows=None, depth_range=(0.0, 1.0)
) -> Image:
    """Render in a view mode; the arguments that are not named here are Renderer.render's.

    Args:
        mode: One of MODES.
        depth_range: Distances from the eye that mode "depth" shows white and black.

    Returns:
        An Image whose color is the mode's picture; depth is the field's in any mode.
    """
    options = options or RenderOptions()
    if mode == "color":
        return renderer.render(camera, options, rows)
    first, last = rows or (0, camera.height)
    above = below = 0
    if mode == "normals":  # rows beside the strip, so that strips make up the whole image
        above, below = int(first > 0), int(last < camera.height)
    details = mode in ("tets", "samples")
    rendered = renderer.render(
        camera, replace(options, details=details), (first - above, last + below)
    )
    device = rendered.color.device
    background = wp.vec3(*options.background)
    color = wp.empty((last - first, camera.width), dtype=wp.vec4ub, device=device)
    if mode == "depth":
        kernel, inputs = depth_kernel, [rendered.depth, *map(float, depth_range), background]
    elif mode == "accumulation":
        kernel, inputs = accumulation_kernel, [rendered.color]
    elif mode == "normals":
        kernel = normals_kernel
        inputs = [device_camera(camera), rendered.depth, first - above, above, background]
    elif mode == "tets":
        kernel, inputs = tets_kernel, [rendered.tet, background]
    elif mode == "levels":
        edges = level_edges(renderer.field.mesh, renderer.field.layout.level_count)
        edge_pixels = wp.array(edges * camera.lens.focal[0], dtype=float, device=device)
        kernel = levels_kernel
        inputs = [rendered.depth, _heat(device), edge_pixels, background]
    elif mode == "samples":
        kernel, inputs = samples_kernel, [rendered.samples, _heat(device), SAMPLES_SHOWN]
    else:
        exact = RenderOptions(background=options.background, conformance=True)
        conformance = renderer.render(camera, exact, rows)
        kernel, inputs = error_kernel, [rendered.color, conformance.color, ERROR_GAIN]
    wp.launch(kernel, dim=color.shape, inputs=inputs, outputs=[color], device=device)
    depth = rendered.depth[above : above + last - first]
    return Image(color, depth, rendered.sample_count)


def _heat(device):
    return wp.array(np.array(HEAT, np.float32) / 255.0, dtype=wp.vec3, device=device)
