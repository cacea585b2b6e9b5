"""Images of an object that moves, on a CPU: error against time, with fewer rays than pixels.

The top of the object goes in a circle while the camera turns around it.  An image of fewer rays is
upsampled (core/render/upsampling.py), or scaled up for comparison; each is compared with the same
pose in conformance mode, over the object's pixels.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import warp as wp

from ....core.field import TetField
from ....core.render import PastView, Renderer, RenderOptions, Upsampling
from ..report.contents import Table
from ..stopwatch import Spread, spread_of
from . import pictures

STRIDES = (1, 1), (2, 2), (3, 2), (3, 3), (4, 4)
FRAMES, WARM_UP = 16, 4  # of the way; the first ones follow a full image
FRAME_SECONDS = 1.0 / 15.0
TURN_SECONDS = 4.0  # for a circle
AMPLITUDE = 0.15  # of the object's size
ORBIT = np.radians(10.0)  # a second


@dataclass(frozen=True)
class MovingRow:
    """Time and error of images with so many rays."""

    rays: Annotated[str, "rays, of the pixels"]
    psnr: Annotated[float, "PSNR [dB]"]  # of all images together
    worst_psnr: Annotated[float, "worst image [dB]"]
    scaled_psnr: Annotated[float | None, "scaled up instead [dB]"]
    frame: Annotated[Spread, "ms an image"]
    upsampling: Annotated[float | None, "of which without rays"]


def poses(field: TetField) -> list[np.ndarray]:
    """The way of the vertices, whose upper ones go along.  FRAMES of [V, 3]"""
    rest = field.mesh.rest_vertices
    low, high = rest.min(axis=0), rest.max(axis=0)
    share = ((rest[:, 2] - low[2]) / max(high[2] - low[2], 1e-9))[:, None] ** 2
    size = np.linalg.norm(high - low)
    angles = 2.0 * np.pi * FRAME_SECONDS * np.arange(FRAMES) / TURN_SECONDS
    ways = [np.array([np.sin(a), 1.0 - np.cos(a), 0.0]) for a in angles]
    return [(rest + AMPLITUDE * size * share * way).astype(np.float32) for way in ways]


def table(field: TetField, size: int, step: Callable[[float], None]) -> Table:
    """Rows for STRIDES; `step` is called with the finished share."""
    renderer, way = Renderer(field, "cpu"), poses(field)
    yaws = pictures.FIRST_YAW + ORBIT * FRAME_SECONDS * np.arange(FRAMES)
    cameras = [pictures.view(field, yaw, size) for yaw in yaws]
    exact = []
    for vertices, camera in zip(way, cameras, strict=True):
        renderer.set_vertices(vertices)
        exact.append(renderer.render(camera, RenderOptions(conformance=True)).color_array())
    rows = []
    for stride in STRIDES:
        rows.append(_row(renderer, stride, way, cameras, exact))
        step(len(rows) / len(STRIDES))
    caption = f"Moving: images of {size} × {size} pixels, 15 a second, while it bends and turns."
    return Table("moving", caption, rows)


def findings(tables) -> list[str]:
    """What the tables of `table` say, a sentence each."""
    found = []
    for rows in (one.rows for one in tables):
        full, some = rows[0], rows[len(rows) // 2]
        found.append(
            f"While it moves, images with {some.rays} of the rays take {some.frame.median:.3g} ms"
            f" instead of {full.frame.median:.3g} and have {some.psnr:.1f} dB; scaled up they would"
            f" have {some.scaled_psnr:.1f} dB."
        )
    return found


def _row(renderer, stride, way, cameras, exact):
    is_full = stride == (1, 1)
    background, upsampling = RenderOptions().background, Upsampling()
    before = view = None
    errors, scaled, times, own = [], [], [], []
    for vertices, camera, wanted in zip(way, cameras, exact, strict=True):
        renderer.set_vertices(vertices)
        start = middle = time.perf_counter()
        if is_full or view is None:  # moving begins at a full image
            image = renderer.render(camera)
        else:
            upsampling.changed()
            options = RenderOptions(background, details=True)
            coarse = upsampling.render(renderer, camera, stride, options, view)
            middle = time.perf_counter()
            given = coarse, renderer, camera, background, view, before
            image, _ = upsampling.upsampled(*given)
        end = time.perf_counter()
        times.append(1e3 * (end - start))
        own.append(1e3 * (end - middle))
        vertices = wp.array(vertices, dtype=wp.vec3, device="cpu")
        before, view = image, PastView(camera, vertices)
        errors.append(_squares(image.color_array(), wanted))
        scaled.append(_squares(_scaled(renderer, camera, stride), wanted))
    errors = errors[WARM_UP:]
    return MovingRow(
        rays="all" if is_full else f"1/{stride[0] * stride[1]}",
        psnr=_decibels(errors),
        worst_psnr=min(_decibels([one]) for one in errors),
        scaled_psnr=None if is_full else _decibels(scaled[WARM_UP:]),
        frame=spread_of(times[WARM_UP:]),
        upsampling=None if is_full else float(np.median(own[WARM_UP:])),
    )


def _squares(colors, wanted):
    """Squares of the object's pixels' errors, 0..1."""
    seen = wanted[..., 3] > 0
    return ((colors[seen][:, :3].astype(float) - wanted[seen, :3]) / 255.0) ** 2


def _decibels(squares):
    mean = np.concatenate(squares).mean() if sum(map(len, squares)) else 0.0
    return float(min(-10.0 * np.log10(max(mean, 1e-30)), pictures.PEAK_DB))


def _scaled(renderer, camera, stride):
    """The colors of an image with as many rays, with bilinear means between them."""
    from PIL import Image

    width, height = camera.width, camera.height
    share = (stride[0] * stride[1]) ** -0.5
    coarse = renderer.render(camera.resized(round(share * width), round(share * height)))
    # With opacity, Pillow would weight colors by it, and the background has none.
    picture = Image.fromarray(np.ascontiguousarray(coarse.color_array()[..., :3]))
    return np.asarray(picture.resize((width, height), Image.Resampling.BILINEAR))
