"""What rendering leaves out at rest, measured by rendering with it.

A turn is one image with it and one without it of the same view; views go round.  Each way has
a renderer of its own: on CUDA one expects as many rounds as its last image took, which another
way's would mislead.  What differs between the two is told over all views, over white.

Shapes: T tets, L levels.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from itertools import cycle
from typing import NamedTuple

import numpy as np

from ...field import TetField, below_pixel, level_edges, narrowest_pixel, occupied_share
from ...render import Renderer, RenderOptions, visible_part
from ..rendering import views
from ..stopwatch import compared
from .rows import RENDERING, Compared, Omission, image_change, omission

ALL_SUBTETS = 2**64 - 1  # the mask of a full tet


class Way(NamedTuple):
    """One way of rendering."""

    renderer: Renderer
    options: RenderOptions


class Frames:
    """Images of a field at rest, in two ways that take turns."""

    def __init__(self, field: TetField, device, size: int, view_count: int, repeats: int):
        self.field, self.device, self.repeats = field, device, repeats
        self.cameras = views(field, view_count, size)

    @cached_property
    def usual(self) -> Way:
        """The field as it is, in default mode."""
        return self.way()

    def way(self, field: TetField | None = None, part_of=visible_part, **options) -> Way:
        """A renderer of another field of the same mesh, or of other parts of it.

        Args:
            options: Of RenderOptions.
        """
        renderer = Renderer(field or self.field, self.device, part_of)
        renderer.set_vertices(self.field.mesh.rest_vertices)
        return Way(renderer, RenderOptions(**options))

    def compared(self, with_it: Way, without: Way) -> tuple[Compared, str]:
        """What both take, and what their images differ by."""
        turns = compared(self._turn(with_it), self._turn(without), self.device, self.repeats)
        return turns, image_change(self.images(with_it), self.images(without))

    def images(self, way: Way):
        """Of all views.  [H, W, 4] uint8 each"""
        return [way.renderer.render(c, way.options).color_array() for c in self.cameras]

    def _turn(self, way: Way) -> Callable[[], object]:
        cameras = cycle(self.cameras)
        return lambda: way.renderer.render(next(cameras), way.options)


def empty_space(frames: Frames) -> Omission:
    """Samples in empty sub-tets of the tets that rays cross; empty tets are another row."""
    field = frames.field
    filled = np.where(field.occupancy == 0, field.occupancy, np.uint64(ALL_SUBTETS))
    share = 100.0 * (1.0 - occupied_share(frames.usual.renderer.part.occupancy))
    untrained = (
        "The density there was never trained: one would see it, and it ends rays early, so that"
        " with it there are fewer samples behind."
    )
    return omission(
        "samples in empty sub-tets",
        RENDERING,
        *frames.compared(frames.way(replace(field, occupancy=filled)), frames.usual),
        f"{share:.0f} % of the sub-tets of the tets that rays cross are empty. {untrained}",
        f"{share:.0f} % of the sub-tets of the tets that rays cross are empty, and passing over"
        f" them gains no time. They stay out for what one sees. {untrained}",
    )


def empty_tets(frames: Frames) -> Omission:
    """Tets without an occupied sub-tet, in the walk of a ray."""
    share = 100.0 * (frames.field.occupancy == 0).mean()
    return omission(
        "tets without density on a ray's way",
        RENDERING,
        *frames.compared(frames.way(part_of=_every_tet), frames.usual),
        f"{share:.0f} % of the tets are there for the dynamics alone; rays find nothing there.",
        f"{share:.0f} % of the tets are empty, and crossing one costs little beside a sample. They"
        " are sorted out once, when a model is loaded, so that leaving them out is free.",
    )


def hidden_samples(frames: Frames) -> Omission:
    """Samples behind what is opaque."""
    spent = 100.0 * (1.0 - RenderOptions().stop)
    return omission(
        "samples behind what is opaque",
        RENDERING,
        *frames.compared(frames.way(termination=0.0), frames.usual),
        f"A ray ends once {spent:.0f} % of it is spent; what is behind is taken to look like"
        " what is before.",
        "Rays hardly meet anything opaque here before they leave the object. The test that ends"
        " them stays: it is one comparison a sample, and what is opaque in another scene costs.",
    )


def overlap_path(frames: Frames) -> Omission:
    """The path for overlap, where nothing overlaps.

    It has no early end, so images are also compared with a walk that has none.
    """
    layers, endless = frames.way(path="merge"), frames.way(termination=0.0)
    turns, change = frames.compared(layers, frames.usual)
    alike = image_change(frames.images(layers), frames.images(endless))
    return omission(
        "the path for overlap, at rest",
        RENDERING,
        turns,
        f"{change}; where rays of both go on behind what is opaque: {alike}",
        "Nothing overlaps at rest: that is found out once a pose, so no ray has to sort media.",
        "It costs no more than the walk here, where rays cross few tets. It has no early end and"
        " needs memory for all of a ray's pieces, so rays take it only where the mesh overlaps.",
    )


def single_precision(frames: Frames) -> Omission:
    """Networks and tables in float32, on CUDA; both in rounds that the host waits for."""
    return omission(
        "single precision of networks and tables",
        RENDERING,
        *frames.compared(frames.way(single_precision=True), frames.way(path="host")),
        "Tensor cores, in a kernel of ours instead of torch's, and half as many bytes.",
        "Images are too small here for networks to count; half precision is left on because it"
        " counts in larger ones, and needs no torch.",
    )


def waiting_rounds(frames: Frames) -> Omission:
    """Rounds after each of which the host asks how many rays are left, on CUDA."""
    return omission(
        "rounds that the host waits for",
        RENDERING,
        *frames.compared(frames.way(path="host"), frames.usual),
        "How many rays go on is known on the device, which a round asks; each is a CUDA graph.",
        "Waiting costs nothing here; where images are larger, or the host is busy, it does.",
    )


def unchanged_view(frames: Frames) -> Omission:
    """Rendering again what is on the screen."""
    camera, (renderer, options) = frames.cameras[0], frames.usual

    def render():
        return renderer.render(camera, options).color_array()

    change = image_change([render()], [render()])
    return omission(
        "rendering again what did not change",
        RENDERING,
        compared(render, lambda: None, frames.device, frames.repeats),
        change,
        "Neither camera nor vertices changed, so the same image would come out.",
        "An image of this size costs nothing that can be measured.",
    )


def fine_levels(frames: Frames) -> Omission:
    """The levels that are finer than a pixel; where none is, the finest one."""
    field = frames.field
    count = field.layout.level_count
    positions, focal = [c.position for c in frames.cameras], frames.cameras[0].focal
    pixel = narrowest_pixel(positions, focal, field.mesh.rest_vertices)
    edges = level_edges(field.mesh, count)
    finer = int(below_pixel(edges, pixel).sum())
    kept = max(1, count - max(finer, 1))
    finest = edges[-1] / pixel
    what = (
        f"{finer} of {count} levels are finer than a pixel of this view"
        if finer
        else f"no level is finer than a pixel of this view (the finest has edges of {finest:.1f})"
    )
    reason = f"It is kept: {what}, and networks trained with all levels are wrong without one."
    return omission(
        "levels finer than a pixel" if finer else "the finest level",
        RENDERING,
        *frames.compared(frames.usual, frames.way(level_count=kept)),
        reason,
        reason,
        left_out=False,
    )


def view_dependence(frames: Frames) -> Omission:
    """Spherical harmonics of a sample's direction."""
    field = frames.field
    has_it = field.options.view_dependence
    other = frames.way(replace(field, options=replace(field.options, view_dependence=not has_it)))
    pair = (frames.usual, other) if has_it else (other, frames.usual)
    reason = (
        "It is kept: the model was trained with it, and its colors are off without."
        if has_it
        else "The model was trained without it, and its colors depend on no direction."
    )
    reason += " Networks have their inputs for it either way: only harmonics are computed or not."
    return omission(
        "view dependence", RENDERING, *frames.compared(*pair), reason, reason, left_out=not has_it
    )


def rendering_rows(device) -> list[Callable[[Frames], Omission]]:
    """What there is to measure on a device."""
    rows = [empty_space, empty_tets, hidden_samples, overlap_path]
    if device != "cpu":  # where all is single precision
        rows += [single_precision, waiting_rounds]
    return [*rows, unchanged_view, fine_levels, view_dependence]


def _every_tet(field: TetField):
    """As visible_part, in its order, but all tets."""
    part, ids = visible_part(replace(field, occupancy=np.full_like(field.occupancy, ALL_SUBTETS)))
    return replace(part, occupancy=field.occupancy[ids]), ids
